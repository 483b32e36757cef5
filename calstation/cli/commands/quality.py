"""`quality`: shows statistics of stored runs, gauge studies, and the state of check standards and certificates."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from math import degrees
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from calstation.cli.options import (
    JsonOption,
    ProductOption,
    StationOption,
    check_choice,
    command_group,
    existing_folder,
    refuse_options_before,
)
from calstation.cli.show import (
    emit,
    emit_json,
    ignore_progress,
    interval,
    job_progress,
    new_table,
    plain_console,
    show_line,
)
from calstation.cli.text import say, sentence, term
from calstation.config import load_product, load_station
from calstation.errors import ConfigurationError, InputError
from calstation.judgement import POWER
from calstation.messages import Text
from calstation.physics import NAMES, display, further_parameter, number
from calstation.quality import (
    BASELINE,
    COMMON_SCALE,
    MIN_CATEGORIES,
    MIN_VALUES,
    RULES,
    GaugePlan,
    GaugeStudy,
    Interval,
    ParameterQuality,
    QualitySummary,
    Share,
    StandardHistory,
    StandardProblem,
    StandardState,
    TableChart,
    due_certificates,
    evaluate_study,
    overdue_instruments,
    station_quality,
    summarise_quality,
)
from calstation.results import History, refresh_history

#: Width of the tables, characters.
_WIDTH = 170
#: Largest number of failed checks listed.
MAX_CHECKS = 10


FolderOption = Annotated[Path, typer.Option("--out")]
ParameterOption = Annotated[str | None, typer.Option(metavar="NAME")]

app = command_group()


@app.callback(invoke_without_command=True, no_args_is_help=False)
def quality(
    context: typer.Context,
    product: ProductOption = None,
    serial: str | None = None,
    parameter: ParameterOption = None,
    since: Annotated[datetime | None, typer.Option(formats=["%Y-%m-%d"], metavar="DATE")] = None,
    relative: Annotated[bool, typer.Option("--relative")] = False,
    out: FolderOption = Path("runs"),
    json: JsonOption = None,
) -> None:
    """Show yield, control charts and capability of the runs of a folder.

    `since` is a local time without a time zone. If `relative`, the charts show deviations in standard deviations, see
    `calstation.quality.summarise_quality`. Raises ConfigurationError for an option before a command of the group.
    """
    if context.invoked_subcommand is not None:
        refuse_options_before(context)
        return
    existing_folder(out)
    _check_parameter(parameter, COMMON_SCALE)
    begin = None if since is None else since.astimezone()
    with job_progress(say("cli.reading_runs")) as progress:
        refresh_history(ignore_progress, out)
        summary = summarise_quality(progress, out, product, serial, parameter, begin, relative=relative)
    emit_json(summary.to_json(), json)
    if json != "-":
        console = plain_console(file=sys.stdout, width=_WIDTH)
        _show_summary(console, summary, relative=relative)
        if serial is not None and not History(out).of(serial):
            show_line(console, say("quality.no_run_of_unit", serial=serial, folder=out))
        elif serial is not None and not summary.single_unit:
            show_line(console, say("quality.few_standard_runs", serial=serial, least=MIN_VALUES))


@app.command()
def gauge(
    path: Annotated[Path, typer.Argument(metavar="PLAN.json")],
    plan: Annotated[bool, typer.Option("--plan")] = False,
    units: Annotated[str | None, typer.Option(metavar="A,B,...")] = None,
    operators: Annotated[str | None, typer.Option(metavar="A,B,...")] = None,
    stations: Annotated[str | None, typer.Option(metavar="A,B,...")] = None,
    trials: Annotated[int, typer.Option(min=2)] = 3,
    seed: Annotated[int, typer.Option(min=0)] = 1,
    product: ProductOption = None,
    parameter: ParameterOption = None,
    out: FolderOption = Path("runs"),
    json: JsonOption = None,
) -> int:
    """Plan a study of repeatability and reproducibility (GR&R), or evaluate it from the stored runs.

    Returns 1 if the measurement of a parameter is unacceptable.
    """
    if not plan:
        return _evaluate(path, product, parameter, out, json)
    if product is None:
        raise ConfigurationError("quality.plan_without_product")
    unit_names, operator_names, station_names = (
        [part.strip() for part in (text or "").split(",") if part.strip()] for text in (units, operators, stations)
    )
    if path.exists():
        raise ConfigurationError("quality.plan_exists", file=path)
    name = load_product(product)[1].name
    gauge_plan = GaugePlan.random(
        name, unit_names, operator_names, station_names, trials, seed, datetime.now(UTC).replace(microsecond=0)
    )
    gauge_plan.save(path)
    emit_json(gauge_plan.model_dump(by_alias=True, mode="json"), json)
    if json != "-":
        title = say("cli.plan_title", file=path, runs=len(gauge_plan.order), product=name)
        table = _table(
            title, "run", "trial", *("serial" if factor == "unit" else factor for factor in gauge_plan.factors)
        )
        for number, each in enumerate(gauge_plan.order, 1):
            table.add_row(str(number), str(each.trial), *(getattr(each, factor) for factor in gauge_plan.factors))
        plain_console(file=sys.stdout, width=_WIDTH).print(table)
    return 0


def _evaluate(path: Path, product: Path | None, parameter: str | None, out: Path, json: str | None) -> int:
    """Evaluate a study from the stored runs.

    The tolerances are the widths of the limits of the plan's product, whose file may be given as `product`.
    Raises InputError if runs are missing, or if no parameter was solved in all of them.
    """
    existing_folder(out)
    _check_parameter(parameter)
    state = evaluate_study(ignore_progress, out, path, product)
    note = state.simulated.text
    if note is not None and json != "-":
        show_line(plain_console(file=sys.stdout, width=_WIDTH), sentence(note))
    state.plan.check_complete(state.missing)
    studies = {name: study for name, study in state.studies.items() if parameter in (None, name)}
    if not studies:
        raise InputError("quality.not_measured")
    rows = {
        name: {
            **asdict(study),
            "categories": study.categories,
            "verdict": study.verdict,
            "ranges_beyond": state.beyond(name),
        }
        for name, study in studies.items()
    }
    head = {"schema": "calstation.gauge_study/1", "plan": path.name, "product": state.plan.product}
    notes = {"out_of_order": state.out_of_order, "simulated": state.simulated.to_json()}
    emit_json({**head, **notes, "parameters": rows}, json)
    if json != "-":
        console = plain_console(file=sys.stdout, width=_WIDTH)
        _show_study(console, state.plan, studies)
        for name, row in rows.items():
            if count := row["ranges_beyond"]:
                show_line(console, f"{name}: {say('quality.ranges_beyond', count=count)}")
        if state.out_of_order:
            runs = len(state.plan.order)
            show_line(console, say("quality.order_not_kept", count=state.out_of_order, runs=runs))
    return 1 if any(study.verdict == "unacceptable" for study in studies.values()) else 0


def _check_parameter(name: str | None, *others: str) -> None:
    if name is not None and further_parameter(name) is None:
        check_choice("--parameter", name, (*NAMES, *others))


def _show_summary(console: Console, summary: QualitySummary, *, relative: bool) -> None:
    yields = summary.yields
    if summary.simulated.text is not None:
        show_line(console, sentence(summary.simulated.text))
    if yields.overall is None:
        show_line(console, say("quality.no_runs"))
    else:
        show_line(console, say("quality.yield_runs", share=_share_text(yields.overall)))
    if yields.missing:
        show_line(console, say("quality.yield_missing", count=yields.missing))
    if yields.units is not None:
        show_line(console, say("quality.yield_units", share=_share_text(yields.units)))
    if yields.first_pass is not None:
        show_line(console, say("quality.yield_first", share=_share_text(yields.first_pass)))
    groups = _table(say("cli.yield"), "", "", "passed", "runs", "percent", "interval")
    for kind in ("products", "stations", "operators"):
        for name, share in getattr(yields, kind).items():
            cells = (str(share.passed), str(share.count), f"{100 * share.value:.1f}", _bounds(share))
            groups.add_row(say(f"cli.of_{kind}"), name, *cells)
    if groups.row_count:
        console.print(groups)
    checks = _table(say("cli.failed_checks"), "check", "runs", "cumulative")
    for check in yields.failed_checks[:MAX_CHECKS]:
        checks.add_row(check.id.name, str(check.runs), f"{100 * check.cumulative:.0f}")
    if checks.row_count:
        console.print(checks)
    for product in dict.fromkeys(each.product for each in summary.parameters):
        rows = [each for each in summary.parameters if each.product == product]
        _show_charts(console, product, rows, relative=relative)
    for product in dict.fromkeys(each.product for each in summary.single_unit):
        rows = [each for each in summary.single_unit if each.product == product]
        title = say("cli.standard_title", serial=summary.serial, product=product)
        _show_charts(console, title, rows, relative=relative)


def _show_charts(console: Console, title: str, rows: Sequence[ParameterQuality], *, relative: bool) -> None:
    """Show center and signals (Nelson's rules N1 to N8) of each parameter, and its capability if it has limits."""
    capable = any(each.capability is not None for each in rows)
    signals = ("moving_range", "ewma", "cusum")
    rules = [Text.of("cli.column_rule", rule=rule) for rule in RULES]
    indices = ("cpk", "interval", "ppk", "interval", "outside", "normal") if capable else ()
    table = _table(title, "parameter", "count", "limits_from", "center", "sigma", "unit", *rules, *signals, *indices)
    for each in rows:
        center, sigma, unit = each.process.center, each.process.sigma, "σ"
        if not relative:
            (center, unit), (sigma, _) = (display(each.parameter, x) for x in (center, sigma))
        source = term("limits_from", each.process.source, baseline=each.process.baseline)
        cells = [str(len(each.names)), source, number(center, sigma) + "*" * each.declared, f"{sigma:.3g}", unit]
        cells += [str(count) if count else "·" for count in each.alarms.values()]
        if (capability := each.capability) is not None:
            normal = say("cli.yes" if capability.normal else "cli.no")
            cells += [*_index_text(capability.cpk), *_index_text(capability.ppk), str(capability.outside), normal]
        table.add_row(each.parameter, *cells)
    console.print(table)
    if any(each.declared for each in rows):
        show_line(console, say("quality.center_declared"))


def _show_study(console: Console, plan: GaugePlan, studies: dict[str, GaugeStudy]) -> None:
    sizes = [say(f"cli.study_{factor}s", count=len(getattr(plan, f"{factor}s"))) for factor in plan.factors]
    title = ", ".join([plan.product, *sizes, say("cli.study_trials", count=plan.trials)])
    parts = [factor for factor in plan.factors[1:] if len(plan.factors) > 2]
    columns = "interval", "pv", "tv", "of_study", "of_tolerance", "categories", "verdict"
    table = _table(title, "parameter", "unit", "ev", *parts, "av", "interaction", "grr", *columns)
    for name, study in studies.items():
        unit, size = display(name, 1.0)[1], 1.0 / display(name, 1.0)[0]
        factor_components = [study.components[factor] for factor in parts]
        sigmas = [study.repeatability, *factor_components, study.reproducibility, study.interaction, study.gauge]
        cells = [say("cli.pooled") if each is None else f"{each.sigma / size:.3g}" for each in sigmas]
        bounds = interval(f"{study.gauge.low / size:.3g}", f"{study.gauge.high / size:.3g}")
        part_and_total = [f"{each.sigma / size:.3g}" for each in (study.part, study.total)]
        tolerance = study.gauge.percent_tolerance
        shares = [f"{study.gauge.percent_study:.1f}", "" if tolerance is None else f"{tolerance:.1f}"]
        is_few = study.categories < MIN_CATEGORIES
        categories = say("cli.few_categories", count=study.categories) if is_few else str(study.categories)
        table.add_row(
            name, unit, *cells, bounds, *part_and_total, *shares, categories, say(f"cli.gauge_{study.verdict}")
        )
    console.print(table)


def _table(title: str, *columns: str | Text) -> Table:
    """Create a table; `columns` are the headings: messages, or codes without the prefix ``cli.column_``."""
    codes = (f"cli.column_{name}" if isinstance(name, str) and name else name for name in columns)
    return new_table(title, *codes, padding=(0, 1, 0, 0))


def _share_text(share: Share) -> str:
    return f"{100 * share.value:.1f} % ({_bounds(share)}), n = {share.count}"


def _bounds(share: Share) -> str:
    return interval(f"{100 * share.low:.1f}", f"{100 * share.high:.1f} %")


def _index_text(index: Interval) -> tuple[str, str]:
    return f"{index.value:.2f}", interval(f"{index.low:.2f}", f"{index.high:.2f}")


@app.command()
def standards(
    station: StationOption = None,
    product: ProductOption = None,
    out: FolderOption = Path("runs"),
    json: JsonOption = None,
) -> int:
    """Show the check standards of a product, the certificates of a station, and the charts of its table.

    Returns 1 if production is refused, or if a chart has raised an alarm since the table's calibration; otherwise 0.
    """
    (_, station_config), (_, product_config) = load_station(station), load_product(product)
    refresh_history(ignore_progress, out)
    quality_state = station_quality(ignore_progress, out, station, product)
    states, charts = [each.state for each in quality_state.standards], quality_state.table
    now = datetime.now(UTC)
    overdue, refused = overdue_instruments(station_config, now), due_certificates(station_config, now)
    powers = [_power(each) for each in quality_state.standards]
    row = {
        **{"station": station_config.name, "product": product_config.name},
        "standards": [{**_state_row(state), "detectable": power} for state, power in zip(states, powers, strict=True)],
        "certificates": [_due_row(due) for due in overdue],
        "table": {name: _chart_row(chart) for name, chart in charts.items()},
    }
    lines = [] if station else [say("cli.default_station", station=station_config.name)]
    lines += [
        line
        for state, power in zip(states, powers, strict=True)
        for line in (_state_line(state), *_power_lines(state.standard.serial, power))
    ] or [say("cli.no_standards", product=product_config.name)]
    lines += [say("cli.standard_certificate", name=due.name, since=due.when) for due in overdue]
    lines += [_chart_line(name, chart) for name, chart in charts.items()]
    alarmed = any(chart.alarms for chart in charts.values())
    lines += [say("cli.table_check")] if alarmed else []
    emit(row, json, lines)
    return 1 if alarmed or refused or any(state.problem is not None for state in states) else 0


def _state_row(state: StandardState) -> dict[str, Any]:
    return {
        "serial": state.standard.serial,
        "last_passed": _iso(state.last_passed),
        "due": _iso(state.due),
        "wrong": None if state.problem is None else _due_row(state.problem),
    }


def _power(history: StandardHistory) -> dict[str, dict[str, float | None]]:
    """Return the smallest errors that the last run would have detected, in SI and relative to the product's limits."""
    if not history.verdicts:
        return {}
    halves = history.half_limits
    return {
        name: {"error": error, "of_limit": error / halves[name] if name in halves else None}
        for name, error in history.verdicts[-1].detectable.items()
    }


def _power_lines(serial: str, power: Mapping[str, Mapping[str, float | None]]) -> list[str]:
    """Return a heading and a line for each parameter, or no lines if there is no run."""
    lines = [say("cli.standard_power", serial=serial, percent=100.0 * POWER)] if power else []
    for name, row in power.items():
        value, unit = display(name, row["error"] or 0.0)
        share = "" if row["of_limit"] is None else say("cli.standard_power_share", percent=100.0 * row["of_limit"])
        lines.append(f"  {name:<20} {value:>9.3g} {unit:<8}{share}".rstrip())
    return lines


def _due_row(due: StandardProblem) -> dict[str, Any]:
    return {"name": due.name, "reason": due.reason, "since": _iso(due.since)}


def _chart_row(chart: TableChart) -> Mapping[str, Any]:
    return {
        **{"runs": len(chart.values), "center": chart.center, "sigma": chart.sigma, "last": float(chart.values[-1])},
        "baseline": chart.baseline,
        "alarms": [{"run": chart.names[k], "started_utc": _iso(_start(chart, k))} for k in chart.alarms],
    }


def _start(chart: TableChart, k: int) -> datetime:
    return datetime.fromtimestamp(float(chart.started[k]), UTC)


def _state_line(state: StandardState) -> str:
    wrong = state.problem
    values = {"name": state.standard.serial, "due": _minute(state.due), "last": _minute(state.last_passed)}
    return say(f"cli.standard_{'ok' if wrong is None else wrong.reason}", **values, since=wrong.when if wrong else "")


def _chart_line(name: str, chart: TableChart) -> str:
    arcsec = {key: 3600.0 * degrees(getattr(chart, key)) for key in ("center", "sigma")}
    values = {"quantity": name, "runs": len(chart.values), "last": 3600.0 * degrees(float(chart.values[-1])), **arcsec}
    if len(chart.values) == chart.baseline:
        return say("cli.table_baseline", **values, baseline=BASELINE)
    if not chart.alarms:
        return say("cli.table_chart", **values)
    return say("cli.table_alarm", **values, alarms=len(chart.alarms), when=_minute(_start(chart, chart.alarms[-1])))


def _iso(time: datetime | None) -> str | None:
    return None if time is None else time.isoformat(timespec="seconds")


def _minute(time: datetime | None) -> str:
    return "" if time is None else f"{time.astimezone():%Y-%m-%d %H:%M}"
