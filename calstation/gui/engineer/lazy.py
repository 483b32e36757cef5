"""A view that says what will be in it until there is something, and how its work gets on meanwhile."""

from PySide6.QtCore import QEvent
from PySide6.QtWidgets import QStackedWidget, QVBoxLayout, QWidget

from calstation.gui.widgets import theme
from calstation.gui.widgets.jobs import JobRow, JobWatch
from calstation.gui.widgets.labels import EmptyState


class LazyView(QStackedWidget):
    """Empty, at work, or the view itself."""

    def __init__(self, view: QWidget, watch: JobWatch | None = None, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.view = view
        self._error = ""
        self._empty = EmptyState()
        self.addWidget(self._empty)
        self.addWidget(view)
        if watch is not None:
            work = QWidget()
            column = QVBoxLayout(work)
            column.setContentsMargins(8 * theme.GRID, 0, 8 * theme.GRID, 0)
            self._working = EmptyState()
            column.addWidget(self._working, 1)
            column.addWidget(JobRow(watch))
            column.addStretch(1)
            self.addWidget(work)
        self.retranslate()

    def show_view(self) -> None:
        """There is something to see."""
        self.setCurrentIndex(1)

    def show_work(self) -> None:
        """It is being made."""
        self.setCurrentIndex(2)

    def show_empty(self, error: str = "") -> None:
        """Nothing to see, because of `error` where there is one."""
        self._error = error
        self.retranslate()
        self.setCurrentIndex(0)

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        if self._error:
            self._empty.say(self.tr("Nothing to show of this run"), self._error)
        else:
            self._empty.say(
                self.tr("No run opened yet"),
                self.tr("Finish a run, open a result or a log here, or choose a run on the History page."),
            )
        if self.count() > 2:
            self._working.say(
                self.tr("Solving the log once more"),
                self.tr("Innovations and residuals are made from the log, not stored with the result."),
            )

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)
