"""A parameter table whose texts are prepared by row and column, and a box that offers stages."""

from collections.abc import Callable, Mapping, Sequence

from PySide6.QtCore import QSignalBlocker
from PySide6.QtWidgets import QComboBox

from calstation.gui.text import on_language_change, term
from calstation.gui.widgets import Column, ParameterModel, ParameterTable, Words, theme
from calstation.physics import aligned

#: Height of a row, px.
ROW = 26

#: Texts by column's key, of each row by its name.
Cells = dict[str, dict[str, str]]


class CellTable(ParameterTable):
    """Shows `cells`; a missing text is a dash."""

    def __init__(self, name: str, *, grouped: bool = False) -> None:
        self.cells: Cells = {}
        self._columns_model = ParameterModel((), grouped=grouped)
        super().__init__(self._columns_model)
        self.setObjectName(name)
        self.verticalHeader().setDefaultSectionSize(ROW)

    def set_columns(self, columns: Sequence[Column]) -> None:
        """Show these columns."""
        self._columns_model.set_columns(columns)

    def column(
        self,
        heading: Words,
        key: str,
        *,
        number: bool = True,
        hint: Callable[[str], str] | None = None,
    ) -> Column:
        """A column of the texts of a key."""
        return Column(heading, lambda name: self.cells[name].get(key, "–"), number, hint=hint)

    def show_cells(self, cells: Mapping[str, dict[str, str]], numbers: Sequence[str] = ()) -> None:
        """Show these rows; the points of the columns `numbers` line up."""
        self.cells = dict(cells)
        for key in numbers:
            present = [texts for texts in self.cells.values() if key in texts]
            for texts, text in zip(present, aligned([texts[key] for texts in present]), strict=True):
                texts[key] = text
        self._columns_model.set_names(list(self.cells))

    def refresh(self) -> None:
        """Show all texts again."""
        self._columns_model.refresh()


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
