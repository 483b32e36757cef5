"""The answer of a run, parameter by parameter: value, sigma, change since the last time, limits, verdict."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from PySide6.QtCore import QEvent
from PySide6.QtWidgets import QHBoxLayout, QLabel, QPushButton, QVBoxLayout, QWidget

from calstation.gui.engineer.verdict_wording import word_verdict
from calstation.gui.history.run_table import local_time
from calstation.gui.text.checks import of_parameter
from calstation.gui.text.messages import KINDS, term
from calstation.gui.widgets import theme
from calstation.gui.widgets.badge import StateBadge
from calstation.gui.widgets.checks_table import ChecksTable
from calstation.gui.widgets.parameter_table import Column, ParameterModel, ParameterTable
from calstation.physics.parameters import NAMES
from calstation.physics.units import aligned, display, number
from calstation.records.limits import Check
from calstation.results.finished_run import FinishedRun

_NONE = "–"
#: A change of more than so many sigmas is marked.
_NOTABLE = 3.0
#: Greatest height of the table of checks that compare no single parameter, px.
_CHECKS_MOST = 26 * theme.GRID
_NUMBERS = ("value", "sigma", "previous", "change", "in_sigma", "limit", "sigma_limit")


class ResultView(QWidget):
    """The table, with the run's verdict above it."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.shown: FinishedRun | None = None
        self._cells: dict[str, dict[str, str]] = {}
        self._states: dict[str, str] = {}
        self._changed: frozenset[str] = frozenset()
        self.badge = StateBadge(theme.SECTION)
        self._about = QLabel()
        self._about.setWordWrap(True)
        self.copy_button = QPushButton()
        self.copy_button.setObjectName("copy_button")
        self.model = ParameterModel(
            (
                Column(lambda: self.tr("Unit"), self._text("unit"), number=False),
                Column(lambda: self.tr("Value"), self._text("value")),
                Column(lambda: self.tr("± σ"), self._text("sigma")),
                Column(lambda: self.tr("Previous"), self._text("previous")),
                Column(lambda: self.tr("Change"), self._text("change")),
                Column(lambda: self.tr("in σ"), self._text("in_sigma"), state=self._change_state),
                Column(lambda: self.tr("Value limit"), self._text("limit")),
                Column(lambda: self.tr("σ limit"), self._text("sigma_limit")),
                Column(lambda: self.tr("Stage"), self._stage, number=False),
                Column(lambda: self.tr("Verdict"), self._verdict, number=False, state=self._verdict_state),
            )
        )
        self.table = ParameterTable(self.model)
        self.table.setObjectName("result_table")
        self.table.verticalHeader().setDefaultSectionSize(26)
        self.checks = ChecksTable()
        self.checks.setObjectName("acceptance_checks")
        self.copy_button.clicked.connect(self.table.copy)
        head = QHBoxLayout()
        head.setSpacing(2 * theme.GRID)
        head.addWidget(self.badge)
        head.addWidget(self._about, 1)
        head.addWidget(self.copy_button)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, theme.GRID, 0, 0)
        column.setSpacing(theme.GRID)
        column.addLayout(head)
        column.addWidget(self.table, 1)
        column.addWidget(self.checks)
        self.retranslate()

    def show_run(self, finished: FinishedRun) -> None:
        """Show this run."""
        self.shown = finished
        result = finished.result_json
        parameters = result["parameters"]
        names = [name for name in NAMES if name in parameters]
        names += [name for name in parameters if name not in NAMES]
        checks = _checks(result["checks"])
        self._cells = {
            name: _row(name, parameters[name], finished.previous.get(name), checks.get(name, {}))
            for name in names
        }
        for column in _NUMBERS:
            there = [name for name in names if column in self._cells[name]]
            texts = aligned([self._cells[name][column] for name in there])
            for name, text in zip(there, texts, strict=True):
                self._cells[name][column] = text
        lost = set(result["unobservable"])
        self._states = {name: _state(checks.get(name, {}), name in lost) for name in names}
        self._changed = frozenset(
            name
            for name in names
            if name in finished.previous
            and abs(parameters[name]["value"] - finished.previous[name])
            > _NOTABLE * parameters[name]["sigma"]
        )
        self.model.set_names(names)
        broad = [check for check in map(Check.from_json, result["checks"]) if not of_parameter(check)]
        self.checks.show_checks(broad)
        self.checks.setFixedHeight(min(self.checks.height_of_rows(), _CHECKS_MOST))
        self.checks.setVisible(bool(broad))
        self._say()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self.copy_button.setText(self.tr("Copy table"))
        self.copy_button.setToolTip(
            self.tr("The selected rows, or all, as a table for a spreadsheet (Ctrl+C)")
        )
        self.table.setAccessibleName(self.tr("Parameters of the run"))
        self.model.refresh()
        self._say()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def _say(self) -> None:
        if self.shown is None:
            return
        result = self.shown.result_json
        outcome = str(result["outcome"])
        checks: Sequence[Mapping[str, Any]] = result["checks"]
        if outcome == "resolved":
            passed = result["passed"]
            kind = "none" if passed is None else "good" if passed else "bad"
            word = {
                None: self.tr("solved offline, no limits"),
                True: self.tr("solved offline, inside the limits"),
                False: self.tr("solved offline, outside the limits"),
            }[passed]
            self.badge.show_state(kind, word)
        else:
            self.badge.show_state(KINDS.get(outcome, "none"), word_verdict(result))
        failed = [check for check in checks if not check["passed"]]
        said = self.tr("{0} of {1} checks passed").format(len(checks) - len(failed), len(checks))
        near = sum(bool(check.get("near_miss")) for check in checks)
        about = [said] if checks else []
        if near:
            about.append(self.tr("near-misses: {0}").format(near))
        about += self._registers(result.get("registers") or {})
        self._about.setText("  ·  ".join(about))

    def _registers(self, registers: Mapping[str, Any]) -> list[str]:
        """When the registers were written, and which were left alone."""
        if not registers.get("verified"):
            return []
        when = registers.get("written_utc")
        said = [
            self.tr("registers written {0}").format(local_time(str(when)))
            if when
            else self.tr("registers written")
        ]
        if registers.get("proved_on") == "read_back":
            said.append(self.tr("read back only: the unit shows no output with them"))
        if kept := registers.get("kept"):
            said.append(self.tr("kept, found better before: {0}").format(", ".join(kept)))
        return said

    def _text(self, column: str) -> Callable[[str], str]:
        return lambda name: self._cells[name].get(column, _NONE)

    def _stage(self, name: str) -> str:
        return term("stage", self._cells[name]["stage"])

    def _change_state(self, name: str) -> str | None:
        return "caution" if name in self._changed else None

    def _verdict(self, name: str) -> str:
        return {
            "good": self.tr("inside"),
            "near": self.tr("near-miss"),
            "value": self.tr("value outside"),
            "sigma": self.tr("σ too large"),
            "both": self.tr("value outside, σ too large"),
            "lost": self.tr("not determined"),
            "none": self.tr("no limit"),
        }[self._states[name]]

    def _verdict_state(self, name: str) -> str | None:
        state = self._states[name]
        return {"good": "good", "none": None, "lost": "caution", "near": "caution"}.get(state, "bad")


