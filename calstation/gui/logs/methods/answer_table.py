"""A method's parameters: value and sigma, what they were before, and what else they can be compared with."""

from collections.abc import Callable

from PySide6.QtWidgets import QVBoxLayout, QWidget

from calstation.gui.text import on_language_change
from calstation.gui.widgets import Column, ParameterModel, ParameterTable
from calstation.physics import INDEX, NAMES, aligned, display, number
from calstation.results import Parameter
from calstation.results.plots import GimbalPlotData, MethodAnswer

_NONE = "–"
#: A difference of more than so many sigmas is marked.
_NOTABLE = 3.0
_NUMBERS = ("value", "sigma", "before", "before_sigma", "other", "other_sigma", "apart", "truth", "error")


class AnswerTable(QWidget):
    """Rows are parameters by their contract names.

    Beside value and sigma stand what was known before, or for a gimbal the least-squares answer, and where the virtual
    bench made the recording, the truth.
    """

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._cells: dict[str, dict[str, str]] = {}
        self._apart: dict[str, dict[str, float]] = {}
        self._lost: frozenset[str] = frozenset()
        self._outside: frozenset[str] = frozenset()
        self.model = ParameterModel(())
        self.table = ParameterTable(self.model)
        self.table.setObjectName("method_table")
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(self.table)
        on_language_change(self, self.retranslate)

    def show_answer(self, answer: MethodAnswer) -> None:
        """Show an answer's parameters."""
        parameters, picture = answer.parameters, answer.picture
        other = picture.least_squares if isinstance(picture, GimbalPlotData) else {}
        truth = answer.recording.truth
        names = [*(n for n in NAMES if n in parameters), *(n for n in parameters if n not in INDEX)]
        self._apart = {}
        self._cells = {}
        for name in names:
            row = parameters[name]
            self._cells[name] = _cells(name, row, answer.before.get(name), other.get(name), truth.get(name))
            self._apart[name] = _apart(row, other.get(name), truth.get(name))
        for column in _NUMBERS:
            there = [name for name in names if column in self._cells[name]]
            texts = aligned([self._cells[name][column] for name in there])
            for name, text in zip(there, texts, strict=True):
                self._cells[name][column] = text
        result = answer.resolved.result
        self._lost = frozenset(result.unobservable)
        self._outside = frozenset(check.subject for check in result.failed_checks)
        self.model.set_columns(self._columns(answer, bool(other), bool(truth)))
        self.model.set_names(names)

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self.table.setAccessibleName(self.tr("Parameters found"))
        self.model.refresh()

    def _columns(self, answer: MethodAnswer, other: bool, truth: bool) -> list[Column]:
        columns = [
            Column(lambda: self.tr("unit"), self._text("unit"), number=False),
            Column(lambda: self.tr("found"), self._text("value"), state=self._value_state),
            Column(lambda: "± σ", self._text("sigma"), state=self._sigma_state, hint=self._sigma_hint),
        ]
        if other:
            columns += [
                Column(lambda: self.tr("least squares"), self._text("other")),
                Column(lambda: "± σ", self._text("other_sigma")),
                Column(lambda: self.tr("difference"), self._text("apart")),
                Column(lambda: self.tr("in σ"), self._text("apart_in_sigma"), state=self._mark("other")),
            ]
        else:
            columns.append(Column(lambda: self.tr("before"), self._text("before")))
            if any("before_sigma" in cells for cells in self._cells.values()):
                columns.append(Column(lambda: "± σ", self._text("before_sigma")))
        if truth:
            columns += [
                Column(lambda: self.tr("bench's truth"), self._text("truth")),
                Column(lambda: self.tr("error in σ"), self._text("error"), state=self._mark("truth")),
            ]
        return columns

    def _text(self, column: str) -> Callable[[str], str]:
        return lambda name: self._cells[name].get(column, _NONE)

    def _value_state(self, name: str) -> str | None:
        return "bad" if name in self._outside else None

    def _sigma_state(self, name: str) -> str | None:
        return "caution" if name in self._lost else None

    def _sigma_hint(self, name: str) -> str:
        return self.tr("Not determined by this recording") if name in self._lost else ""

    def _mark(self, kind: str) -> Callable[[str], str | None]:
        return lambda name: "caution" if abs(self._apart[name].get(kind, 0.0)) > _NOTABLE else None


def _cells(
    name: str,
    row: Parameter,
    before: tuple[float, float | None] | None,
    other: tuple[float, float] | None,
    truth: float | None,
) -> dict[str, str]:
    """A parameter's cells, each with the digits that its sigma is worth."""
    sigma, unit = display(name, row.sigma)
    value = display(name, row.value)[0]
    cells = {
        "unit": unit if unit != "1" else "",
        "value": _signed(value, sigma),
        "sigma": number(sigma, sigma),
    }
    if before is not None:
        was, was_sigma = display(name, before[0])[0], before[1]
        if was_sigma is None:
            cells["before"] = _signed(was, sigma)
        else:
            shown = display(name, was_sigma)[0]
            cells["before"], cells["before_sigma"] = _signed(was, shown), number(shown, shown)
    if other is not None:
        (least, _), (least_sigma, _) = display(name, other[0]), display(name, other[1])
        cells["other"], cells["other_sigma"] = _signed(least, least_sigma), number(least_sigma, least_sigma)
        cells["apart"] = _signed(value - least, sigma)
        cells["apart_in_sigma"] = f"{_apart(row, other, None)['other']:+.2f}".replace("-", "−")
    if truth is not None:
        cells["truth"] = _signed(display(name, truth)[0], sigma)
        cells["error"] = f"{_apart(row, None, truth)['truth']:+.2f}".replace("-", "−")
    return cells


def _apart(row: Parameter, other: tuple[float, float] | None, truth: float | None) -> dict[str, float]:
    """Differences in sigmas: from the other answer in the larger of both sigmas, from the truth in its own."""
    apart = {}
    if other is not None:
        apart["other"] = (row.value - other[0]) / max(row.sigma, other[1], 1e-300)
    if truth is not None:
        apart["truth"] = (row.value - truth) / max(row.sigma, 1e-300)
    return apart


def _signed(value: float, sigma: float) -> str:
    return number(value, sigma).replace("-", "−")
