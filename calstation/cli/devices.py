"""`test`, `table` and `check`: test links and show or reset the table without motion, and check configuration files."""

import math
from collections.abc import Mapping
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich.console import Console

from calstation.cli.errors import command_options
from calstation.cli.show import check_json, ignore_progress, report, say
from calstation.config import check, detect_kind, library, line_of, load_station, missing_report_places, read_text
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
from calstation.messages import Report, render, sentence
from calstation.quality import due_certificates
from calstation.records import SUFFIX, is_text
from calstation.results import inspect_recording
from calstation.schema import Problem

_TESTS = {"table": check_table_link, "imu": check_imu_link}
_MARKS = {"ok": "ok", "info": "info", "warning": "WARNING", "error": "ERROR"}


def link_command(device: str, station: Path | None, product: Path | None, json: str | None) -> int:
    """Test a link, or the links of the IMUs in all slots, and show every finding.

    Return the exit code of a device fault if a run would not start.
    """
    check_json(json)
    if device not in _TESTS:
        raise ConfigurationError("cli.unknown_choice", option="DEVICE", value=device, choices=list(_TESTS))
    console = Console(stderr=True)
    last = ""

    def progress(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
        nonlocal last
        if note and note != last:
            last = note
            console.print(say(f"note.{note}"), highlight=False, markup=False, style="dim")

    configured = load_station(station)[1]
    slots = configured.slot_names if device == "imu" else ()
    rows: list[dict[str, Any]] = []
    lines: list[str] = []
    for slot in slots or (None,):
        request = LinkTestRequest(configured, product, slot)
        tested = _TESTS[device](progress, request)
        if device == "table" and product is not None and tested.state != "error":
            more = incompatibilities(link_test_configuration(request))
            tested = replace(tested, findings=(*tested.findings, *more))
        findings, found = _findings(tested, command_options(station, product))
        row = {"device": tested.device, "state": tested.state, "findings": findings}
        rows.append(row if slot is None else {"slot": slot, **row})
        lines += ([] if slot is None else [f"[{slot}]"]) + found
    wrong = next((row["state"] for row in rows if row["state"] != "ok"), "ok")
    report({"device": device, "state": wrong, "slots": rows} if slots else rows[0], json, lines)
    return 0 if wrong == "ok" else DeviceFaultError.exit_code


def _findings(tested: Report, options: Mapping[str, str]) -> tuple[list[dict[str, Any]], list[str]]:
    """Return the findings of a link test for JSON, and as lines of text."""
    findings, lines = [], []
    for finding in tested.findings:
        text = render(finding.message.code, {**finding.message.values, **options})
        findings.append({**finding.to_json(), "text": text.text, "mend": text.remedy})
        lines += [f"{_MARKS[finding.state]:<7} {text.text}", *([f"        {text.remedy}"] if text.remedy else [])]
    return findings, [*lines, say(f"cli.link_{tested.state}")]


def check_command(path: Path, json: str | None) -> int:
    """Show the contents of a recording, or every error in a station, table, IMU or product file.

    Returns 0, or the exit code of a configuration error if there is an error or no method can solve the recording.
    """
    check_json(json)
    if path.suffix == SUFFIX or is_text(path):
        return _check_recording(path, json)
    path = library.locate_any(path)
    text = read_text(path)
    kind = detect_kind(path, text)
    problems = check(kind, text, path)
    if kind == "stations" and not problems:
        section = load_station(path)[1].report
        missing = () if section is None else map(Problem.of, missing_report_places(section, path))
        problems = [*station_conflicts(text), *(replace(each, line=line_of(text, each.place)) for each in missing)]
    rows = [{"line": p.line, "text": p.text} for p in problems]
    lines = [f"{path}:{problem.line}: {problem.text}" for problem in problems]
    valid = [say("cli.file_valid", path=path, kind=kind)]
    overdue = due_certificates(load_station(path)[1], datetime.now(UTC)) if kind == "stations" and not problems else []
    certificates = [{"name": due.name, "since": due.when} for due in overdue]
    valid += [say("cli.standard_certificate", **each) for each in certificates]
    row = {"file": str(path), "kind": kind, "problems": rows}
    report({**row, "overdue": certificates} if certificates else row, json, lines or valid)
    return ConfigurationError.exit_code if problems else 0


def _check_recording(path: Path, json: str | None) -> int:
    found = inspect_recording(path)
    facts, solvable = found.facts, [name for name, reason in found.methods.items() if reason is None]
    reasons = {name: None if reason is None else sentence(reason) for name, reason in found.methods.items()}
    row = {
        "file": str(path),
        "kind": "recording",
        "serial": found.serial,
        "samples": facts.samples,
        "first_seq": facts.first_seq,
        "last_seq": facts.last_seq,
        "rate_hz": None if math.isnan(found.rate) else found.rate,
        "sample_rate_hz": found.configured_rate,
        "jitter_s": found.jitter,
        "gaps": facts.gaps,
        "missing": found.missing,
        "invalid": found.invalid,
        "damaged": facts.damaged,
        "channels": list(found.channels),
        "temperature_c": facts.temperature,
        "stages": found.stages,
        "methods": {name: {"solvable": reason is None, "reason": reason} for name, reason in reasons.items()},
    }
    seconds = (facts.last_seq - facts.first_seq + 1) / found.configured_rate
    times = "sample clock" if not found.jitter else f"times of arrival, jitter {1e3 * found.jitter:.3g} ms rms"
    lines = [
        f"unit       {found.serial}",
        f"samples    {facts.samples}, from {facts.first_seq} to {facts.last_seq}, {seconds:.1f} s",
        f"rate       {found.rate:.6g} Hz ({found.configured_rate:g} Hz configured), {times}",
        f"gaps       {facts.gaps}, {found.missing} samples missing",
        f"invalid    {found.invalid}" + (f", {facts.damaged} damaged rows left out" if facts.damaged else ""),
        f"channels   {', '.join(found.channels)}",
        f"stages     {', '.join(f'{stage} ({count})' for stage, count in found.stages.items()) or 'none'}",
        *(f"{name:<18} {reason or 'can be solved'}" for name, reason in reasons.items()),
    ]
    report(row, json, lines)
    return 0 if solvable else ConfigurationError.exit_code


def status_command(station: Path | None, product: Path | None, json: str | None) -> int:
    """Show the state of the table; return the exit code of a device fault if one is latched."""
    check_json(json)
    request = LinkTestRequest(load_station(station)[1], product)
    state, name = read_table(ignore_progress, request), request.station.name
    report({"station": name, **asdict(state)}, json, [f"station    {name}", *_state_lines(state)])
    return 0 if state.fault is None else DeviceFaultError.exit_code


def reset_command(station: Path | None, product: Path | None, json: str | None) -> int:
    """Reset a latched fault of the table; return the exit code of a device fault if it persists."""
    check_json(json)
    request = LinkTestRequest(load_station(station)[1], product)
    reset, name = reset_table(ignore_progress, request), request.station.name
    words = say(f"reset.{reset.outcome}", **asdict(reset))
    report({"station": name, **asdict(reset)}, json, [f"Table of '{name}': {words}"])
    return 0 if reset.clear else DeviceFaultError.exit_code


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
