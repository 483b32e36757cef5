"""What the main window asks of a page: its title, and a header beside STOP where it wants one."""

from collections.abc import Callable

from PySide6.QtCore import QEvent
from PySide6.QtWidgets import QWidget

from calstation.gui.shell.context import AppContext


class Page(QWidget):
    """One page of the window.

    A page is laid out below a strip that the main window draws on every page, with STOP at its right end.
    `header` stands at the left of that strip; without one, the strip shows how the run is doing.
    """

    header: QWidget | None = None

    def __init__(self, app: AppContext) -> None:
        super().__init__()
        self.app = app

    def title(self) -> str:
        """The page's name on its tab, in the language in force."""
        raise NotImplementedError

    def may_leave(self, go: Callable[[], object]) -> bool:
        """Whether the page may be left now; a page that asks first gives False and calls `go` once it may."""
        return True

    def retranslate(self) -> None:
        """Say everything again in the language in force."""

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)
