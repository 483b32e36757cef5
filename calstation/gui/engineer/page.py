"""The engineer page."""

from calstation.gui.context import AppContext
from calstation.gui.page import Page


class EngineerPage(Page):
    """The engineer page."""

    def __init__(self, app: AppContext) -> None:
        super().__init__(app)
        self.setObjectName("engineer_page")

    def title(self) -> str:
        """The page's name on its tab."""
        return self.tr("Engineer")
