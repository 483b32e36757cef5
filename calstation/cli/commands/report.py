"""`report`: writes the calibration certificate of a result."""

from datetime import date
from pathlib import Path
from typing import Annotated

import typer

from calstation.cli.confirmation import ask_people
from calstation.cli.options import ByOption, ConfirmedByOption, check_choice, command_group, document_file, names_folder
from calstation.cli.show import job_progress, plain_console, show_line
from calstation.cli.text import say, term
from calstation.config import computer_user
from calstation.errors import ConfigurationError
from calstation.messages import Language
from calstation.reports import ReportRequest, certificate_folder, is_searched, issue_report

#: Languages of a report by the value of `--language`.
LANGUAGES: dict[str, Language] = {"en": "en", "zh": "zh_CN"}

app = command_group()


@app.command()
def report(
    source: Annotated[Path, typer.Argument(metavar="RESULT.json|LOG")],
    out: Annotated[str, typer.Option("-o", "--out", metavar="FILE.pdf")],
    language: str = "en",
    issued: Annotated[str | None, typer.Option(metavar="YYYY-MM-DD")] = None,
    received: Annotated[str | None, typer.Option(metavar="YYYY-MM-DD")] = None,
    revise: Annotated[str | None, typer.Option(metavar="REASON")] = None,
    templates: Annotated[Path | None, typer.Option(metavar="DIR")] = None,
    dcc: Annotated[Path | None, typer.Option(metavar="FILE.xml", parser=document_file)] = None,
    sign: Annotated[Path | None, typer.Option(metavar="FILE.p12")] = None,
    by: ByOption = None,
    confirmed_by: ConfirmedByOption = None,
) -> None:
    """Write the certificate for a result or a log, and show its number and verdict. Raises ConfigurationError."""
    check_choice("--language", language, tuple(LANGUAGES))
    pdf = Path(out) if names_folder(out) else document_file(out)
    for file in (pdf, dcc):
        if file is not None and not file.absolute().parent.is_dir():
            raise ConfigurationError("cli.out_unwritable", path=file)
    if dcc is not None and dcc.is_dir():
        raise ConfigurationError("cli.out_unwritable", path=dcc)
    if names_folder(out):
        certificate_folder(pdf)
    days = _day(issued), _day(received)
    people = (None, None) if by == "" else ask_people(by, confirmed_by, computer_user() or "-", reason=revise or "")
    request = ReportRequest(source, pdf, LANGUAGES[language], *days, revise, templates, dcc, sign, *people)
    with job_progress(say("cli.report_budget"), lambda stage: term("stage", stage) if stage else "") as progress:
        certificate, pdf = issue_report(progress, request)
    values = {"file": pdf, "number": certificate.identification, "issued": certificate.issued.isoformat()}
    verdict = term("report_verdict", certificate.verdict)
    show_line(plain_console(stderr=True), say("cli.report_written", **values, verdict=verdict))
    outside = [str(file) for file in (pdf, dcc) if file is not None and not is_searched(file, source)]
    if outside:
        show_line(plain_console(stderr=True), say("cli.report_outside", files=outside))


def _day(text: str | None) -> date | None:
    try:
        return None if text is None else date.fromisoformat(text)
    except ValueError as exc:
        raise ConfigurationError("report.bad_date", value=text) from exc
