"""Table of a method's parameters: value, sigma, previous value, and other values for comparison."""

from collections.abc import Callable

from calstation.gui.text import bind, say, with_minus
from calstation.gui.widgets import NOTABLE_SIGMAS, Column, ParameterModel, ParameterTable, align_columns, ordered
from calstation.physics import display, number
from calstation.results import Parameter
from calstation.results.plots import GimbalPlotData, MethodAnswer

_NONE = "–"
_NUMBERS = ("value", "sigma", "before", "before_sigma", "other", "other_sigma", "apart", "truth", "truth_in_sigma")


class AnswerTable(ParameterTable):
    """Table of the estimated parameters, with their contract names as row headers.

    In addition to value and sigma it shows the previous value, or the least-squares solution for a gimbal, and the true
    value for a recording of the virtual bench.
    """

    def __init__(self) -> None:
        self._parameters = ParameterModel(())
        super().__init__(self._parameters)
        self.setObjectName("method_table")
        self._cells: dict[str, dict[str, str]] = {}
        self._in_sigma: dict[str, dict[str, float]] = {}
        self._unobservable: frozenset[str] = frozenset()
        self._outside: frozenset[str] = frozenset()
        bind(self.setAccessibleName, "logs.parameters_found")

    def show_answer(self, answer: MethodAnswer) -> None:
        """Show the parameters of a solution."""
        result, truth = answer.resolved.result, answer.recording.truth
        other = answer.picture.least_squares if isinstance(answer.picture, GimbalPlotData) else {}
        self._in_sigma, self._cells = {}, {}
        for name in ordered(result.parameters):
            row = result.parameters[name]
            self._in_sigma[name] = _in_sigma(row, other.get(name), truth.get(name))
            self._cells[name] = _cells(name, row, answer.before.get(name), other.get(name), truth.get(name))
            for column, sigmas in self._in_sigma[name].items():
                self._cells[name][column] = with_minus(f"{sigmas:+.2f}")
        align_columns(self._cells, _NUMBERS)
        self._unobservable = frozenset(result.undetermined)
        self._outside = frozenset(check.subject for check in result.failed_checks)
        self._parameters.show(self._columns(bool(other), bool(truth)), list(self._cells))

    def _columns(self, other: bool, truth: bool) -> list[Column]:
        columns = [
            Column("common.unit_column", self._text("unit"), number=False),
            Column("logs.found", self._text("value"), state=self._value_state),
            Column("common.plus_minus_sigma", self._text("sigma"), state=self._sigma_state, hint=self._sigma_hint),
        ]
        if other:
            columns += [
                Column("logs.least_squares", self._text("other")),
                Column("common.plus_minus_sigma", self._text("other_sigma")),
                Column("logs.difference", self._text("apart")),
                Column("logs.in_sigma", self._text("other_in_sigma"), state=self._state("other_in_sigma")),
            ]
        else:
            columns.append(Column("logs.before", self._text("before")))
            if any("before_sigma" in cells for cells in self._cells.values()):
                columns.append(Column("common.plus_minus_sigma", self._text("before_sigma")))
        if truth:
            columns += [
                Column("logs.bench_truth", self._text("truth")),
                Column("logs.error_in_sigma", self._text("truth_in_sigma"), state=self._state("truth_in_sigma")),
            ]
        return columns

    def _text(self, column: str) -> Callable[[str], str]:
        return lambda name: self._cells[name].get(column, _NONE)

    def _state(self, column: str) -> Callable[[str], str | None]:
        return lambda name: "caution" if abs(self._in_sigma[name].get(column, 0.0)) > NOTABLE_SIGMAS else None

    def _value_state(self, name: str) -> str | None:
        return "bad" if name in self._outside else None

    def _sigma_state(self, name: str) -> str | None:
        return "caution" if name in self._unobservable else None

    def _sigma_hint(self, name: str) -> str:
        return say("logs.parameter_lost") if name in self._unobservable else ""


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
        }
    if truth is not None:
        cells["truth"] = _signed(display(name, truth)[0], sigma)
    return cells


def _in_sigma(row: Parameter, other: tuple[float, float] | None, truth: float | None) -> dict[str, float]:
    """Return the differences from the other solution in the larger sigma, and from the true value in the own sigma."""
    apart = {}
    if other is not None:
        apart["other_in_sigma"] = (row.value - other[0]) / max(row.sigma, other[1], 1e-300)
    if truth is not None:
        apart["truth_in_sigma"] = (row.value - truth) / max(row.sigma, 1e-300)
    return apart


def _signed(value: float, sigma: float) -> str:
    return with_minus(number(value, sigma))
