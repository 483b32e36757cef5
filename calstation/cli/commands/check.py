"""`check`: shows errors in a configuration file, the contents of a recording, or whether evidence was changed."""

import math
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
from rich.cells import cell_len

from calstation.cli.commands.audit import check_audit, show_evidence
from calstation.cli.options import JsonOption, command_group
from calstation.cli.show import emit
from calstation.cli.text import say, sentence
from calstation.config import check as check_text
from calstation.config import detect_kind, editing, library, line_of, load_station, missing_report_paths, read_text
from calstation.connection import station_conflicts
from calstation.errors import ConfigurationError
from calstation.quality import overdue_instruments
from calstation.records import log_format
from calstation.reports import CertificateState, verify_certificate, verify_reports, verify_time_stamp
from calstation.results import Inspection, check_runs, inspect_recording
from calstation.schema import Problem

app = command_group()


@app.command()
def check(
    file: Annotated[Path | None, typer.Argument(metavar="[FILE]")] = None,
    json: JsonOption = None,
) -> int:
    """Show every error in a configuration file or the contents of a recording, or verify a trail or a certificate.

    Returns 0, or the exit code of a configuration error if there is an error or no method can solve the recording, or
    the exit code of an input error if an audit trail, a certificate or the record of reports was changed.
    """
    if file is None or file.match("audit*.jsonl"):
        return check_audit(file, json)
    if file.suffix in (".pdf", ".xml") or file.match("validation_*.json"):
        return show_evidence(file, verify_certificate(file), json)
    if file.suffix == ".tst":
        return show_evidence(file, verify_time_stamp(file), json)
    if file.name == "reports.jsonl" or file.is_dir():
        folder = file if file.is_dir() else file.parent
        return show_evidence(file, _with_runs(folder, verify_reports(folder)), json)
    if log_format(file) is not None:
        return show_recording(file, inspect_recording(file), json)
    path = library.locate_any(file)
    text = read_text(path)
    kind = detect_kind(path, text)
    problems = check_text(kind, text, path)
    if kind == "stations" and not problems:
        section = load_station(path)[1].report
        missing = () if section is None else map(Problem.of, missing_report_paths(section, path))
        problems = [*station_conflicts(text), *(replace(each, line=line_of(text, each.key_path)) for each in missing)]
    warnings = [] if problems else editing.warnings(kind, text)
    rows = [{"line": p.line, "text": p.text} for p in problems]
    lines = [f"{path}:{problem.line}: {problem.text}" for problem in problems]
    valid = [say("cli.file_valid", path=path, kind=kind)]
    overdue = (
        overdue_instruments(load_station(path)[1], datetime.now(UTC)) if kind == "stations" and not problems else []
    )
    certificates = [{"name": due.name, "since": due.when} for due in overdue]
    valid += [say("cli.standard_certificate", **each) for each in certificates]
    valid += [say("cli.file_warning", place=f"{path}:{each.line}", what=each.text) for each in warnings]
    row = {"file": str(path), "kind": kind, "problems": rows}
    row |= {"warnings": [{"line": each.line, "text": each.text} for each in warnings]} if warnings else {}
    emit({**row, "overdue": certificates} if certificates else row, json, lines or valid)
    return ConfigurationError.exit_code if problems else 0


def _with_runs(folder: Path, state: CertificateState) -> CertificateState:
    """Add contradictions with the runs of a folder to the findings about its record of reports."""
    faults, gaps = check_runs(folder)
    return replace(state, findings=(*state.findings, *faults, *gaps), intact=state.intact and not faults)


def show_recording(path: Path, recording: Inspection, json: str | None) -> int:
    """Show the contents of a recording; return 0, or the exit code of a configuration error if nothing can solve it."""
    facts, solvable = recording.facts, [name for name, reason in recording.methods.items() if reason is None]
    reasons = {name: None if reason is None else sentence(reason) for name, reason in recording.methods.items()}
    row = {
        "file": str(path),
        "kind": "recording",
        "serial": recording.serial,
        "samples": facts.samples,
        "first_seq": facts.first_seq,
        "last_seq": facts.last_seq,
        "rate_hz": None if math.isnan(recording.rate) else recording.rate,
        "sample_rate_hz": recording.configured_rate,
        "jitter_s": recording.jitter,
        "gaps": facts.gaps,
        "missing": recording.missing,
        "invalid": recording.invalid,
        "paused": recording.paused,
        "damaged": facts.damaged,
        "irregular_times": [sentence(text) for text in recording.irregular_times],
        "columns": dict(recording.columns),
        "channels": list(recording.channels),
        "temperature_c": facts.temperature,
        "stages": recording.stages,
        "tested_samples": recording.tested,
        "faults": [sentence(fault) for fault in recording.faults],
        "methods": {name: {"solvable": reason is None, "reason": reason} for name, reason in reasons.items()},
    }
    names = [say(name) if name else "" for name, _ in recording.summary]
    lines = [
        *(
            f"{name}{' ' * (11 - cell_len(name))}{say(text.code, **text.values)}"
            for name, (_, text) in zip(names, recording.summary, strict=True)
        ),
        *(f"{name:<18} {reason or say('look.solvable')}" for name, reason in reasons.items()),
    ]
    emit(row, json, lines)
    return 0 if solvable else ConfigurationError.exit_code
