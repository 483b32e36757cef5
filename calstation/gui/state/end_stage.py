"""Button that ends a repeated stage: the run solves the recorded data and continues with the next stage."""

from collections.abc import Callable

from PySide6.QtWidgets import QPushButton

from calstation.gui.state.run_status import RunStatus
from calstation.gui.text import bind, on_language_change, say, term
from calstation.gui.widgets import enable


class EndStageButton(QPushButton):
    """Ends the current stage of the run after its current move; shown during a run, on some pages only if `allowed`."""

    def __init__(self, run: RunStatus, name: str, allowed: Callable[[], bool] = lambda: True) -> None:
        super().__init__()
        self._run, self._allowed = run, allowed
        self.setObjectName(name)
        self.setVisible(False)
        bind(self, "window.end_stage")
        self.clicked.connect(run.end_stage)
        run.changed.connect(self._refresh)
        on_language_change(self, self._refresh)

    def _refresh(self) -> None:
        why_not = self._run.why_not_end_stage
        run = self._run
        self.setVisible(run.going and not run.register_operation and not run.by_hand and self._allowed())
        enable(self, term("end_stage", why_not) if why_not else "", say("window.end_stage_tip"))
