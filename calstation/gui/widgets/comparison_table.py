"""Table that compares sets of parameters side by side, with their differences from the first in sigmas."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from calstation.gui.text import Words
from calstation.gui.widgets.parameter_table import (
    NOTABLE_SIGMAS,
    Column,
    ParameterModel,
    ParameterTable,
    align_columns,
    ordered,
)
from calstation.physics import display, number
from calstation.results import Parameter, in_sigma

_NONE = "–"

#: Function that returns the symbol of a parameter's cell, or None.
State = Callable[[str], str | None] | None


@dataclass(frozen=True)
class Compared:
    """A set of parameters, its heading, and the symbols of its values and sigmas."""

    heading: Words
    parameters: Mapping[str, Parameter]
    value_state: State = None
    sigma_state: State = None
    marked: bool = True  #: Whether notable differences from the first set are marked.


class ComparisonTable(ParameterTable):
    """Shows value and sigma of every parameter in each set, and the difference from the first set in sigmas.

    The sets are estimates from `independent` data, or else from the same data, see `in_sigma`; with `differences`, the
    differences themselves are shown too.
    """

    def __init__(self, *, independent: bool, differences: bool = False) -> None:
        super().__init__(ParameterModel(()))
        self._independent, self._differences = independent, differences
        self._cells: dict[str, dict[str, str]] = {}
        self.names: list[str] = []
        #: Difference from the first set in sigmas by parameter, for each further set.
        self.in_sigma: list[dict[str, float]] = []

    def show_sets(self, sets: Sequence[Compared]) -> None:
        """Show these sets; the first is the reference."""
        self.names = ordered({name: None for each in sets for name in each.parameters})
        first = sets[0].parameters
        self.in_sigma = [
            {
                name: in_sigma(row, first[name], independent=self._independent)
                for name, row in each.parameters.items()
                if name in first
            }
            for each in sets[1:]
        ]
        self._cells = {name: {"unit": display(name, 0.0)[1]} for name in self.names}
        for k, each in enumerate(sets):
            for name, row in each.parameters.items():
                self._cells[name] |= self._texts(name, row, first.get(name) if k else None, k)
        keys = dict.fromkeys(key for cells in self._cells.values() for key in cells if not key.startswith("in_sigma"))
        align_columns(self._cells, [key for key in keys if key != "unit"])
        columns = [Column("common.unit_column", self._text("unit"), number=False)]
        for k, each in enumerate(sets):
            columns += self._columns(k, each)
        self.parameters.show(columns, self.names)

    def _columns(self, k: int, shown: Compared) -> list[Column]:
        columns = [
            Column(shown.heading, self._text(f"value{k}"), state=shown.value_state),
            Column("common.plus_minus", self._text(f"sigma{k}"), state=shown.sigma_state),
        ]
        if k and self._differences:
            columns.append(Column("common.difference_column", self._text(f"difference{k}")))
        if k:
            columns.append(
                Column("common.in_sigma", self._text(f"in_sigma{k}"), state=self._notable(k) if shown.marked else None)
            )
        return columns

    def _text(self, key: str) -> Callable[[str], str]:
        return lambda name: self._cells[name].get(key, _NONE)

    def _notable(self, k: int) -> State:
        return lambda name: "caution" if abs(self.in_sigma[k - 1].get(name, 0.0)) > NOTABLE_SIGMAS else None

    def _texts(self, name: str, row: Parameter, reference: Parameter | None, k: int) -> dict[str, str]:
        """Return the cells of a parameter in a set, each with as many digits as its sigma justifies."""
        value, sigma = display(name, row.value)[0], display(name, row.sigma)[0]
        cells = {f"value{k}": number(value, sigma), f"sigma{k}": number(sigma, sigma)}
        if reference is not None:
            larger = display(name, max(row.sigma, reference.sigma))[0]
            difference = display(name, row.value - reference.value)[0]
            same = row.value == reference.value
            cells[f"difference{k}"] = "0" if same else number(difference, larger)
            cells[f"in_sigma{k}"] = "0" if same else f"{self.in_sigma[k - 1][name]:+.2f}"
        return cells