def _checks(checks: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, Mapping[str, Any]]]:
    """The two checks of each parameter by their kind, ``within`` and ``sigma below``."""
    found: dict[str, dict[str, Mapping[str, Any]]] = {}
    for check in checks:
        name, _, kind = str(check["name"]).partition(" ")
        found.setdefault(name, {})[kind] = check
    return found


def _state(checks: Mapping[str, Mapping[str, Any]], lost: bool) -> str:
    if lost:
        return "lost"
    value = "within" in checks and not checks["within"]["passed"]
    sigma = "sigma below" in checks and not checks["sigma below"]["passed"]
    if value or sigma:
        return "both" if value and sigma else "value" if value else "sigma"
    if any(check.get("near_miss") for check in checks.values()):
        return "near"
    return "good" if checks else "none"


def _row(
    name: str, answer: Mapping[str, Any], previous: float | None, checks: Mapping[str, Mapping[str, Any]]
) -> dict[str, str]:
    """A parameter's cells, each with the digits that its sigma is worth."""
    value, unit = _display(name, answer["value"])
    unit = unit or str(answer["unit"])
    sigma = _display(name, answer["sigma"])[0]
    cells = {
        "unit": unit,
        "value": number(value, sigma),
        "sigma": number(sigma, sigma),
        "stage": str(answer["stage"]),
    }
    if previous is not None:
        before = _display(name, previous)[0]
        cells["previous"] = number(before, sigma)
        cells["change"] = "0" if before == value else number(value - before, sigma)
        cells["in_sigma"] = f"{(value - before) / sigma:+.2f}" if sigma > 0.0 else _NONE
    if "within" in checks:
        low, high = (_display(name, float(bound))[0] for bound in checks["within"]["limit"])
        cells["limit"] = f"±{_plain(high)}" if low == -high else f"{_plain(low)} … {_plain(high)}"
    if "sigma below" in checks:
        cells["sigma_limit"] = _plain(_display(name, float(checks["sigma below"]["limit"]))[0], 3)
    return cells


def _plain(value: float, digits: int = 4) -> str:
    """A limit with so many digits at most, never as a power of ten."""
    return f"{value:.0f}" if abs(value) >= 10.0 ** (digits - 1) else f"{value:.{digits}g}"


def _display(name: str, value: float) -> tuple[float, str]:
    """In the unit people read; a value that is none of the 30 parameters as it is, its unit ""."""
    return display(name, value) if name in NAMES else (value, "")
