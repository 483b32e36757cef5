"""`test`, `table` and `check`: test links and show or reset the table without motion, and check configuration files."""

import math
from collections.abc import Mapping
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich.console import Console

from calstation.cli.errors import command_options
from calstation.cli.show import check_json, ignore_progress, report
from calstation.cli.text import LANGUAGE, say, sentence
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
from calstation.messages import Report, render
from calstation.quality import due_certificates
from calstation.records import log_format
from calstation.results import inspect_recording
from calstation.schema import Problem

_TESTS = {"table": check_table_link, "imu": check_imu_link}


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
        text = render(finding.message.code, {**finding.message.values, **options}, LANGUAGE)
        findings.append({**finding.to_json(), "text": text.text, "mend": text.remedy})
        lines.append(f"{say(f'cli.finding_{finding.state}'):<7} {text.text}")
        lines += [f"        {text.remedy}"] if text.remedy else []
    return findings, [*lines, say(f"cli.link_{tested.state}")]


def check_command(path: Path, json: str | None) -> int:
    """Show the contents of a recording, or every error in a station, table, IMU or product file.

    Returns 0, or the exit code of a configuration error if there is an error or no method can solve the recording.
    """
    check_json(json)
    if log_format(path) is not None:
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
    times = say("cli.arrival_times" if found.jitter else "cli.sample_clock", jitter=1e3 * (found.jitter or 0.0))
    stages = ", ".join(f"{stage} ({count})" for stage, count in found.stages.items()) or say("cli.none")
    lines = [
        say("cli.recording_unit", **row),
        say("cli.recording_samples", **row, seconds=seconds),
        say("cli.recording_rate", rate=found.rate, configured=found.configured_rate, times=times),
        say("cli.recording_gaps", **row),
        say("cli.recording_damaged" if facts.damaged else "cli.recording_invalid", **row),
        say("cli.recording_channels", **row),
        say("cli.recording_stages", stages=stages),
        *(f"{name:<18} {reason or say('cli.solvable')}" for name, reason in reasons.items()),
    ]
    report(row, json, lines)
    return 0 if solvable else ConfigurationError.exit_code


def status_command(station: Path | None, product: Path | None, json: str | None) -> int:
    """Show the state of the table; return the exit code of a device fault if one is latched."""
    check_json(json)
    request = LinkTestRequest(load_station(station)[1], product)
    state, name = read_table(ignore_progress, request), request.station.name
    report({"station": name, **asdict(state)}, json, [say("cli.table_station", name=name), *_state_lines(state)])
    return 0 if state.fault is None else DeviceFaultError.exit_code


def reset_command(station: Path | None, product: Path | None, json: str | None) -> int:
    """Reset a latched fault of the table; return the exit code of a device fault if it persists."""
    check_json(json)
    request = LinkTestRequest(load_station(station)[1], product)
    reset, name = reset_table(ignore_progress, request), request.station.name
    words = say(f"reset.{reset.outcome}", **asdict(reset))
    report({"station": name, **asdict(reset)}, json, [say("cli.table_reset", station=name, words=words)])
    return 0 if reset.clear else DeviceFaultError.exit_code


def _state_lines(state: TableState) -> list[str]:
    watchdog = {None: say("cli.none"), 0.0: say("cli.switched_off")}.get(state.watchdog_s, f"{state.watchdog_s} s")
    axes = (
        say("cli.axes_on" if state.enabled else "cli.axes_off"),
        say("cli.axes_homed" if state.homed else "cli.axes_not_homed"),
        say("cli.axes_moving" if state.moving else "cli.axes_at_rest"),
    )
    lines = [
        say("cli.table_model", model=state.model, serial=state.serial),
        say("cli.table_fault", fault=state.fault or say("cli.none")),
        say("cli.interlock_closed" if state.interlock_closed else "cli.interlock_open"),
        say("cli.table_axes", axes=axes),
        say("cli.table_watchdog", watchdog=watchdog),
    ]
    if state.outer_deg is not None and state.inner_deg is not None:
        lines.append(say("cli.table_angles", outer=state.outer_deg, inner=state.inner_deg))
    return lines
