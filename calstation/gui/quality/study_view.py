"""The repeatability study: its plan, the missing runs and, when it is complete, the analysis of variance."""

import secrets
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from PySide6.QtWidgets import QWidget

from calstation.config import load_product
from calstation.errors import CalstationError
from calstation.gui.quality.capability_view import cpk_state
from calstation.gui.quality.study_plots import ComponentsView, StudyCharts, StudyValues
from calstation.gui.state import Page
from calstation.gui.text import on_language_change, parameter_text, product_text, say
from calstation.gui.widgets import (
    Cell,
    CellTable,
    CountEdit,
    ElidedLabel,
    EmptyState,
    StateBadge,
    ViewTabs,
    ask_file,
    ask_open,
    box,
    button,
    column,
    label,
    line_edit,
    panel,
    row,
    show_text,
    split,
    stack,
    theme,
)
from calstation.messages import Text, plain_number
from calstation.physics import display, number
from calstation.quality import (
    MIN_CATEGORIES,
    AnovaRow,
    GaugePlan,
    GaugeStudy,
    ParameterQuality,
    StudyState,
    Variation,
    evaluate_study,
)

#: Symbol of each verdict.
_STATES = {"acceptable": "good", "marginal": "caution", "unacceptable": "bad"}
_ORDER = (
    Cell("quality.run", "run"),
    Cell("quality.trial", "trial"),
    Cell("quality.unit", "unit", number=False),
    Cell("common.operator", "operator", number=False),
    Cell("common.station", "station", number=False),
    Cell("quality.state", "state", number=False, state="kind"),
)
_OVERVIEW = (
    Cell("common.verdict", "verdict", number=False, state="kind", hint="hint"),
    Cell("quality.of_tolerance", "tolerance", hint="hint"),
    Cell("quality.of_study", "study", hint="hint"),
    Cell("quality.distinct_categories", "categories", hint="hint"),
    Cell("quality.cpk", "cpk", state="cpk_kind", hint="hint"),
)
_COMPONENTS = (
    Cell("quality.variation", "name", number=False),
    Cell("common.sigma", "sigma"),
    Cell("quality.interval", "interval"),
    Cell("quality.of_study", "study"),
    Cell("quality.of_tolerance", "tolerance"),
)
_ANOVA = (
    Cell("quality.source", "name", number=False),
    Cell("quality.degrees_of_freedom", "dof"),
    Cell("quality.variance_ratio", "f"),
    Cell("quality.probability", "p"),
)


