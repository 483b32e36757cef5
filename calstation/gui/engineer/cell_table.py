"""A parameter table whose texts are prepared by row and column."""

from collections.abc import Callable, Mapping, Sequence

from calstation.gui.widgets import Column, ParameterModel, ParameterTable, Words
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
