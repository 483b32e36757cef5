"""`validate`: validates the installation on this computer, as a laboratory must before use and after changes."""

import sys
import tempfile
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from calstation.cli.options import JsonOption, command_group
from calstation.cli.show import emit_json, plain_console, show_line
from calstation.cli.text import LANGUAGE, say, term
from calstation.errors import ConfigurationError, StoppedError
from calstation.jobs import on_stop_signals
from calstation.messages import os_reason
from calstation.validation import (
    Validation,
    compare,
    line_name,
    line_texts,
    read_validation,
    row_text,
    save_validation,
    validate_installation,
    write_documents,
)

app = command_group()


@app.command()
def validate(
    out: Annotated[Path, typer.Option("--out", metavar="FOLDER")] = Path("validation"),
    against: Annotated[Path | None, typer.Option(metavar="EARLIER.json")] = None,
    runs: Annotated[Path, typer.Option("--runs", metavar="FOLDER")] = Path("runs"),
    json: JsonOption = None,
) -> int:
    """Run all checks, write the record as JSON and PDF, and show it.

    Returns 0 if all required checks were made and passed, otherwise 1. Raises StoppedError after Ctrl-C.
    """
    if against is not None:
        read_validation(against)  # an altered file is refused before the checks
    _require_writable(out)
    validation = _validate(runs)
    if against is not None:
        validation = compare(validation, against)
    files, unsigned = write_documents(validation)
    save_validation(validation, files, out)
    emit_json(validation.to_json(), json)
    console = plain_console(file=sys.stderr if json == "-" else sys.stdout)
    for line in _lines(validation.to_json()):
        show_line(console, line)
    if unsigned is not None:
        show_line(console, say("cli.validation_unsigned", reason=unsigned))
    for name in files:
        show_line(console, say("cli.validation_file", file=out / name))
    return 0 if validation.verdict == "passed" else 1


def _require_writable(folder: Path) -> None:
    """Create a folder. Raises ConfigurationError if no file can be written to it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as exc:
        raise ConfigurationError("result.unwritable", file=folder, reason=os_reason(exc)) from exc


def _validate(runs: Path) -> Validation:
    """Run all checks and show the progress with the remaining time; the first stop signal ends them."""
    signals: list[bool] = []
    shown: list[str] = []  # areas already shown if there is no terminal

    def check_stopped() -> None:
        if signals:
            raise StoppedError("cli.aborted")

    console = plain_console(stderr=True)
    text, note = TextColumn("{task.description}", markup=False), TextColumn("{task.fields[note]}", markup=False)
    with (
        on_stop_signals(lambda: signals.append(True)),
        Progress(
            text, BarColumn(30), TimeElapsedColumn(), note, console=console, disable=not console.is_terminal
        ) as bar,
    ):
        task = bar.add_task(say("cli.validating"), total=1.0, note="")

        def report(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
            remaining_text = "" if not remaining_s else say("cli.validation_left", seconds=remaining_s)
            area = term("validation_area", note) if note else ""
            bar.update(task, completed=fraction, note=f"{area} {remaining_text}".strip())
            if not console.is_terminal and note and (not shown or shown[-1] != note):
                shown.append(note)
                show_line(console, f"{fraction:.0%} {area}")

        return validate_installation(report, check_stopped, runs)


def _lines(data: dict[str, Any]) -> list[str]:
    """Return all lines of a validation, the differences and the verdict as text."""
    texts = []
    for line in data["lines"]:
        values = {name: text or "–" for name, text in line_texts(line, LANGUAGE).items()}
        texts.append(say("cli.validation_line", state=term("validation_label", line["state"]), **values))
    if data["earlier"]:
        texts.append(say("cli.validation_changes", count=len(data["changes"]), name=data["earlier"]))
        for row in data["changes"]:
            before, after = row_text(row, "before", LANGUAGE), row_text(row, "after", LANGUAGE)
            texts.append(say("cli.validation_change", name=line_name(row, LANGUAGE), before=before, after=after))
    verdict = term("validation_label", f"verdict_{data['verdict']}")
    return [*texts, say("cli.validation_verdict", verdict=verdict, **data["counts"], seconds=data["duration_s"])]
