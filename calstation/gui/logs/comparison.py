"""The answer beside the run's own: parameter by parameter, the difference in units of sigma."""

from collections.abc import Mapping

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QGridLayout, QLabel, QVBoxLayout, QWidget

from calstation.gui.text import KINDS, event_sentence, on_language_change, show, term
from calstation.gui.widgets import Column, ParameterModel, ParameterTable, StateBadge, theme
from calstation.physics import INDEX, NAMES, aligned, display, number
from calstation.results import Parameter, Resolved, Result, in_sigma
from calstation.results.plots import LogIndex

#: A difference of more than so many sigmas is marked.
NOTABLE = 3.0
_NONE = "–"


class Comparison(QWidget):
    """Before a solution, the run's own result alone."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._log_index: LogIndex | None = None
        self._solved: Resolved | None = None
        self._cells: dict[str, dict[str, str]] = {}
        self._marks: dict[str, float] = {}
        self._outside: frozenset[str] = frozenset()
        self._coarse: frozenset[str] = frozenset()
        self._lost: frozenset[str] = frozenset()
        self._heads = QLabel(), QLabel(), QLabel()
        self.online_badge, self.offline_badge, self.difference_badge = (
            StateBadge(),
            StateBadge(),
            StateBadge(),
        )
        self.online_badge.setObjectName("online_badge")
        self.offline_badge.setObjectName("offline_badge")
        self.difference_badge.setObjectName("difference_badge")
        self.note_label = QLabel()
        self.note_label.setObjectName("comparison_label")
        self.note_label.setWordWrap(True)
        rows = QGridLayout()
        rows.setHorizontalSpacing(2 * theme.GRID)
        rows.setVerticalSpacing(theme.GRID // 2)
        rows.setColumnStretch(1, 1)
        for row, (head, badge) in enumerate(
            zip(self._heads, (self.online_badge, self.offline_badge, self.difference_badge), strict=True)
        ):
            head.setProperty("kind", "muted")
            rows.addWidget(head, row, 0)
            rows.addWidget(badge, row, 1, Qt.AlignmentFlag.AlignLeft)
        self.model = ParameterModel(
            (
                Column(lambda: self.tr("unit"), lambda n: self._cell(n, "unit"), number=False),
                Column(lambda: self.tr("run"), lambda n: self._cell(n, "online")),
                Column(lambda: "±σ", lambda n: self._cell(n, "online_sigma")),
                Column(lambda: self.tr("offline"), lambda n: self._cell(n, "offline"), state=self._limit_state),
                Column(lambda: "±σ", lambda n: self._cell(n, "offline_sigma"), state=self._sigma_state),
                Column(lambda: self.tr("diff."), lambda n: self._cell(n, "difference")),
                Column(lambda: self.tr("in σ"), lambda n: self._cell(n, "in_sigma"), state=self._difference_state),
            )
        )
        self.table = ParameterTable(self.model)
        self.table.setObjectName("comparison_table")
        self._nothing = QLabel()
        self._nothing.setProperty("kind", "muted")
        self._nothing.setWordWrap(True)
        self._nothing.setAlignment(Qt.AlignmentFlag.AlignCenter)
        box = QVBoxLayout(self)
        box.setContentsMargins(0, 0, 0, 0)
        box.setSpacing(theme.GRID)
        box.addLayout(rows)
        box.addWidget(self.note_label)
        box.addWidget(self.table, 1)
        box.addWidget(self._nothing, 1)
        on_language_change(self, self.retranslate)

    def show_log(self, log_index: LogIndex) -> None:
        """Show what the run left in its log."""
        self._log_index, self._solved = log_index, None
        self._fill()

    def show_solved(self, solved: Resolved) -> None:
        """Show a solution beside it."""
        self._solved = solved
        self._fill()

    @property
    def identical(self) -> bool:
        """Whether every value and sigma of the run has come out the same, bit for bit."""
        online, offline = self._parameters()
        return bool(online) and _figures(online) == _figures(offline)

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        texts = (self.tr("Run"), self.tr("Offline"), self.tr("Difference"))
        for head, text in zip(self._heads, texts, strict=True):
            head.setText(text)
        self._nothing.setText(self.tr("Parameters and their sigmas will stand here once a range is solved."))
        self.table.setAccessibleName(self.tr("The run's parameters and those solved offline"))
        self.model.refresh()
        self._say()

    # The table

    def _parameters(self) -> tuple[Mapping[str, Parameter], Mapping[str, Parameter]]:
        stored = self._log_index.stored if self._log_index is not None else None
        online = {} if stored is None else stored.parameters
        return online, {} if self._solved is None else self._solved.result.parameters

    def _fill(self) -> None:
        online, offline = self._parameters()
        found = dict.fromkeys((*online, *offline))
        names = [*(n for n in NAMES if n in found), *(n for n in found if n not in INDEX)]
        self._cells = {name: _row(name, online.get(name), offline.get(name)) for name in names}
        self._marks = {n: in_sigma(offline[n], online[n]) for n in names if n in online and n in offline}
        failed = [] if self._solved is None else self._solved.result.failed_checks
        self._outside = frozenset(check.subject for check in failed if check.kind != "sigma_below")
        self._coarse = frozenset(check.subject for check in failed if check.kind == "sigma_below")
        self._lost = frozenset([] if self._solved is None else self._solved.result.unobservable)
        for column in ("online", "online_sigma", "offline", "offline_sigma", "difference"):
            there = [name for name in names if column in self._cells[name]]
            texts = aligned([self._cells[name][column] for name in there])
            for name, text in zip(there, texts, strict=True):
                self._cells[name][column] = text
        self.model.set_names(names)
        self.table.setVisible(bool(names))
        self._nothing.setVisible(not names)
        self._say()

    def _cell(self, name: str, column: str) -> str:
        return self._cells[name].get(column, _NONE)

    def _limit_state(self, name: str) -> str | None:
        return "bad" if name in self._outside else None

    def _sigma_state(self, name: str) -> str | None:
        if name in self._coarse:
            return "bad"
        return "caution" if name in self._lost else None

    def _difference_state(self, name: str) -> str | None:
        return "caution" if abs(self._marks.get(name, 0.0)) > NOTABLE else None

    # The words above it

    def _say(self) -> None:
        stored = self._log_index.stored if self._log_index is not None else None
        if stored is None:
            outcome = None if self._log_index is None else self._log_index.outcome
            foreign = self._log_index is not None and self._log_index.meta.run is None
            if outcome is None and not foreign:
                self.online_badge.show_state("caution", self.tr("No result: this run did not reach its end"))
            else:
                self.online_badge.show_state("none", self.tr("The log holds no result of a run"))
        else:
            outcome = stored.outcome
            self.online_badge.show_state(KINDS.get(outcome, "none"), term("badge", outcome))
        if self._solved is None:
            self.offline_badge.show_state("none", self.tr("Not solved yet"))
            self.note_label.setText("")
        else:
            self.offline_badge.show_state(*self._verdict(self._solved.result))
            self.note_label.setText("\n".join(self._notes()))
        self.note_label.setVisible(bool(self.note_label.text()))
        for widget in (self._heads[-1], self.difference_badge):
            widget.setVisible(bool(self._marks))
        if self._marks:
            self.difference_badge.show_state(*self._difference())

    def _verdict(self, result: Result) -> tuple[str, str]:
        if result.passed is None and result.missing_data:
            return "caution", self.tr("Solved as far as the data go; not every stage is")
        if result.passed is None:
            return "none", self.tr("Solved; the log names no limits to compare with")
        if result.passed:
            return "good", self.tr("Inside every limit of the product")
        failed, checks = len(result.failed_checks), len(result.checks)
        return "bad", self.tr("Outside the limits: {0} of {1} checks").format(failed, checks)

    def _difference(self) -> tuple[str, str]:
        if self.identical:
            return "good", self.tr("Identical bit for bit")
        name = max(self._marks, key=lambda n: abs(self._marks[n]))
        largest = self.tr("Largest difference {0} σ, {1}").format(f"{abs(self._marks[name]):.2f}", name)
        beyond = sum(abs(mark) > NOTABLE for mark in self._marks.values())
        if not beyond:
            return "none", largest
        return "caution", self.tr("{0}; beyond 3 σ: {1}").format(largest, beyond)

    def _notes(self) -> list[str]:
        assert self._solved is not None
        assert self._log_index is not None
        result, facts = self._solved.result, self._log_index.facts
        notes = []
        log = result.log
        if (log.first_seq, log.last_seq) != (facts.first_seq, facts.last_seq):
            notes.append(self.tr("From samples {0} to {1}, part of the log.").format(log.first_seq, log.last_seq))
        run = None if self._log_index.stored is None else self._log_index.stored.stages
        if run and run != result.stages:
            stages = self.tr(", ").join(term("stage", stage) for stage in result.stages)
            notes.append(self.tr("Stages solved: {0}.").format(stages))
        if self._lost:
            notes.append(
                self.tr("Not determined by these data: {0} of {1} parameters, marked below.").format(
                    len(self._lost), len(result.parameters)
                )
            )
        notes += [show(reason) for reason in self._solved.missing_data]
        return notes + [event_sentence(key, values) for key, values in self._solved.messages]


def _figures(parameters: Mapping[str, Parameter]) -> dict[str, tuple[float, float]]:
    return {name: (row.value, row.sigma) for name, row in parameters.items()}


def _row(name: str, online: Parameter | None, offline: Parameter | None) -> dict[str, str]:
    """A parameter's cells, each with the digits that its sigma is worth."""
    cells = {"unit": display(name, 0.0)[1]}
    for column, answer in (("online", online), ("offline", offline)):
        if answer is not None:
            value, sigma = display(name, answer.value)[0], display(name, answer.sigma)[0]
            cells[column] = number(value, sigma)
            cells[f"{column}_sigma"] = number(sigma, sigma)
    if online is not None and offline is not None:
        sigma = display(name, max(online.sigma, offline.sigma))[0]
        difference = display(name, offline.value - online.value)[0]
        same = offline.value == online.value
        cells["difference"] = "0" if same else number(difference, sigma)
        cells["in_sigma"] = "0" if same else f"{in_sigma(offline, online):+.2f}"
    return cells
