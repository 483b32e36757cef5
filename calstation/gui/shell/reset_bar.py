"""Resets what the table has latched, on an operator's press and never otherwise, and tells what came of it."""

from collections.abc import Callable

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QHBoxLayout, QLabel, QPushButton, QSizePolicy, QVBoxLayout, QWidget

from calstation.connection.link_test import LinkTestRequest
from calstation.connection.table_reset import TableReset, reset_table
from calstation.errors import CalstationError
from calstation.gui.shell.context import AppContext
from calstation.gui.text.fault_wording import phrase, word_fault
from calstation.gui.widgets import theme
from calstation.gui.widgets.badge import StateIcon
from calstation.gui.widgets.jobs import JobWatch


class ResetBar(QWidget):
    """The button, and the last reset's result beside it. Its owner retranslates it.

    Parameters
    ----------
    order : the station whose table it is, asked when the button is pressed; None where there is none
    name : object name of the button

    `changed()` : a reset has begun or ended; `ended(result)` with the `TableReset`
    """

    changed = Signal()
    ended = Signal(object)

    def __init__(self, app: AppContext, order: Callable[[], LinkTestRequest | None], name: str) -> None:
        super().__init__()
        self._app, self._order = app, order
        self._offered = False
        self.result: TableReset | None = None
        self._error = ""
        self.button = QPushButton()
        self.button.setObjectName(name)
        self.button.setSizePolicy(QSizePolicy.Policy.Maximum, QSizePolicy.Policy.Fixed)
        self.button.clicked.connect(self._start)
        self._icon, self.words = StateIcon(18), QLabel()
        self.words.setObjectName(f"{name}_result")
        self.words.setWordWrap(True)
        self.watch = JobWatch(self)
        self.watch.done.connect(self._done)
        self.watch.failed.connect(self._failed)
        self.watch.cancelled.connect(self._given_up)
        told = QHBoxLayout()
        told.setSpacing(theme.GRID)
        told.addWidget(self._icon)
        told.addWidget(self.words, 1)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(theme.GRID)
        column.addWidget(self.button)
        column.addLayout(told)
        app.engine_link.running_changed.connect(self._running_changed)
        self.retranslate()

    def offer(self, offered: bool) -> None:
        """Offer the reset, or no longer; what the last one said stays."""
        self._offered = offered
        self._show()

    def forget(self) -> None:
        """What the last reset said is of no interest any more."""
        self.result, self._error = None, ""
        self._show()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self.button.setText(self.tr("Reset the fault"))
        self._show()

    def _start(self) -> None:
        self.forget()
        try:
            order = self._order()
        except CalstationError as error:
            self._failed(str(error))
            return
        if order is None or self._app.engine_link.running or self.watch.busy:
            return
        self.watch.watch(self._app.job_queue.submit(reset_table, order, cancellable=False))
        self._show()
        self.changed.emit()

    def _running_changed(self, running: bool) -> None:
        """A reset that still waits in line must not come in the middle of a run."""
        if running:
            self.watch.cancel()
        self._show()

    def _done(self, result: TableReset) -> None:
        self.result = result
        self._offered = not result.clear
        self._show()
        self.changed.emit()
        self.ended.emit(result)

    def _failed(self, sentence: str) -> None:
        self._error = sentence
        self._show()
        self.changed.emit()

    def _given_up(self) -> None:
        self._show()
        self.changed.emit()

    def _show(self) -> None:
        running = self._app.engine_link.running
        self.button.setVisible(self._offered)
        self.button.setEnabled(not (running or self.watch.busy))
        self.button.setToolTip(
            self.tr("A run is going on; reset when it has ended.")
            if running
            else self.tr("Clears what the table has latched. Nothing moves and no axis is switched on.")
        )
        kind, text = self._words()
        self._icon.setVisible(bool(kind))
        if kind:
            self._icon.set_kind(kind)
        self.words.setText(text)
        self.words.setVisible(bool(text))
        self.setVisible(self._offered or bool(text))

    def _words(self) -> tuple[str, str]:
        """State and sentence of the last reset, or of the one that is going on."""
        if self.watch.busy:
            return "", self.tr("Asking the table.")
        if self._error:
            told = word_fault("DeviceFaultError", self._error)
            return "bad", f"{told.reason} {told.mend}".strip()
        result = self.result
        if result is None:
            return "", ""
        sentence = {
            "nothing": self.tr("No fault is latched."),
            "cleared": self.tr("The fault “{latched}” was reset; nothing is latched now."),
            "interlock_open": self.tr(
                "Not reset: the interlock is open. Close the cover, then press again (latched: “{latched}”)."
            ),
            "moving": self.tr(
                "Not reset: the table still turns. Wait until it rests, then press again (latched: “{latched}”)."
            ),
            "local_control": self.tr(
                "Not reset: the table is under local control. Switch it to remote control at its panel."
            ),
            "refused": self.tr(
                "The table refuses the reset of “{latched}” ({words}). Remove the cause first."
            ),
            "stays": self.tr(
                "“{latched}” was reset, but “{left}” is there now: its cause is still there. Remove it first."
            ),
        }[result.outcome]
        values = {
            "latched": phrase(result.latched or ""),
            "left": phrase(result.left or ""),
            "words": word_fault("DeviceFaultError", result.words).reason,
        }
        return ("good" if result.clear else "bad"), sentence.format(**values)
