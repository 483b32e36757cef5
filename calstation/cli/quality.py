"""`quality`: statistics of stored runs over time, and gauge studies."""

import sys
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path

from rich.console import Console
from rich.table import Table

from calstation.cli.options import existing_folder
from calstation.cli.show import check_json, emit_json, ignore_progress, interval, job_progress, show_line, table
from calstation.cli.text import say, term
from calstation.config import load_product
from calstation.errors import ConfigurationError, InputError
from calstation.messages import Text
from calstation.physics import NAMES, display, further_parameter, number
from calstation.quality import (
    LEAST_CATEGORIES,
    LEAST_VALUES,
    RULES,
    GaugePlan,
    GaugeStudy,
    Interval,
    ParameterQuality,
    QualitySummary,
    Share,
    evaluate_study,
    summarise_quality,
)
from calstation.results import History, refresh_history

#: Width of the tables, characters.
_WIDTH = 170
#: Largest number of failed checks listed.
_MOST_CHECKS = 10


def quality_command(
    product: Path | None,
    serial: str | None,
    parameter: str | None,
    since: datetime | None,
    out: Path,
    json: str | None,
    *,
    relative: bool,
) -> int:
    """Show yield, control charts and capability of the runs of a folder; `since` is a local time without zone.

    `relative` charts deviations in standard deviations, see `calstation.quality.summarise_quality`.
    """
    existing_folder(out)
    _check_parameter(parameter)
    check_json(json)
    begin = None if since is None else since.astimezone()
    with job_progress(say("cli.reading_runs")) as progress:
        refresh_history(ignore_progress, out)
        summary = summarise_quality(progress, out, product, serial, parameter, begin, relative=relative)
    emit_json(summary.to_json(), json)
    if json != "-":
        console = Console(file=sys.stdout, width=_WIDTH)
        _show_summary(console, summary, relative=relative)
        if serial is not None and not History(out).of(serial):
            show_line(console, say("quality.no_run_of_unit", serial=serial, folder=out))
        elif serial is not None and not summary.golden:
            show_line(console, say("quality.few_golden", serial=serial, least=LEAST_VALUES))
    return 0


def plan_command(
    path: Path,
    product: Path | None,
    units: str | None,
    operators: str | None,
    stations: str | None,
    trials: int,
    seed: int,
    json: str | None,
) -> int:
    """Write the plan of a study of a product, and show who measures which unit, where, and in which order.

    `units`, `operators` and `stations` are names separated by commas.
    """
    check_json(json)
    if product is None:
        raise ConfigurationError("quality.plan_without_product")
    parts, people, places = (_names(text) for text in (units, operators, stations))
    if path.exists():
        raise ConfigurationError("quality.plan_exists", file=path)
    name = load_product(product)[1].name
    plan = GaugePlan.random(name, parts, people, places, trials, seed, datetime.now(UTC).replace(microsecond=0))
    plan.save(path)
    emit_json(plan.model_dump(by_alias=True, mode="json"), json)
    if json != "-":
        title = say("cli.plan_title", file=path, runs=len(plan.order), product=name)
        shown = _table(title, "run", "trial", *("serial" if factor == "unit" else factor for factor in plan.factors))
        for number, each in enumerate(plan.order, 1):
            shown.add_row(str(number), str(each.trial), *(getattr(each, factor) for factor in plan.factors))
        Console(file=sys.stdout, width=_WIDTH).print(shown)
    return 0


def study_command(path: Path, product: Path | None, parameter: str | None, out: Path, json: str | None) -> int:
    """Evaluate a study from the stored runs; return 1 if the measurement is unacceptable in a parameter.

    The tolerances are the widths of the limits of the plan's product, whose file may be given as `product`.
    Raises InputError while runs are missing, or if no parameter was solved in all of them.
    """
    existing_folder(out)
    _check_parameter(parameter)
    check_json(json)
    refresh_history(ignore_progress, out)
    state = evaluate_study(ignore_progress, out, path, product)
    state.plan.check_complete(state.left)
    studies = {name: study for name, study in state.studies.items() if parameter in (None, name)}
    if not studies:
        raise InputError("quality.not_measured")
    rows = {
        name: {**asdict(study), "categories": study.categories, "verdict": study.verdict}
        for name, study in studies.items()
    }
    head = {"schema": "calstation.gauge_study/1", "plan": path.name, "product": state.plan.product}
    emit_json({**head, "out_of_order": state.out_of_order, "parameters": rows}, json)
    if json != "-":
        console = Console(file=sys.stdout, width=_WIDTH)
        _show_study(console, state.plan, studies)
        if state.out_of_order:
            runs = len(state.plan.order)
            show_line(console, say("quality.order_not_kept", count=state.out_of_order, runs=runs))
    return 1 if any(study.verdict == "unacceptable" for study in studies.values()) else 0


def _names(text: str | None) -> list[str]:
    return [part.strip() for part in (text or "").split(",") if part.strip()]


def _check_parameter(name: str | None) -> None:
    if name is not None and not _known(name):
        raise ConfigurationError("cli.unknown_choice", option="--parameter", value=name, choices=NAMES)


def _known(name: str) -> bool:
    return name in NAMES or further_parameter(name) is not None


