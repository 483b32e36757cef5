"""`test` and `check`: a link tried without moving anything, and a file read as a run would read it."""

import sys
from dataclasses import asdict, replace
from pathlib import Path

from rich.console import Console

from calstation.cli.show import check_json, emit_json
from calstation.cli.typed import as_typed
from calstation.config import library
from calstation.config.editing import check, kind_of, read_text
from calstation.config.request import RunRequest
from calstation.config.station import load_station
from calstation.connection.compatibility import incompatibilities
from calstation.connection.link_test import Order, setup_of, try_imu, try_table
from calstation.connection.station_rules import contradictions
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.messages.finding import Finding, Report
from calstation.messages.finding_words import word_finding, word_note

_DEVICES = {"table": try_table, "imu": try_imu}
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

    order = Order(load_station(station)[1], product)
    report = _DEVICES[device](tell, order)
    if device == "table" and product is not None and report.state != "wrong":
        report = replace(report, findings=(*report.findings, *incompatibilities(setup_of(order))))
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
    path = library.anywhere(path)
    text = read_text(path)
    kind = kind_of(path, text)
    problems = check(kind, text)
    if kind == "stations" and not problems:
        problems = contradictions(text)
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
