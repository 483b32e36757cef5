"""`report`: the calibration certificate of a result."""

from datetime import date
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from calstation.cli.confirmation import ask_people
from calstation.cli.show import show_line
from calstation.cli.text import say, term
from calstation.config import computer_user
from calstation.errors import ConfigurationError
from calstation.messages import Language
from calstation.reports import ReportRequest, issue_report

#: Languages of a report by the value of `--language`.
LANGUAGES: dict[str, Language] = {"en": "en", "zh": "zh_CN"}


def report_command(
    source: Path,
    out: Path,
    language: str,
    issued: str | None,
    received: str | None,
    revise: str | None,
    templates: Path | None,
    dcc: Path | None,
    sign: Path | None,
    by: str | None,
    confirmed_by: str | None,
) -> int:
    """Write the certificate of a result or log, and show its number and verdict."""
    if language not in LANGUAGES:
        raise ConfigurationError("cli.unknown_choice", option="--language", value=language, choices=list(LANGUAGES))
    for file in (out, dcc):
        if file is not None and not file.absolute().parent.is_dir():
            raise ConfigurationError("cli.out_unwritable", path=file)
    if dcc is not None and dcc.is_dir():
        raise ConfigurationError("cli.out_unwritable", path=dcc)
    days = _day(issued), _day(received)
    people = (None, None) if by == "" else ask_people(by, confirmed_by, computer_user() or "-")
    request = ReportRequest(source, out, LANGUAGES[language], *days, revise, templates, dcc, sign, *people)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(say("cli.report_budget"), total=1.0)

        def show(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
            stage = term("stage", note) if note else ""
            bar.update(task, completed=fraction, description=f"{say('cli.report_budget')} {stage}".strip())

        certificate, pdf = issue_report(show, request)
    values = {"file": pdf, "number": certificate.identification, "issued": certificate.issued.isoformat()}
    show_line(console, say("cli.report_written", **values, verdict=term("report_verdict", certificate.verdict)))
    return 0


def _day(text: str | None) -> date | None:
    try:
        return None if text is None else date.fromisoformat(text)
    except ValueError as exc:
        raise ConfigurationError("report.bad_date", value=text) from exc