def _show_summary(console: Console, summary: QualitySummary, *, relative: bool) -> None:
    yields = summary.yields
    if yields.overall is None:
        show_line(console, say("quality.no_runs"))
    else:
        show_line(console, say("quality.yield_runs", share=_share(yields.overall)))
    if yields.first_pass is not None:
        show_line(console, say("quality.yield_first", share=_share(yields.first_pass)))
    groups = _table(say("cli.yield"), "", "", "passed", "runs", "percent", "interval")
    for kind in ("products", "stations", "operators"):
        for name, share in getattr(yields, kind).items():
            cells = (str(share.passed), str(share.count), f"{100 * share.value:.1f}", _bounds(share))
            groups.add_row(say(f"cli.of_{kind}"), name, *cells)
    if groups.row_count:
        console.print(groups)
    checks = _table(say("cli.failed_checks"), "check", "runs", "cumulative")
    for check in yields.failed_checks[:_MOST_CHECKS]:
        checks.add_row(check.id.name, str(check.runs), f"{100 * check.cumulative:.0f}")
    if checks.row_count:
        console.print(checks)
    for product in dict.fromkeys(each.product for each in summary.parameters):
        rows = [each for each in summary.parameters if each.product == product]
        _show_charts(console, product, rows, relative=relative)
    for product in dict.fromkeys(each.product for each in summary.golden):
        rows = [each for each in summary.golden if each.product == product]
        title = say("cli.golden_title", serial=summary.serial, product=product)
        _show_charts(console, title, rows, relative=relative)


def _show_charts(console: Console, title: str, rows: Sequence[ParameterQuality], *, relative: bool) -> None:
    """Show center and signals (Nelson's rules N1 to N8) of each parameter, and its capability if it has limits."""
    capable = any(each.capability is not None for each in rows)
    signals = ("moving_range", "ewma", "cusum")
    rules = [Text.of("cli.column_rule", rule=rule) for rule in RULES]
    indices = ("cpk", "interval", "ppk", "interval", "outside", "normal") if capable else ()
    shown = _table(title, "parameter", "count", "limits_from", "center", "sigma", "unit", *rules, *signals, *indices)
    for each in rows:
        center, sigma, unit = each.process.center, each.process.sigma, "σ"
        if not relative:
            (center, unit), (sigma, _) = (display(each.parameter, x) for x in (center, sigma))
        known = term("limits_from", each.process.source, baseline=each.process.baseline)
        cells = [str(len(each.names)), known, number(center, sigma) + "*" * each.declared, f"{sigma:.3g}", unit]
        cells += [str(count) if count else "·" for count in each.alarms.values()]
        if (found := each.capability) is not None:
            normal = say("cli.yes" if found.normal else "cli.no")
            cells += [*_index(found.cpk), *_index(found.ppk), str(found.outside), normal]
        shown.add_row(each.parameter, *cells)
    console.print(shown)
    if any(each.declared for each in rows):
        show_line(console, say("quality.center_declared"))


def _show_study(console: Console, plan: GaugePlan, studies: dict[str, GaugeStudy]) -> None:
    sizes = [say(f"cli.study_{factor}s", count=len(getattr(plan, f"{factor}s"))) for factor in plan.factors]
    title = ", ".join([plan.product, *sizes, say("cli.study_trials", count=plan.trials)])
    parts = [factor for factor in plan.factors[1:] if len(plan.factors) > 2]
    columns = "interval", "pv", "tv", "of_study", "of_tolerance", "categories", "verdict"
    shown = _table(title, "parameter", "unit", "ev", *parts, "av", "interaction", "grr", *columns)
    for name, study in studies.items():
        unit, size = display(name, 1.0)[1], 1.0 / display(name, 1.0)[0]
        of_parts = [study.components[factor] for factor in parts]
        sigmas = [study.repeatability, *of_parts, study.reproducibility, study.interaction, study.gauge]
        cells = [say("cli.pooled") if each is None else f"{each.sigma / size:.3g}" for each in sigmas]
        bounds = interval(f"{study.gauge.low / size:.3g}", f"{study.gauge.high / size:.3g}")
        more = [f"{each.sigma / size:.3g}" for each in (study.part, study.total)]
        tolerance = study.gauge.percent_tolerance
        shares = [f"{study.gauge.percent_study:.1f}", "" if tolerance is None else f"{tolerance:.1f}"]
        few = study.categories < LEAST_CATEGORIES
        categories = say("cli.few_categories", count=study.categories) if few else str(study.categories)
        shown.add_row(name, unit, *cells, bounds, *more, *shares, categories, say(f"cli.gauge_{study.verdict}"))
    console.print(shown)


def _table(title: str, *columns: str | Text) -> Table:
    """Create a table; `columns` are messages, or names of headings without ``cli.column_``."""
    codes = (f"cli.column_{name}" if isinstance(name, str) and name else name for name in columns)
    return table(title, *codes, padding=(0, 1, 0, 0))


def _share(share: Share) -> str:
    return f"{100 * share.value:.1f} % ({_bounds(share)}), n = {share.count}"


def _bounds(share: Share) -> str:
    return interval(f"{100 * share.low:.1f}", f"{100 * share.high:.1f} %")


def _index(index: Interval) -> tuple[str, str]:
    return f"{index.value:.2f}", interval(f"{index.low:.2f}", f"{index.high:.2f}")
