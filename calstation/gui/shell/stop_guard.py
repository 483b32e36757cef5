"""STOP while a dialog or a popup receives the keys and clicks."""

from PySide6.QtCore import QEvent, QObject, QPoint, QRect, Qt
from PySide6.QtGui import QGuiApplication, QKeyEvent, QMouseEvent, QWindow
from PySide6.QtWidgets import QApplication, QPushButton

from calstation.gui.state import RunStatus


class StopGuard(QObject):
    """Stops a run in progress on Esc in any window of the program, and on a click on STOP while a popup is open.

    The first Esc stops the run, and the next one closes the dialog or popup. The guard filters the events of each
    QWindow, because a popup receives all keys and the first click outside it, and because a QWindow has few events.
    """

    def __init__(self, run: RunStatus, stop_button: QPushButton) -> None:
        super().__init__(stop_button)
        self._run, self._stop_button = run, stop_button
        application = QApplication.instance()
        if isinstance(application, QGuiApplication):
            application.focusWindowChanged.connect(self._watch)

    def _watch(self, window: QWindow | None) -> None:
        if window is not None:
            window.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Stop the run; the key then has no other effect."""
        if not self._run.in_progress or self._run.state == "stopping":
            return False
        if isinstance(event, QKeyEvent) and event.key() == Qt.Key.Key_Escape:
            if event.type() == QEvent.Type.KeyPress:
                self._run.stop()
            event.accept()  # so that no shortcut handles the key
            return event.type() != QEvent.Type.KeyRelease
        if isinstance(event, QMouseEvent) and event.type() == QEvent.Type.MouseButtonPress:
            popup, at = QApplication.activePopupWidget(), event.globalPosition().toPoint()
            stop = QRect(self._stop_button.mapToGlobal(QPoint(0, 0)), self._stop_button.size())
            if popup is not None and stop.contains(at) and not popup.geometry().contains(at):
                self._run.stop()
        return False
