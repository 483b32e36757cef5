"""The table of a method's parameters: value, sigma, previous value, and other values for comparison."""

from calstation.gui.text import on_language_change, say, sigmas_text, with_minus
from calstation.gui.widgets import NOTABLE_SIGMAS, Cell, CellTable, DataView, ordered, theme
from calstation.physics import display, number
from calstation.results import Parameter
from calstation.results.plots import GimbalPlotData, MethodSolution

_NUMBERS = ("value", "sigma", "before", "before_sigma", "other", "other_sigma", "apart", "truth", "truth_in_sigma")
_SOLVED = (
    Cell("common.unit_column", "unit", number=False),
    Cell("logs.found", "value", state="value_state"),
    Cell("common.plus_minus_sigma", "sigma", state="sigma_state", hint="sigma_hint"),
)
_LEAST_SQUARES = (
    Cell("logs.least_squares", "other"),
    Cell("common.plus_minus_sigma", "other_sigma"),
    Cell("logs.difference", "apart"),
    Cell("common.in_sigma", "other_in_sigma", state="other_state"),
)
_TRUTH = (
    Cell("logs.bench_truth", "truth"),
    Cell("logs.error_in_sigma", "truth_in_sigma", state="truth_state"),
)


class SolutionTable(CellTable, DataView[MethodSolution]):
    """A table of the estimated parameters with their sigmas, and of the values before the calibration.

    For a gimbal, it contains the least-squares solution instead of the values before; for a recording of the virtual
    bench, it also contains the true values.
    """

    def __init__(self) -> None:
        super().__init__("method_table", "logs.parameters_found", grouped=True, row=4 * theme.GRID)
        on_language_change(self, self.refresh)

    def draw(self, solution: MethodSolution) -> None:
        """Show the parameters of a solution."""
        result, truth = solution.resolved.result, solution.recording.truth
        other = solution.plot_data.least_squares if isinstance(solution.plot_data, GimbalPlotData) else {}
        outside = {check.subject for check in result.failed_checks}
        cells = {}
        for name in ordered(result.parameters):
            row = result.parameters[name]
            cells[name] = _cells(name, row, solution.before.get(name), other.get(name), truth.get(name))
            if name in outside:
                cells[name]["value_state"] = "bad"
            if name in result.undetermined:
                cells[name] |= {"sigma_state": "caution", "sigma_hint": say("logs.parameter_lost")}
        columns = [*_SOLVED]
        if other:
            columns += _LEAST_SQUARES
        else:
            columns.append(Cell("logs.before", "before"))
            if any("before_sigma" in row for row in cells.values()):
                columns.append(Cell("common.plus_minus_sigma", "before_sigma"))
        self.show_cells(cells, _NUMBERS, [*columns, *(_TRUTH if truth else ())])


def _cells(
    name: str,
    row: Parameter,
    before: tuple[float, float | None] | None,
    other: tuple[float, float] | None,
    truth: float | None,
) -> dict[str, str]:
    """Return the cells of a parameter, each with as many digits as its sigma justifies."""
    sigma, unit = display(name, row.sigma)
    value = display(name, row.value)[0]
    cells = {"unit": unit if unit != "1" else "", "value": _signed(value, sigma), "sigma": number(sigma, sigma)}
    if before is not None:
        previous, previous_sigma = display(name, before[0])[0], before[1]
        if previous_sigma is None:
            cells["before"] = _signed(previous, sigma)
        else:
            shown = display(name, previous_sigma)[0]
            cells |= {"before": _signed(previous, shown), "before_sigma": number(shown, shown)}
    if other is not None:
        least, least_sigma = (display(name, each)[0] for each in other)
        cells |= {
            "other": _signed(least, least_sigma),
            "other_sigma": number(least_sigma, least_sigma),
            "apart": _signed(value - least, sigma),
            **_in_sigma("other", row.value - other[0], max(row.sigma, other[1])),
        }
    if truth is not None:
        cells |= {"truth": _signed(display(name, truth)[0], sigma), **_in_sigma("truth", row.value - truth, row.sigma)}
    return cells


def _in_sigma(kind: str, difference: float, sigma: float) -> dict[str, str]:
    """Return the cell for a difference in sigmas, and the symbol of the difference."""
    sigmas = difference / max(sigma, 1e-300)
    state = "caution" if abs(sigmas) > NOTABLE_SIGMAS else ""
    return {f"{kind}_in_sigma": with_minus(sigmas_text(sigmas)), f"{kind}_state": state}


def _signed(value: float, sigma: float) -> str:
    return with_minus(number(value, sigma))
