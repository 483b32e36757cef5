"""The effect that is missing in a result's error model, and the button that adds it and solves the log again."""

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QWidget

from calstation.gui.text import on_language_change, say
from calstation.gui.widgets.jobs import JobRow, JobStack, JobWatch
from calstation.gui.widgets.layout import button, label, row
from calstation.judgement import Check
from calstation.results import Result


class MissingState(QWidget):
    """Shown next to a result only if one of its failed checks names such an effect; `wanted(name)` asks to add it.

    The jobs of `watch` replace the button while they run.
    """

    wanted = Signal(str)

    def __init__(self, watch: JobWatch, name: str) -> None:
        super().__init__()
        self._check: Check | None = None
        self._about = label(wrap=True)
        add = button(name, "common.add_state", self._add, tip="common.add_state_tip")
        jobs = JobStack(add, JobRow(watch, f"{name}_cancel"))
        row((self._about, 2), (jobs, 1), on=self)
        self.hide()
        on_language_change(self, self._refresh)

    def show_result(self, result: Result | None) -> None:
        """Show the effect that is missing in a result's model, if any."""
        self._check = None if result is None else result.missing_state
        self.setVisible(self._check is not None)
        self._refresh()

    def _add(self) -> None:
        assert self._check is not None
        assert self._check.diagnosis is not None
        self.wanted.emit(self._check.diagnosis.cause)

    def _refresh(self) -> None:
        cause = None if self._check is None else self._check.cause_text
        self._about.setText("" if cause is None else say(cause))
