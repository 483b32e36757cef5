"""Which of a log's stages to solve."""

from PySide6.QtCore import QEvent, Signal
from PySide6.QtWidgets import QCheckBox, QGridLayout, QWidget

from calstation.gui.text import term
from calstation.gui.widgets import theme
from calstation.results.plots import LogIndex

_COLUMNS = 4


class StageChoice(QWidget):
    """One box per stage of the log; those without a sample in the range say so and cannot be ticked.

    `changed()`: another choice was made.
    """

    changed = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._grid = QGridLayout(self)
        self._grid.setContentsMargins(0, 0, 0, 0)
        self._grid.setHorizontalSpacing(2 * theme.GRID)
        self._grid.setVerticalSpacing(0)
        self._grid.setColumnStretch(_COLUMNS, 1)
        self._log_index: LogIndex | None = None
        self._boxes: dict[str, QCheckBox] = {}
        self._range = (0, 0)

    def show_log(self, log_index: LogIndex) -> None:
        """Offer a log's stages, all ticked."""
        self._log_index = log_index
        for box in self._boxes.values():
            self._grid.removeWidget(box)
            box.deleteLater()
        self._boxes = {}
        for stage in dict.fromkeys(span.stage for span in log_index.spans):
            box = QCheckBox()
            box.setObjectName(f"offline_stage_check_{stage}")
            box.setMinimumHeight(4 * theme.GRID)
            box.setChecked(True)
            box.toggled.connect(self.changed)
            self._grid.addWidget(box, *divmod(len(self._boxes), _COLUMNS))
            self._boxes[stage] = box
        self.set_range(log_index.facts.first_seq, log_index.facts.last_seq)

    def set_range(self, first: int, last: int) -> None:
        """Take the range into account."""
        self._range = (first, last)
        for stage, box in self._boxes.items():
            box.setEnabled(stage in self.held)
        self.retranslate()

    @property
    def held(self) -> tuple[str, ...]:
        """Stages with a sample in the range, in the log's order."""
        if self._log_index is None:
            return ()
        spans = self._log_index.spans
        return tuple(dict.fromkeys(s.stage for s in spans if s.within(*self._range)))

    @property
    def stages(self) -> tuple[str, ...]:
        """Stages to solve, in the log's order."""
        return tuple(stage for stage in self.held if self._boxes[stage].isChecked())

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        held = self.held
        for stage, box in self._boxes.items():
            box.setText(term("stage", stage))
            box.setToolTip("" if stage in held else self.tr("The range holds no sample of this stage"))

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)
