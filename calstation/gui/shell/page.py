"""Base class of the pages of the window."""

from collections.abc import Callable

from PySide6.QtWidgets import QWidget

from calstation.gui.shell.context import AppContext


class Page(QWidget):
    """A page of the window.

    The main window draws a strip at the top of every page, with STOP at its right end. `header` stands at the left of
    the strip; without one the strip shows the progress of the run.
    """

    header: QWidget | None = None

    def __init__(self, app: AppContext) -> None:
        super().__init__()
        self.app = app

    def title(self) -> str:
        """The text of the page's tab in the current language."""
        raise NotImplementedError

    def may_leave(self, go: Callable[[], object]) -> bool:
        """Whether the page may be left now; a page that asks first returns False and calls `go` when it may."""
        return True
