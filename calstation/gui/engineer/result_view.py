"""The result of a run, parameter by parameter: value, sigma, change since the run before, limits, verdict."""

from PySide6.QtWidgets import QWidget

from calstation.gui.engineer.cell_table import CellTable
from calstation.gui.history import local_time
from calstation.gui.text import KINDS, bind, of_parameter, on_language_change, say, term
from calstation.gui.widgets import (
    ChecksTable,
    Column,
    StateBadge,
    button,
    column,
    label,
    row,
    theme,
)
from calstation.physics import NAMES, display, number
from calstation.records import Check
from calstation.results import FinishedRun, Parameter, Registers, Result

_NONE = "–"
#: A change of more than this many sigmas is marked.
_NOTABLE = 3.0
#: Greatest height of the table of checks that concern no single parameter, px.
_MOST_CHECKS = 26 * theme.GRID
_NUMBERS = ("value", "sigma", "previous", "change", "in_sigma", "limit", "sigma_limit")
#: Shape of each verdict of a parameter (`widgets.badge.KINDS`).
_SHAPES = {"good": "good", "near": "caution", "lost": "caution", "value": "bad", "sigma": "bad", "both": "bad"}


class ResultView(QWidget):
    """The table of parameters below the run's verdict, and the checks that concern no single parameter."""

    def __init__(self) -> None:
        super().__init__()
        self.shown: FinishedRun | None = None
        self._badge = StateBadge(theme.SECTION)
        self._about = label(wrap=True)
        self._table = table = CellTable("result_table", grouped=True)
        table.set_columns(
            (
                table.column(lambda: self.tr("Unit"), "unit", number=False),
                table.column(lambda: self.tr("Value"), "value"),
                table.column(lambda: self.tr("± σ"), "sigma"),
                table.column(lambda: self.tr("Previous"), "previous"),
                table.column(lambda: self.tr("Change"), "change"),
                Column(
                    lambda: self.tr("in σ"),
                    lambda name: table.cells[name].get("in_sigma", _NONE),
                    state=lambda name: "caution" if "changed" in table.cells[name] else None,
                ),
                table.column(lambda: self.tr("Value limit"), "limit"),
                table.column(lambda: self.tr("σ limit"), "sigma_limit"),
                Column(lambda: self.tr("Stage"), lambda name: term("stage", table.cells[name]["stage"]), number=False),
                Column(
                    lambda: self.tr("Verdict"),
                    lambda name: term("engineer", f"verdict_{table.cells[name]['verdict']}"),
                    number=False,
                    state=lambda name: _SHAPES.get(table.cells[name]["verdict"]),
                ),
            )
        )
        bind(table.setAccessibleName, lambda: self.tr("Parameters of the run"))
        self._checks = ChecksTable()
        self._checks.setObjectName("acceptance_checks")
        copy = button("copy_button", lambda: self.tr("Copy table"), table.copy)
        bind(copy.setToolTip, lambda: self.tr("The selected rows, or all, as a table for a spreadsheet (Ctrl+C)"))
        column(
            row(self._badge, (self._about, 1), copy, spacing=2 * theme.GRID),
            (table, 1),
            self._checks,
            on=self,
            margins=(0, theme.GRID, 0, 0),
        )
        on_language_change(self, self._show_texts)

    def show_run(self, finished: FinishedRun) -> None:
        """Show a run."""
        self.shown = finished
        result, parameters = finished.result, finished.result.parameters
        names = [name for name in NAMES if name in parameters]
        names += [name for name in parameters if name not in NAMES]
        checks: dict[str, dict[str, Check]] = {name: {} for name in names}
        for check in result.checks:
            if of_parameter(check) and check.subject in checks:
                checks[check.subject][check.kind] = check
        cells = {name: _cells(name, parameters[name], finished.previous.get(name), checks[name]) for name in names}
        for name in cells.keys() & set(result.unobservable):
            cells[name]["verdict"] = "lost"
        self._table.show_cells(cells, _NUMBERS)
        general = [check for check in result.checks if not of_parameter(check)]
        self._checks.show_checks(general)
        self._checks.setFixedHeight(min(self._checks.height_of_rows(), _MOST_CHECKS))
        self._checks.setVisible(bool(general))
        self._show_texts()

    def _show_texts(self) -> None:
        self._table.refresh()
        if self.shown is None:
            return
        result = self.shown.result
        if result.outcome == "resolved":
            kind = {None: "none", True: "good", False: "bad"}[result.passed]
            self._badge.show_state(kind, say(f"engineer.resolved_{kind}"))
        else:
            self._badge.show_state(KINDS.get(result.outcome, "none"), verdict_text(result))
        about = []
        if count := len(result.checks):
            passed = count - len(result.failed_checks)
            about.append(self.tr("{0} of {1} checks passed").format(passed, count))
        if near := sum(check.near_miss for check in result.checks):
            about.append(self.tr("near-misses: {0}").format(near))
        if result.registers is not None and result.verified:
            about += _register_texts(result.registers)
        self._about.setText("  ·  ".join(about))


