"""A parameter table whose texts are prepared by row and column, and a box that offers stages."""

from collections.abc import Callable, Mapping, Sequence

from PySide6.QtCore import QSignalBlocker
from PySide6.QtWidgets import QComboBox

from calstation.gui.text import on_language_change, term
from calstation.gui.widgets import Column, ParameterModel, ParameterTable, Words, align_columns, theme

#: Height of a row, px.
ROW = 26


class CellTable(ParameterTable):
    """Shows `cells`, texts by row and key of the column; a missing text is a dash."""

    def __init__(self, name: str, *, grouped: bool = False) -> None:
        self.cells: dict[str, dict[str, str]] = {}
        self.parameters = ParameterModel((), grouped=grouped)
        super().__init__(self.parameters)
        self.setObjectName(name)
        self.verticalHeader().setDefaultSectionSize(ROW)

    def column(
        self, heading: Words, key: str, *, number: bool = True, hint: Callable[[str], str] | None = None
    ) -> Column:
        """A column of the texts of a key."""
        return Column(heading, lambda name: self.cells[name].get(key, "–"), number, hint=hint)

    def show_cells(self, cells: Mapping[str, dict[str, str]], numbers: Sequence[str] = ()) -> None:
        """Show these rows; the points of the columns `numbers` line up."""
        self.cells = dict(cells)
        align_columns(self.cells, numbers)
        self.parameters.set_names(list(self.cells))


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