class StudyView(QWidget):
    """A view that creates, opens and evaluates study plans; `product` returns the product file for a new plan."""

    def __init__(self, page: Page, product: Callable[[], Path | None]) -> None:
        super().__init__()
        self._app = page.app
        self._path: Path | None = None
        self._state: StudyState | None = None
        self._error: CalstationError | None = None
        self._job = page.job(evaluate_study, self._show, failed=self._show_error)
        #: Cpk by product and parameter.
        self._capability: Mapping[tuple[str, str], float] = {}
        self.overview = CellTable(
            "study_overview_table", "quality.study_overview", _OVERVIEW, grouped=True, single=True
        )
        self.overview.selectionModel().currentRowChanged.connect(lambda *_: self._show_study())
        self._plan_label = label(kind="muted", name="study_plan_label")
        self._choices_label = ElidedLabel("muted")
        self._choices_label.setObjectName("study_choices_label")
        self._problem = label(kind="error", name="study_problem_label", wrap=True)
        self.form = PlanForm(product, self._ask_plan_file)
        self.form.hide()
        self.order = CellTable("study_order_table", "quality.plan_runs", _ORDER, named=False)
        self.components = CellTable("study_components_table", "quality.variation_components", _COMPONENTS, named=False)
        self.anova = CellTable("study_anova_table", "quality.analysis_of_variance", _ANOVA, named=False)
        self.badge, self.about_label = StateBadge(theme.SECTION), label(name="study_about_label", wrap=True)
        self._next_label = label(kind="section", name="study_left_label", wrap=True)
        self._empty, self._missing_runs = EmptyState(), box(self._next_label, (self.order, 1))
        self._name_label = label(kind="section", name="study_parameter_label")
        self.charts, self.shares = StudyCharts(), ComponentsView()
        tables = box((self.components, 5), (self.anova, 4))
        self.tabs = ViewTabs("study_views", "quality.charts", "quality.analysis_of_variance", "quality.all_parameters")
        views = stack(self.charts, tables, self.shares)
        self.tabs.currentChanged.connect(views.setCurrentIndex)
        head = row(self._name_label, 2 * theme.GRID, self.badge, None)
        selected = box(head, self.about_label, row(self.tabs, None), (views, 1))
        self._evaluation = split((self.overview, 11), (selected, 9), handle=2 * theme.GRID)
        self._stack = stack(self._empty, self._missing_runs, self._evaluation)
        open_button = button("study_open_button", "quality.open_plan", self._open)
        new_button = button("study_new_button", "quality.new_plan", self.form.show)
        column(
            row(open_button, new_button, self._plan_label, (self._choices_label, 1)),
            self.form,
            self._problem,
            (self._stack, 1),
            on=self,
            margins=(0, theme.GRID, 0, 0),
        )
        on_language_change(self, self._refresh)

    def read(self) -> None:
        """Evaluate the plan again from the runs."""
        if self._path is not None and self._app.runs_folder.is_dir():
            self._job.start(self._app.runs_folder, self._path, None)

    def show_capability(self, charts: Sequence[ParameterQuality]) -> None:
        """Show the Cpk of parameters beside their results in a study of the same product."""
        self._capability = {
            (each.product, each.parameter): each.capability.cpk.value for each in charts if each.capability is not None
        }
        self._refresh()

    # ---- plan

    def _open(self) -> None:
        ask_open(self, say("quality.open_study_plan"), Path(), ["JSON (*.json)"], self.open_plan)

    def open_plan(self, path: Path) -> None:
        """Open a plan and evaluate it from the runs."""
        self._path = path
        self.read()

    def _ask_plan_file(self, plan: GaugePlan) -> None:
        ask_file(self, say("quality.save_plan"), Path("gauge.json"), ["JSON (*.json)"], partial(self._save, plan))

    def _save(self, plan: GaugePlan, path: Path) -> None:
        plan.save(path)
        self.form.hide()
        self.open_plan(path)

    # ---- display

    def _show(self, state: StudyState) -> None:
        self._state, self._error = state, None
        self._refresh()

    def _show_error(self, error: CalstationError) -> None:
        self._error, self._state = error, None
        self._refresh()

    def _refresh(self) -> None:
        state = self._state
        show_text(self._problem, "" if self._error is None else say(self._error.as_text))
        named = self._path is not None and state is not None
        product = product_text(state.plan.product) if state is not None else ""
        file = "" if self._path is None else self._path.name
        self._plan_label.setText(say("common.noted", name=file, note=product) if named else file)
        simulated = None if state is None else state.simulated.text
        notes = [*filter(None, (simulated,)), Text("quality.study_and_choices")]
        self._choices_label.setText("" if self._path is None else " ".join(map(say, notes)))
        if state is None:
            self._empty.say("gauge.no_plan", "gauge.about")
            self._stack.setCurrentWidget(self._empty)
        elif state.missing:
            self._show_order(state)
            self._stack.setCurrentWidget(self._missing_runs)
        else:
            self._show_overview(state)
            self._stack.setCurrentWidget(self._evaluation)

    def _show_order(self, state: StudyState) -> None:
        lost = Counter(state.lost)
        missing = Counter(state.missing) - lost
        next_run = next((each for each in state.missing if missing[each]), None)
        count, notes = {"left": missing.total(), "runs": len(state.plan.order)}, _order_notes(state)
        if lost:
            notes.insert(0, say("gauge.lost", count=lost.total()))
        if next_run is not None:
            notes.insert(0, say("gauge.left", **count, unit=next_run.unit, by=next_run.appraiser))
        self._next_label.setText("\n".join(notes))
        cells = {}
        for k, each in enumerate(state.plan.order):
            kind, code = "good", "done"
            if lost[each]:
                kind, code = "caution", "files_missing"
            elif missing[each]:
                kind, code = ("running", "next") if each == next_run else ("none", "waiting")
            cells[str(k)] = {
                "run": str(k + 1),
                "trial": str(each.trial),
                "unit": each.unit,
                **{factor: getattr(each, factor) for factor in state.plan.factors[1:]},
                "state": say(f"gauge.{code}"),
                "kind": kind,
            }
        self.order.show_cells(cells)

    def _show_overview(self, state: StudyState) -> None:
        """List the results of all parameters, and keep the selected one."""
        names, current = list(state.studies), self.overview.current_name
        cells = {
            name: _overview_cells(study, state.beyond(name), self._capability.get((state.plan.product, name)))
            for name, study in state.studies.items()
        }
        self.overview.show_cells(cells, ("tolerance", "study", "cpk"))
        self.shares.show_data(state.studies)
        if names:
            self.overview.selectRow(names.index(current) if current in names else 0)
        self._show_study()

    def _show_study(self) -> None:
        state, name = self._state, self.overview.current_name
        if state is None or name not in state.studies:
            return
        self._name_label.setText(parameter_text(name))
        study, (size, unit) = state.studies[name], display(name, 1.0)
        values, beyond = state.by_appraiser(name), state.beyond(name)
        self.badge.show_state(_state(study, beyond), say(f"gauge.{study.verdict}"))
        sizes = " × ".join(say(f"gauge.count_{factor}", count=count) for factor, count in study.levels.items())
        about = say("gauge.answer", sizes=sizes, trials=study.trials, categories=study.categories, unit=unit)
        self.about_label.setText("\n".join([about, *_cautions(study, beyond), *_order_notes(state)]))
        digits = size * study.gauge.sigma
        cells = {key: {"name": _source(key), **_cells(each, size, digits)} for key, each in _components(study).items()}
        self.components.show_cells(cells, ("sigma",))
        plan = state.plan
        self.charts.show_data(StudyValues(name, unit, plan.units, plan.appraisers, size * values))
        self.anova.show_cells({line.source: _anova_cells(line) for line in study.anova})