def verdict_text(result: Result, *, stages: bool = True) -> str:
    """The verdict of a run: ``PASS``, or ``PASS (partial: Rate)`` if stages of the product were left out.

    Parameters
    ----------
    result : of the run
    stages : whether the stages of a partial run are named
    """
    if not result.partial or not result.stages:
        return term("badge", result.outcome)
    if not stages:
        return say("engineer.partial", outcome=result.outcome)
    return say("engineer.partial_stages", outcome=result.outcome, stages=list(result.stages))


def _register_texts(registers: Registers) -> list[str]:
    """When the registers were written, and which were kept."""
    if registers.written_utc:
        texts = [say("engineer.registers_written_at", time=local_time(registers.written_utc))]
    else:
        texts = [say("engineer.registers_written")]
    if registers.proved_on == "read_back":
        texts.append(say("engineer.registers_read_back"))
    if registers.kept:
        texts.append(say("engineer.registers_kept", names=", ".join(registers.kept)))
    return texts


def _verdict(checks: dict[str, Check]) -> str:
    value = "within" in checks and not checks["within"].passed
    sigma = "sigma_below" in checks and not checks["sigma_below"].passed
    if value or sigma:
        return "both" if value and sigma else "value" if value else "sigma"
    if any(check.near_miss for check in checks.values()):
        return "near"
    return "good" if checks else "none"


def _cells(name: str, parameter: Parameter, previous: float | None, checks: dict[str, Check]) -> dict[str, str]:
    """The texts of a row, numbers in the unit shown and rounded to the sigma.

    Besides, ``verdict`` is a key of `_SHAPES` or ``none``, and ``changed`` is there for a notable change.
    """
    value, unit = _display(name, parameter.value)
    sigma, _ = _display(name, parameter.sigma)
    cells = {
        "unit": unit or parameter.unit,
        "value": number(value, sigma),
        "sigma": number(sigma, sigma),
        "stage": parameter.stage,
        "verdict": _verdict(checks),
    }
    if previous is not None:
        before, _ = _display(name, previous)
        cells["previous"] = number(before, sigma)
        cells["change"] = "0" if before == value else number(value - before, sigma)
        cells["in_sigma"] = f"{(value - before) / sigma:+.2f}" if sigma > 0.0 else _NONE
        if abs(parameter.value - previous) > _NOTABLE * parameter.sigma:
            cells["changed"] = "yes"
    if "within" in checks and isinstance(checks["within"].limit, tuple):
        low, high = (_display(name, bound)[0] for bound in checks["within"].limit)
        cells["limit"] = f"±{_limit(high)}" if low == -high else f"{_limit(low)} … {_limit(high)}"
    if "sigma_below" in checks and not isinstance(checks["sigma_below"].limit, tuple):
        cells["sigma_limit"] = _limit(_display(name, checks["sigma_below"].limit)[0], 3)
    return cells


def _limit(value: float, digits: int = 4) -> str:
    """A limit with this many digits at most, never as a power of ten."""
    return f"{value:.0f}" if abs(value) >= 10.0 ** (digits - 1) else f"{value:.{digits}g}"


def _display(name: str, value: float) -> tuple[float, str]:
    """In the unit shown; unchanged and without a unit if it is not one of the 30 parameters."""
    return display(name, value) if name in NAMES else (value, "")
