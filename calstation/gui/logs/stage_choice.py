"""Chooses which of a log's stages to solve."""

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QCheckBox, QGridLayout, QWidget

from calstation.gui.text import on_language_change, term
from calstation.gui.widgets import enable, theme
from calstation.results.plots import StageSpan

_COLUMNS = 4


class StageChoice(QWidget):
    """One box per stage of the log, disabled without a sample in the range. `changed()`: another choice was made."""

    changed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self._grid = QGridLayout(self)
        self._grid.setContentsMargins(0, 0, 0, 0)
        self._grid.setHorizontalSpacing(2 * theme.GRID)
        self._grid.setVerticalSpacing(0)
        self._grid.setColumnStretch(_COLUMNS, 1)
        self._spans: tuple[StageSpan, ...] = ()
        self._boxes: dict[str, QCheckBox] = {}
        self._range = (0, 0)
        on_language_change(self, self._refresh)

    def show_stages(self, spans: tuple[StageSpan, ...]) -> None:
        """Offer a log's stages, all ticked."""
        self._spans = spans
        for box in self._boxes.values():
            self._grid.removeWidget(box)
            box.deleteLater()
        self._boxes = {}
        for stage in dict.fromkeys(span.stage for span in spans):
            box = QCheckBox()
            box.setObjectName(f"offline_stage_check_{stage}")
            box.setMinimumHeight(4 * theme.GRID)
            box.setChecked(True)
            box.toggled.connect(self.changed)
            self._grid.addWidget(box, *divmod(len(self._boxes), _COLUMNS))
            self._boxes[stage] = box

    def set_range(self, first: int, last: int) -> None:
        """Disable the stages outside a range of sequence numbers."""
        self._range = (first, last)
        self._refresh()

    @property
    def in_range(self) -> tuple[str, ...]:
        """Stages with a sample in the range, in the log's order."""
        return tuple(dict.fromkeys(s.stage for s in self._spans if s.within(*self._range)))

    @property
    def chosen(self) -> tuple[str, ...]:
        """Stages to solve, in the log's order."""
        return tuple(stage for stage in self.in_range if self._boxes[stage].isChecked())

    def _refresh(self) -> None:
        for stage, box in self._boxes.items():
            box.setText(term("stage", stage))
            enable(box, "" if stage in self.in_range else self.tr("The range holds no sample of this stage"))
