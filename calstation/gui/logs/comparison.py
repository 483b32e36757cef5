"""Compares the offline result with the result of the run, parameter by parameter, with differences in sigma."""

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QWidget

from calstation.gui.text import KINDS, bind, event_sentence, on_language_change, parameter_text, show, term
from calstation.gui.widgets import (
    NOTABLE_SIGMAS,
    Column,
    ParameterModel,
    ParameterTable,
    StateBadge,
    align_columns,
    column,
    grid,
    label,
    ordered,
    show_text,
    theme,
)
from calstation.physics import display, number
from calstation.results import Parameter, Resolved, Result, in_sigma
from calstation.results.plots import LogIndex

_NONE = "–"
_NUMBERS = ("online", "online_sigma", "offline", "offline_sigma", "difference")


class Comparison(QWidget):
    """Shows the result of the run and, once the log is solved offline, the offline result beside it."""

    def __init__(self) -> None:
        super().__init__()
        self._log_index: LogIndex | None = None
        self._solved: Resolved | None = None
        self._outdated = False
        self._online: Result | None = None
        self._cells: dict[str, dict[str, str]] = {}
        self._in_sigma: dict[str, float] = {}
        self._failed: frozenset[tuple[str, bool]] = frozenset()
        self._unobservable: frozenset[str] = frozenset()
        names = ("online_badge", "offline_badge", "difference_badge")
        self.online_badge, self.offline_badge, self.difference_badge = badges = [StateBadge(name=n) for n in names]
        self._difference_head = label(lambda: self.tr("Difference"), "muted")
        heads = (
            label(lambda: self.tr("Run"), "muted"),
            label(lambda: self.tr("Offline"), "muted"),
            self._difference_head,
        )
        self.note_label = label(name="comparison_label", wrap=True)
        rows = grid(across=2 * theme.GRID, down=theme.GRID // 2, stretch=1)
        for line, (head, badge) in enumerate(zip(heads, badges, strict=True)):
            rows.addWidget(head, line, 0)
            rows.addWidget(badge, line, 1, Qt.AlignmentFlag.AlignLeft)
        self.model = ParameterModel(
            (
                Column(lambda: self.tr("unit"), lambda n: self._cell(n, "unit"), number=False),
                Column(lambda: self.tr("run"), lambda n: self._cell(n, "online")),
                Column(lambda: "±σ", lambda n: self._cell(n, "online_sigma")),
                Column(self._offline_heading, lambda n: self._cell(n, "offline"), state=self._value_state),
                Column(lambda: "±σ", lambda n: self._cell(n, "offline_sigma"), state=self._sigma_state),
                Column(lambda: self.tr("diff."), lambda n: self._cell(n, "difference")),
                Column(lambda: self.tr("in σ"), lambda n: self._cell(n, "in_sigma"), state=self._difference_state),
            )
        )
        self.table = ParameterTable(self.model)
        self.table.setObjectName("comparison_table")
        bind(self.table.setAccessibleName, lambda: self.tr("The run's parameters and those solved offline"))
        hint = label(lambda: self.tr("Parameters and their sigmas are shown here once a range is solved."), "muted")
        hint.setWordWrap(True)
        hint.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self._nothing = hint
        column(rows, self.note_label, (self.table, 1), (self._nothing, 1), on=self)
        on_language_change(self, self._refresh)

    def show_log(self, log_index: LogIndex) -> None:
        """Show the result of the run."""
        self._log_index, self._solved = log_index, None
        self._online = log_index.stored
        self._fill()

    def show_solved(self, solved: Resolved) -> None:
        """Show an offline result beside that of the run."""
        self._solved = solved
        self._fill()

    def set_outdated(self, outdated: bool) -> None:
        """Mark the offline result as one of another range or other stages than those selected."""
        if outdated != self._outdated:
            self._outdated = outdated
            self._refresh()

    @property
    def identical(self) -> bool:
        """Whether every offline value and sigma is bit-for-bit identical to that of the run."""
        online, offline = ({n: (p.value, p.sigma) for n, p in each.items()} for each in self._parameters())
        return bool(online) and online == offline

    def _parameters(self) -> tuple[dict[str, Parameter], dict[str, Parameter]]:
        online = {} if self._online is None else self._online.parameters
        return online, {} if self._solved is None else self._solved.result.parameters

    def _fill(self) -> None:
        online, offline = self._parameters()
        names = ordered(online | offline)
        self._cells = {name: _cells(name, online.get(name), offline.get(name)) for name in names}
        align_columns(self._cells, _NUMBERS)
        self._in_sigma = {n: in_sigma(offline[n], online[n]) for n in names if n in online and n in offline}
        result = None if self._solved is None else self._solved.result
        failed = [] if result is None else result.failed_checks
        self._failed = frozenset((check.subject, check.kind == "sigma_below") for check in failed)
        self._unobservable = frozenset([] if result is None else result.undetermined)
        self.model.set_names(names)
        self.table.setVisible(bool(names))
        self._nothing.setVisible(not names)
        self._refresh()

    def _cell(self, name: str, key: str) -> str:
        return self._cells[name].get(key, _NONE)

    def _value_state(self, name: str) -> str | None:
        return "bad" if (name, False) in self._failed else None

    def _sigma_state(self, name: str) -> str | None:
        return "bad" if (name, True) in self._failed else "caution" if name in self._unobservable else None

    def _difference_state(self, name: str) -> str | None:
        return "caution" if abs(self._in_sigma.get(name, 0.0)) > NOTABLE_SIGMAS else None

    def _refresh(self) -> None:
        self.model.refresh()
        self.online_badge.show_state(*self._online_verdict())
        if self._solved is None or self._log_index is None:
            self.offline_badge.show_state("none", self.tr("Not solved yet"))
            notes = []
        else:
            self.offline_badge.show_state(*self._offline_verdict(self._solved.result))
            notes = self._notes(self._solved, self._log_index)
        show_text(self.note_label, "\n".join(notes))
        for widget in (self._difference_head, self.difference_badge):
            widget.setVisible(bool(self._in_sigma) and not self._outdated)
        if self._in_sigma:
            self.difference_badge.show_state(*self._difference())

    def _online_verdict(self) -> tuple[str, str]:
        if self._online is not None:
            return KINDS.get(self._online.verdict, "none"), term("badge", self._online.verdict)
        log = self._log_index
        if log is not None and log.outcome is None and log.meta.run is not None:
            return "caution", self.tr("No result: this run did not reach its end")
        return "none", self.tr("The log holds no result of a run")

    def _offline_heading(self) -> str:
        return self.tr("offline, outdated") if self._outdated else self.tr("offline")

    def _offline_verdict(self, result: Result) -> tuple[str, str]:
        if self._outdated:
            return "caution", self.tr("Outdated: the range or the stages have changed; solve again")
        if result.passed is None and result.missing_data:
            return "caution", self.tr("Solved as far as the data allow; some stages are not")
        if result.passed is None:
            return "none", self.tr("Solved; the log names no limits to compare with")
        if result.passed and result.partial:
            return "partial", self.tr("Partial: inside the limits, but not all stages of the product were solved")
        if result.passed:
            return "good", self.tr("Inside every limit of the product")
        failed = self.tr("Outside the limits: {0} of {1} checks")
        return "bad", failed.format(len(result.failed_checks), len(result.checks))

    def _difference(self) -> tuple[str, str]:
        if self.identical:
            return "good", self.tr("Identical bit for bit")
        name = max(self._in_sigma, key=lambda n: abs(self._in_sigma[n]))
        largest = self.tr("Largest difference {0} σ, {1}").format(
            f"{abs(self._in_sigma[name]):.2f}", parameter_text(name)
        )
        beyond = sum(abs(difference) > NOTABLE_SIGMAS for difference in self._in_sigma.values())
        return ("caution", self.tr("{0}; beyond 3 σ: {1}").format(largest, beyond)) if beyond else ("none", largest)

    def _notes(self, solved: Resolved, log_index: LogIndex) -> list[str]:
        result, facts = solved.result, log_index.facts
        first, last = result.log.first_seq, result.log.last_seq
        notes = []
        if (first, last) != (facts.first_seq, facts.last_seq):
            notes.append(self.tr("From samples {0} to {1}, part of the log.").format(first, last))
        if self._online is not None and self._online.stages not in ([], result.stages):
            stages = self.tr(", ").join(term("stage", stage) for stage in result.stages)
            notes.append(self.tr("Stages solved: {0}.").format(stages))
        if self._unobservable:
            lost = self.tr("Not determined by these data: {0} of {1} parameters, marked below.")
            notes.append(lost.format(len(self._unobservable), len(result.parameters)))
        notes += [show(reason) for reason in solved.missing_data]
        return notes + [event_sentence(key, values) for key, values in solved.messages]


def _cells(name: str, online: Parameter | None, offline: Parameter | None) -> dict[str, str]:
    """Return the cells of a parameter, each with as many digits as its sigma justifies."""
    cells = {"unit": display(name, 0.0)[1]}
    for key, parameter in (("online", online), ("offline", offline)):
        if parameter is not None:
            value, sigma = display(name, parameter.value)[0], display(name, parameter.sigma)[0]
            cells |= {key: number(value, sigma), f"{key}_sigma": number(sigma, sigma)}
    if online is not None and offline is not None:
        sigma = display(name, max(online.sigma, offline.sigma))[0]
        difference = display(name, offline.value - online.value)[0]
        same = offline.value == online.value
        cells["difference"] = "0" if same else number(difference, sigma)
        cells["in_sigma"] = "0" if same else f"{in_sigma(offline, online):+.2f}"
    return cells
