"""Views of results: checks, parameters side by side, and an effect that is missing from the error model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QWidget

from calstation.gui.text import Words, check_text, on_language_change, say, sigmas_text
from calstation.gui.widgets import theme
from calstation.gui.widgets.jobs import JobRow, JobStack, JobWatch
from calstation.gui.widgets.layout import button, label, row
from calstation.gui.widgets.parameter_table import NOTABLE_SIGMAS, Cell, CellTable, ordered
from calstation.judgement import Check
from calstation.physics import display, number
from calstation.results import Parameter, Result, in_sigma

_ROW = 28
_ORDER = {"bad": 0, "caution": 1, "good": 2}
_COLUMNS = (
    Cell("common.check", "sentence", number=False, hint="about"),
    Cell("common.where", "where", number=False),
    Cell("common.unit", "unit", number=False),
    Cell("common.value", "value"),
    Cell("common.limit", "limit"),
    Cell("common.margin", "margin"),
    Cell("common.verdict", "verdict", number=False, state="state"),
)


class ChecksTable(CellTable):
    """A table of checks: failed checks, then near misses, then the others, each in the order of the result."""

    def __init__(self) -> None:
        self._checks: Sequence[Check] = ()
        super().__init__("checks_table", "common.checks_of_result", _COLUMNS, named=False, row=_ROW)
        on_language_change(self, self._refresh)

    def show_checks(self, checks: Sequence[Check]) -> None:
        """Show these checks."""
        self._checks = sorted(checks, key=lambda check: _ORDER[check_text(check).state])
        self._refresh()

    def height_of_rows(self) -> int:
        """Return the height at which all rows are visible, px."""
        return self.horizontalHeader().sizeHint().height() + _ROW * len(self._checks) + theme.GRID

    def _refresh(self) -> None:
        self.show_cells({str(k): dict(vars(check_text(check))) for k, check in enumerate(self._checks)})


@dataclass(frozen=True)
class ParameterSet:
    """A set of parameters to compare, with its heading and the symbols of the values and sigmas."""

    heading: Words
    parameters: Mapping[str, Parameter]
    value_state: Mapping[str, str] = field(default_factory=dict)
    sigma_state: Mapping[str, str] = field(default_factory=dict)
    marked: bool = True  #: Whether notable differences from the first set are marked.


class ComparisonTable(CellTable):
    """A table of values and sigmas of parameters in several sets, with the difference from the first set in sigmas.

    Parameters
    ----------
    name, words
        Object name and accessible name.
    independent
        Whether the sets are estimated from independent data instead of the same data; see `in_sigma`.
    differences
        Whether the differences are also shown in the unit of the parameter.
    """

    def __init__(self, name: str, words: Words, *, independent: bool, differences: bool = False) -> None:
        super().__init__(name, words, grouped=True, row=4 * theme.GRID)
        self._independent, self._differences = independent, differences
        self.names: list[str] = []
        #: For each further set, the difference from the first set in sigmas, by parameter.
        self.in_sigma: list[dict[str, float]] = []

    def show_sets(self, sets: Sequence[ParameterSet]) -> None:
        """Show these sets of parameters; the first is the reference."""
        self.names = ordered({name: None for each in sets for name in each.parameters})
        first = sets[0].parameters
        self.in_sigma = [
            {
                name: in_sigma(new, first[name], independent=self._independent)
                for name, new in each.parameters.items()
                if name in first
            }
            for each in sets[1:]
        ]
        cells = {name: {"unit": display(name, 0.0)[1]} for name in self.names}
        for k, each in enumerate(sets):
            for name, new in each.parameters.items():
                cells[name] |= self._texts(name, new, first.get(name) if k else None, k, each)
        columns = [Cell("common.unit_column", "unit", number=False)]
        for k, each in enumerate(sets):
            columns.append(Cell(each.heading, f"value{k}", state=f"value_state{k}"))
            columns.append(Cell("common.plus_minus", f"sigma{k}", state=f"sigma_state{k}"))
            if k and self._differences:
                columns.append(Cell("common.difference_column", f"difference{k}"))
            if k:
                columns.append(Cell("common.in_sigma", f"in_sigma{k}", state=f"notable{k}"))
        self.show_cells(cells, [each.key for each in columns[1:] if not each.key.startswith("in_sigma")], columns)

    def _texts(
        self, name: str, new: Parameter, reference: Parameter | None, k: int, group: ParameterSet
    ) -> dict[str, str]:
        """Return the cells of a parameter in a set, each with as many digits as its sigma justifies."""
        value, sigma = display(name, new.value)[0], display(name, new.sigma)[0]
        cells = {
            f"value{k}": number(value, sigma),
            f"sigma{k}": number(sigma, sigma),
            f"value_state{k}": group.value_state.get(name, ""),
            f"sigma_state{k}": group.sigma_state.get(name, ""),
        }
        if reference is not None:
            larger = display(name, max(new.sigma, reference.sigma))[0]
            difference = display(name, new.value - reference.value)[0]
            same, sigmas = new.value == reference.value, self.in_sigma[k - 1][name]
            cells[f"difference{k}"] = "0" if same else number(difference, larger)
            cells[f"in_sigma{k}"] = "0" if same else sigmas_text(sigmas)
            cells[f"notable{k}"] = "caution" if group.marked and abs(sigmas) > NOTABLE_SIGMAS else ""
        return cells


class MissingEffect(QWidget):
    """A row for an effect that is missing from the error model, whose button emits `requested(effect)`.

    The row is hidden if no failed check reports such an effect. While the job of `watch` runs, its progress replaces
    the button.
    """

    requested = Signal(str)

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
        """Show the effect that is missing from the error model of a result, if any."""
        self._check = None if result is None else result.missing_state
        self.setVisible(self._check is not None)
        self._refresh()

    def _add(self) -> None:
        if self._check is not None and self._check.diagnosis is not None:
            self.requested.emit(self._check.diagnosis.cause)

    def _refresh(self) -> None:
        cause = None if self._check is None else self._check.cause_text
        self._about.setText("" if cause is None else say(cause))