class PlanForm(QWidget):
    """The inputs for a new plan for the product file that `product` returns; `then` is called with the plan."""

    def __init__(self, product: Callable[[], Path | None], then: Callable[[GaugePlan], object]) -> None:
        super().__init__()
        self._product, self._then = product, then
        names = "quality.names_placeholder"
        self.units_edit = line_edit("study_units_edit", hint="quality.serials_placeholder")
        self.operators_edit = line_edit("study_operators_edit", hint=names)
        self.stations_edit = line_edit("study_stations_edit", hint=names)
        self._trials = CountEdit("study_trials_edit", "quality.trials", 2, 20, 3)
        self._problem = label(kind="error", wrap=True)
        fields = (
            ("quality.study_units", self.units_edit, 3),
            ("quality.operators", self.operators_edit, 2),
            ("quality.stations", self.stations_edit, 2),
            ("quality.trials", self._trials, 0),
        )
        parts = [
            (column(label(words, buddy=field), field, spacing=theme.GRID // 2), share) for words, field, share in fields
        ]
        save = button("study_save_button", "quality.save_plan_button", self._make, kind="primary")
        close = button("study_close_button", "common.close", self.hide)
        column(panel(row(*parts, save, close), self._problem), on=self)
        on_language_change(self, lambda: show_text(self._problem, ""))

    def _make(self) -> None:
        edits = (self.units_edit, self.operators_edit, self.stations_edit)
        units, operators, stations = (
            [part.strip() for part in edit.text().replace("，", ",").split(",") if part.strip()] for edit in edits
        )
        now = datetime.now(UTC).replace(microsecond=0)
        if problem := self._trials.check():
            show_text(self._problem, say(problem))
            return
        try:
            product = load_product(self._product())[1].name
            plan = GaugePlan.random(
                product, units, operators, stations, self._trials.value(), secrets.randbits(32), now
            )
        except CalstationError as error:
            show_text(self._problem, say(error.as_text))
            return
        show_text(self._problem, "")
        self._then(plan)


def _cells(variation: Variation, size: float, digits: float) -> dict[str, str]:
    sigma, low, high = (number(size * value, digits) for value in (variation.sigma, variation.low, variation.high))
    cells = {"sigma": sigma, "interval": f"{low} … {high}", "study": f"{variation.percent_study:.1f}"}
    if variation.percent_tolerance is not None:
        cells["tolerance"] = f"{variation.percent_tolerance:.1f}"
    return cells


def _state(study: GaugeStudy, beyond: int) -> str:
    """Return the symbol of a verdict; a study with `_cautions` gets no tick."""
    kind = _STATES[study.verdict]
    return "caution" if kind == "good" and _cautions(study, beyond) else kind


def _cautions(study: GaugeStudy, beyond: int) -> list[str]:
    """Return sentences about too few distinct categories, and about ranges beyond their control limits."""
    few = [say("gauge.few_categories", count=study.categories)] if study.categories < MIN_CATEGORIES else []
    return few + ([say("quality.ranges_beyond", count=beyond)] if beyond else [])


def _overview_cells(study: GaugeStudy, beyond: int, cpk: float | None) -> dict[str, str]:
    gauge = study.gauge
    cells = {
        "verdict": say(f"gauge.{study.verdict}"),
        "kind": _state(study, beyond),
        "hint": "\n".join(_cautions(study, beyond)),
        "study": f"{gauge.percent_study:.1f}",
        "categories": str(study.categories),
    }
    if gauge.percent_tolerance is not None:
        cells["tolerance"] = f"{gauge.percent_tolerance:.1f}"
    if cpk is not None:
        cells |= {"cpk": f"{cpk:.2f}", "cpk_kind": cpk_state(cpk)}
    return cells


def _order_notes(state: StudyState) -> list[str]:
    """Return a sentence about runs that were not made in the planned order, if there are any."""
    values = {"count": state.out_of_order, "runs": len(state.plan.order) - len(state.missing)}
    return [say("quality.order_not_kept", **values)] if state.out_of_order else []


def _components(study: GaugeStudy) -> dict[str, Variation]:
    """Return the components of variation, each sum after its parts."""
    parts = {name: each for name, each in study.components.items() if len(study.levels) > 2 and name != "unit"}
    components = {
        "repeatability": study.repeatability,
        **{name: each for name, each in parts.items() if "unit" not in name},
        "reproducibility": study.reproducibility,
        **{name: each for name, each in parts.items() if "unit" in name},
    }
    if study.interaction is not None:
        components["interaction"] = study.interaction
    return {**components, "gauge": study.gauge, "part": study.part, "total": study.total}


def _source(source: str) -> str:
    """Return the name of a source of variation, a product of factors separated by ``*``."""
    return " × ".join(say(f"gauge.{name}") for name in source.split("*"))


def _anova_cells(line: AnovaRow) -> dict[str, str]:
    tested = {} if line.f is None or line.p is None else {"f": plain_number(line.f, ".3g"), "p": f"{line.p:.3g}"}
    name = say("gauge.pooled", source=_source(line.source)) if line.pooled else _source(line.source)
    return {"name": name, "dof": str(line.dof), **tested}
