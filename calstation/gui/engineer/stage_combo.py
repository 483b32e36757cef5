"""A box that offers stages by their names."""

from collections.abc import Sequence

from PySide6.QtCore import QSignalBlocker
from PySide6.QtWidgets import QComboBox

from calstation.gui.text import on_language_change, term
from calstation.gui.widgets import theme


class StageCombo(QComboBox):
    """Its signal `currentIndexChanged` is emitted only by the user's choice."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.setObjectName(name)
        self.setMinimumWidth(22 * theme.GRID)
        on_language_change(self, self._show_names)

    @property
    def stage(self) -> str:
        """The stage chosen, "" without any."""
        return str(self.currentData() or "")

    def offer(self, stages: Sequence[str], chosen: str = "") -> None:
        """Offer stages and choose one, the first by default."""
        with QSignalBlocker(self):
            self.clear()
            for stage in stages:
                self.addItem(term("stage", stage), stage)
            self.setCurrentIndex(max(self.findData(chosen), 0))

    def _show_names(self) -> None:
        for index in range(self.count()):
            self.setItemText(index, term("stage", self.itemData(index)))
