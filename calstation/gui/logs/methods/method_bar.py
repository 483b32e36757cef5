"""How a log is solved: by its stages, or by one of the methods that need no rate table."""

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QTabBar, QWidget

from calstation.gui.logs.methods.kinds import STAGES, words
from calstation.gui.text import on_language_change


class MethodBar(QTabBar):
    """Tabs of the stages ("") and of each method. `chosen(method)`: another one was chosen."""

    chosen = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("method_tabs")
        self.setProperty("kind", "views")
        self.setDrawBase(False)
        self.setExpanding(False)
        for _ in ("", *STAGES):
            self.addTab("")
        self.currentChanged.connect(lambda _: self.chosen.emit(self.chosen_method))
        on_language_change(self, self._show_texts)

    @property
    def chosen_method(self) -> str:
        """The chosen method; "" for the stages."""
        return ("", *STAGES)[self.currentIndex()]

    def choose(self, method: str) -> None:
        """Choose a method as a click on its tab does."""
        self.setCurrentIndex(("", *STAGES).index(method))

    def _show_texts(self) -> None:
        self.setTabText(0, self.tr("Stages of the log"))
        self.setTabToolTip(0, self.tr("Solve the stages again as they were recorded"))
        for index, stage in enumerate(STAGES, start=1):
            self.setTabText(index, words(stage).title)
            self.setTabToolTip(index, words(stage).summary)
