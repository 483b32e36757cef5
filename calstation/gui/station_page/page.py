"""The station page."""

from calstation.gui.context import AppContext
from calstation.gui.page import Page


class StationPage(Page):
    """The station page."""

    def __init__(self, app: AppContext) -> None:
        super().__init__(app)
        self.setObjectName("station_page")

    def title(self) -> str:
        """The page's name on its tab."""
        return self.tr("Station")
