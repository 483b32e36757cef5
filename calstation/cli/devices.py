"""`test`, `table` and `check`: links and tables tried without moving anything, files checked as a run reads them."""

import sys
from dataclasses import asdict, replace
from pathlib import Path

from rich.console import Console

from calstation.cli.errors import command_options
from calstation.cli.show import check_json, emit_json, ignore_progress, say, show_line
from calstation.config import check, detect_kind, library, load_station, read_text
from calstation.connection import (
    LinkTestRequest,
    TableState,
    check_imu_link,
    check_table_link,
    incompatibilities,
    link_test_configuration,
    read_table,
    reset_table,
    station_conflicts,
)
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.messages import Finding, Rendered, render

_TESTS = {"table": check_table_link, "imu": check_imu_link}
_MARKS = {"ok": "ok", "told": "", "look": "LOOK", "wrong": "WRONG"}


def link_command(device: str, station: Path | None, product: Path | None, json: str | None) -> int:
    """Test a link and show every finding; the exit code of a device fault if a run would not start."""
    check_json(json)
    if device not in _TESTS:
        raise ConfigurationError("cli.unknown_choice", option="DEVICE", value=device, choices=list(_TESTS))
    console = Console(stderr=True)
    shown: list[str] = []

    def progress(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
        if note and shown[-1:] != [note]:
            shown.append(note)
            console.print(say(f"note.{note}"), highlight=False, markup=False, style="dim")

    request = LinkTestRequest(load_station(station)[1], product)
    report = _TESTS[device](progress, request)
    if device == "table" and product is not None and report.state != "wrong":
        more = incompatibilities(link_test_configuration(request))
        report = replace(report, findings=(*report.findings, *more))
    options = command_options(station, product)
    rendered = [(finding, _render(finding, options)) for finding in report.findings]
    findings = [{**f.to_json(), "text": shown.text, "mend": shown.remedy} for f, shown in rendered]
    emit_json({"device": report.device, "state": report.state, "findings": findings}, json)
    if json != "-":
        out = Console(file=sys.stdout)
        for finding, words in rendered:
            show_line(out, f"{_MARKS[finding.state]:<6} {words.text}")
            if words.remedy:
                show_line(out, f"       {words.remedy}")
        show_line(out, say(f"cli.link_{report.state}"))
    return 0 if report.state == "ok" else DeviceFaultError.exit_code


def check_command(path: Path, json: str | None) -> int:
    """Show all that is wrong in a station, table, IMU or product file; the exit code of a wrong configuration then."""
    check_json(json)
    path = library.locate_any(path)
    text = read_text(path)
    kind = detect_kind(path, text)
    problems = check(kind, text)
    if kind == "stations" and not problems:
        problems = station_conflicts(text)
    rows = [{"line": p.line, "text": p.text} for p in problems]
    emit_json({"file": str(path), "kind": kind, "problems": rows}, json)
    if json != "-":
        out = Console(file=sys.stdout)
        for problem in problems:
            show_line(out, f"{path}:{problem.line}: {problem.text}")
        if not problems:
            show_line(out, say("cli.file_valid", path=path, kind=kind))
    return ConfigurationError.exit_code if problems else 0


def status_command(station: Path | None, product: Path | None, json: str | None) -> int:
    """Show the table's state; the exit code of a device fault if one is latched."""
    check_json(json)
    request = LinkTestRequest(load_station(station)[1], product)
    state = read_table(ignore_progress, request)
    emit_json({"station": request.station.name, **asdict(state)}, json)
    if json != "-":
        show_line(Console(file=sys.stdout), "\n".join([f"station    {request.station.name}", *_state_lines(state)]))
    return 0 if state.fault is None else DeviceFaultError.exit_code


def reset_command(station: Path | None, product: Path | None, json: str | None) -> int:
    """Reset what the table has latched; the exit code of a device fault if it persists."""
    check_json(json)
    request = LinkTestRequest(load_station(station)[1], product)
    result = reset_table(ignore_progress, request)
    emit_json({"station": request.station.name, **asdict(result)}, json)
    if json != "-":
        words = say(f"reset.{result.outcome}", **asdict(result))
        show_line(Console(file=sys.stdout), f"Table of '{request.station.name}': {words}")
    return 0 if result.clear else DeviceFaultError.exit_code


def _render(finding: Finding, options: dict[str, str]) -> Rendered:
    return render(finding.message.code, {**finding.message.values, **options})


def _state_lines(state: TableState) -> list[str]:
    watchdog = {None: "none", 0.0: "OFF"}.get(state.watchdog_s, f"{state.watchdog_s} s")
    axes = ("on" if state.enabled else "off", "homed" if state.homed else "not homed")
    lines = [
        f"{state.model}, serial number {state.serial}",
        f"fault      {state.fault or 'none'}",
        f"interlock  {'closed' if state.interlock_closed else 'OPEN'}",
        f"axes       {', '.join(axes)}, {'moving' if state.moving else 'at rest'}",
        f"watchdog   {watchdog}",
    ]
    if state.outer_deg is not None and state.inner_deg is not None:
        lines.append(f"angles     outer {state.outer_deg:.3f}°, inner {state.inner_deg:.3f}°")
    return lines
