"""State, stage, progress and time left in one line beside STOP, for pages without a header of their own."""

from PySide6.QtWidgets import QGridLayout, QLabel, QProgressBar, QWidget

from calstation.gui.shell.run_status import RunStatus
from calstation.gui.text import KINDS, duration_text, on_language_change, term
from calstation.gui.widgets import StateBadge, theme


class RunStrip(QWidget):
    """Follows the run."""

    def __init__(self, run: RunStatus, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._run = run
        self._badge = StateBadge(theme.SECTION)
        self._text = QLabel()
        self._bar = QProgressBar()
        self._bar.setRange(0, 1000)
        self._bar.setTextVisible(False)
        self._bar.setFixedHeight(theme.GRID)
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, theme.GRID, 0)
        grid.setHorizontalSpacing(2 * theme.GRID)
        grid.addWidget(self._badge, 0, 0)
        grid.addWidget(self._text, 0, 1)
        grid.addWidget(self._bar, 1, 0, 1, 2)
        grid.setColumnStretch(1, 1)
        run.changed.connect(self._refresh)
        on_language_change(self, self._refresh)

    def _refresh(self) -> None:
        run = self._run
        words = term("badge", run.shown)
        if run.ended or run.fault is not None:  # nothing else on the page names the unit
            words = f"{run.serial}  ·  {words}"
        self._badge.show_state(KINDS.get(run.shown, "none"), words)
        parts = []
        if run.stage is not None:
            parts.append(term("stage", run.stage.name))
            parts.append(f"{100.0 * run.stage.fraction:.0f} %")
        if run.remaining is not None:
            parts.append(self.tr("{time} left").format(time=duration_text(run.remaining)))
        self._text.setText("  ·  ".join(parts))
        self._bar.setVisible(run.going)
        self._bar.setValue(round(1000 * run.fraction))
