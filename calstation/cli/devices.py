"""`test` and `check`: a link tried without moving anything, and a file read as a run would read it."""

import sys
from dataclasses import asdict, replace
from pathlib import Path

from rich.console import Console

from calstation.cli.show import check_json, emit_json
from calstation.cli.usage import as_typed
from calstation.cli.wording import RESETS
from calstation.config import library
from calstation.config.editing import check, detect_kind, read_text
from calstation.config.request import RunRequest
from calstation.config.station import load_station
from calstation.connection.compatibility import incompatibilities, station_conflicts
from calstation.connection.link_test import (
    LinkTestRequest,
    check_imu_link,
    check_table_link,
    link_test_configuration,
)
from calstation.connection.table_reset import TableState, read_table, reset_table
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.messages.finding import Finding, Report
from calstation.messages.finding_words import word_finding, word_note

_DEVICES = {"table": check_table_link, "imu": check_imu_link}
_STATES = {"ok": "ok", "told": "", "look": "LOOK", "wrong": "WRONG"}
_VERDICTS = {
    "ok": "The link works.",
    "look": "The link works, but a run would not start like this.",
    "wrong": "Not ready: mend what is marked.",
}
_KINDS = {
    "stations": "a station",
    "tables": "a table profile",
    "imus": "an IMU profile",
    "products": "a product",
}
#: What the window does with a button.
_MENDS = {
    "fault": "Remove its cause, then reset it: calstation table reset",
    "fault_untold": "Read the table's display, remove the cause, then reset it: calstation table reset",
}


def try_command(device: str, station: Path | None, product: Path | None, json: str | None) -> int:
    """Test a link and show line by line what was found; the code of a device fault where a run would not start."""
    check_json(json)
    if device not in _DEVICES:
        raise ConfigurationError(f"DEVICE '{device}' is unknown; choose from {', '.join(_DEVICES)}")
    console = Console(stderr=True)
    told: list[str] = []

    def tell(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
        if note and told[-1:] != [note]:
            told.append(note)
            console.print(word_note(note), highlight=False, markup=False, style="dim")

    order = LinkTestRequest(load_station(station)[1], product)
    report = _DEVICES[device](tell, order)
    if device == "table" and product is not None and report.state != "wrong":
        report = replace(
            report, findings=(*report.findings, *incompatibilities(link_test_configuration(order)))
        )
    where = RunRequest("", station, product)
    emit_json(_plain(report, where), json)
    if json != "-":
        out = Console(file=sys.stdout, soft_wrap=True)
        for finding in report.findings:
            for line in _lines(finding, where):
                out.print(line, highlight=False, markup=False)
        out.print(_VERDICTS[report.state], highlight=False, markup=False)
    return 0 if report.state == "ok" else DeviceFaultError.exit_code


def check_command(path: Path, json: str | None) -> int:
    """Show all that is wrong in a station, table, IMU or product file; the code of a wrong configuration then."""
    check_json(json)
    path = library.locate_any(path)
    text = read_text(path)
    kind = detect_kind(path, text)
    problems = check(kind, text)
    if kind == "stations" and not problems:
        problems = station_conflicts(text)
    found = {
        "file": str(path),
        "kind": kind,
        "problems": [{"line": p.line, "text": p.text} for p in problems],
    }
    emit_json(found, json)
    if json != "-":
        out = Console(file=sys.stdout, soft_wrap=True)
        for problem in problems:
            out.print(f"{path}:{problem.line}: {problem.text}", highlight=False, markup=False)
        if not problems:
            out.print(f"{path}: {_KINDS[kind]}, nothing is wrong with it", highlight=False, markup=False)
    return ConfigurationError.exit_code if problems else 0


def _lines(finding: Finding, where: RunRequest) -> list[str]:
    text, mend = _words(finding, where)
    return [f"{_STATES[finding.state]:<6} {text}", *([f"       {mend}"] if mend else [])]


def _words(finding: Finding, where: RunRequest) -> tuple[str, str]:
    text, mend = word_finding(finding)
    return text, as_typed(_MENDS.get(finding.id, mend), where) if mend else ""


def _plain(report: Report, where: RunRequest) -> dict[str, object]:
    findings = []
    for finding in report.findings:
        text, mend = _words(finding, where)
        findings.append({**asdict(finding), "text": text, "mend": mend})
    return {"device": report.device, "state": report.state, "findings": findings}


def status_command(station: Path | None, product: Path | None, json: str | None) -> int:
    """Show how the table stands; the code of a device fault where one is latched."""
    check_json(json)
    order = _order(station, product)
    standing = read_table(_tell, order)
    emit_json({"station": order.station.name, **asdict(standing)}, json)
    if json != "-":
        _say("\n".join([f"station    {order.station.name}", *_state_lines(standing)]))
    return 0 if standing.fault is None else DeviceFaultError.exit_code


def reset_command(station: Path | None, product: Path | None, json: str | None) -> int:
    """Reset what the table has latched; the code of a device fault where it stays."""
    check_json(json)
    order = _order(station, product)
    result = reset_table(_tell, order)
    emit_json({"station": order.station.name, **asdict(result)}, json)
    if json != "-":
        said = RESETS[result.outcome].format(latched=result.latched, left=result.left, words=result.words)
        _say(f"Table of '{order.station.name}': {said}")
    return 0 if result.clear else DeviceFaultError.exit_code


def _order(station: Path | None, product: Path | None) -> LinkTestRequest:
    return LinkTestRequest(load_station(station)[1], product)


def _state_lines(standing: TableState) -> list[str]:
    watchdog = {None: "none", 0.0: "OFF"}.get(standing.watchdog_s, f"{standing.watchdog_s} s")
    lines = [
        f"{standing.model}, serial number {standing.serial}",
        f"fault      {standing.fault or 'none'}",
        f"interlock  {'closed' if standing.interlock_closed else 'OPEN'}",
        f"axes       {'on' if standing.enabled else 'off'}, {'homed' if standing.homed else 'not homed'},"
        f" {'moving' if standing.moving else 'at rest'}",
        f"watchdog   {watchdog}",
    ]
    if standing.outer_deg is not None and standing.inner_deg is not None:
        lines.append(f"angles     outer {standing.outer_deg:.3f}°, inner {standing.inner_deg:.3f}°")
    return lines


def _say(text: str) -> None:
    Console(file=sys.stdout, soft_wrap=True).print(text, highlight=False, markup=False)


def _tell(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
    """Nothing is shown of works that take seconds."""
