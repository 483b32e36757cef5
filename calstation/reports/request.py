"""The request for a report: its source, its folder and its options."""

from dataclasses import dataclass
from datetime import date
from pathlib import Path

from calstation.config import Person, ReportSection, plain_text
from calstation.messages import Language


@dataclass(frozen=True)
class ReportRequest:
    """Source, destination and options of a report."""

    source: Path  #: Result JSON, or a log.
    out: Path  #: PDF to write, or the folder for a PDF that is named after the certificate.
    language: Language = "en"
    issued: date | None = None  #: Date of issue; None for `earliest_issue`.
    received: date | None = None  #: Date of receipt of the unit; None for the date in the last issue, if any.
    revise: str | None = None  #: Reason for a new revision; None for no revision.
    templates: Path | None = None  #: Folder of templates that take precedence over the site's templates.
    dcc: Path | None = None  #: File for the digital calibration certificate, which is also embedded in the PDF.
    signing: Path | None = None  #: PKCS #12 file that signs the PDF and `dcc`; None for no signatures.
    first: Person | None = None  #: Person who issues the report; None for the program.
    second: Person | None = None  #: Person who confirms a new certificate, if the product requires it.

    def __post_init__(self) -> None:
        """Remove control characters from the reason."""
        if self.revise is not None:
            object.__setattr__(self, "revise", plain_text(self.revise))


def station_request(
    station: Path, section: ReportSection | None, result_file: Path, language: Language = "en"
) -> ReportRequest:
    """Return the request for a report according to the section `[report]` of a station file.

    By default, the PDF is written to the folder ``certificates`` next to the folder of the runs, in `language`.
    """
    folder = report_folder(station, section) or default_report_folder(result_file.absolute().parent)
    section, station_folder = section or ReportSection(), station.absolute().parent
    if section.language is not None:
        language = "zh_CN" if section.language == "zh" else "en"
    return ReportRequest(
        result_file.absolute(),
        folder,
        language,
        templates=None if section.template is None else _resolve_path(station_folder, section.template),
        signing=None if section.signing is None else _resolve_path(station_folder, section.signing.certificate),
    )


def report_folder(station: Path, section: ReportSection | None) -> Path | None:
    """Return the folder for reports in the section `[report]` of a station file; None if it specifies none."""
    return (
        None if section is None or section.folder is None else _resolve_path(station.absolute().parent, section.folder)
    )


def default_report_folder(runs: Path) -> Path:
    """Return the folder for reports next to a folder of runs."""
    return runs.parent / "certificates"


def _resolve_path(folder: Path, name: str) -> Path:
    return folder / Path(name).expanduser()
