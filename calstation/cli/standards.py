"""`quality standards`: state of check standards and certificates, and charts of the table."""

from collections.abc import Mapping
from datetime import UTC, datetime
from math import degrees
from pathlib import Path
from typing import Any

from calstation.cli.show import check_json, ignore_progress, report
from calstation.cli.text import say
from calstation.config import load_product, load_station
from calstation.judgement import POWER
from calstation.physics import display
from calstation.quality import BASELINE, Due, StandardHistory, StandardState, TableChart, station_quality
from calstation.results import refresh_history


def standards_command(station: Path | None, product: Path | None, out: Path, json: str | None) -> int:
    """Show the check standards of a product, the certificates of a station, and the charts of its table.

    Returns 1 if production is refused, or if a chart has raised an alarm since the table's calibration; otherwise 0.
    """
    check_json(json)
    (_, place), (_, unit) = load_station(station), load_product(product)
    refresh_history(ignore_progress, out)
    found = station_quality(ignore_progress, out, station, product)
    states, overdue, charts = [each.state for each in found.standards], found.overdue, found.table
    powers = [_power(each) for each in found.standards]
    row = {
        **{"station": place.name, "product": unit.name},
        "standards": [{**_state_row(state), "detectable": power} for state, power in zip(states, powers, strict=True)],
        "certificates": [_due_row(due) for due in overdue],
        "table": {name: _chart_row(chart) for name, chart in charts.items()},
    }
    lines = [
        line
        for state, power in zip(states, powers, strict=True)
        for line in (_state_line(state), *_power_lines(state.standard.serial, power))
    ] or [say("cli.no_standards", product=unit.name)]
    lines += [say("cli.standard_certificate", name=due.name, since=due.when) for due in overdue]
    lines += [_chart_line(name, chart) for name, chart in charts.items()]
    alarmed = any(chart.alarms for chart in charts.values())
    lines += [say("cli.table_check")] if alarmed else []
    report(row, json, lines)
    return 1 if alarmed or overdue or any(state.wrong is not None for state in states) else 0


def _state_row(state: StandardState) -> dict[str, Any]:
    return {
        "serial": state.standard.serial,
        "last_passed": _iso(state.last_passed),
        "due": _iso(state.due),
        "wrong": None if state.wrong is None else _due_row(state.wrong),
    }


def _power(history: StandardHistory) -> dict[str, dict[str, float | None]]:
    """Return the errors that the last run would have detected, SI and relative to the product's limits."""
    if not history.verdicts:
        return {}
    halves = history.half_limits
    return {
        name: {"error": error, "of_limit": error / halves[name] if name in halves else None}
        for name, error in history.verdicts[-1].detectable.items()
    }


def _power_lines(serial: str, power: Mapping[str, Mapping[str, float | None]]) -> list[str]:
    """Return a heading and a line for each parameter; none without a run."""
    lines = [say("cli.standard_power", serial=serial, percent=100.0 * POWER)] if power else []
    for name, row in power.items():
        value, unit = display(name, row["error"] or 0.0)
        share = "" if row["of_limit"] is None else say("cli.standard_power_share", percent=100.0 * row["of_limit"])
        lines.append(f"  {name:<20} {value:>9.3g} {unit:<8}{share}".rstrip())
    return lines


def _due_row(due: Due) -> dict[str, Any]:
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
    wrong = state.wrong
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
