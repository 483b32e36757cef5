"""Sections of a station file about certificates: the laboratory, its instruments, and the reports."""

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

from pydantic import Field

from calstation.records import InstrumentSection as InstrumentSection
from calstation.records import LaboratorySection as LaboratorySection
from calstation.schema import EntryError, StrictModel


class SigningSection(StrictModel):
    """`[report.signing]` of a station: the site's certificate for signatures."""

    #: PKCS #12 file, relative to the station file; its password is in the environment or in the keyring.
    certificate: str = Field(min_length=1)


class ReportSection(StrictModel):
    """`[report]` of a station: language and templates of its reports, and the folder of automatic ones."""

    #: Existing folder, relative to the station file, for automatic reports of all verdicts; None for no such reports.
    folder: str | None = Field(default=None, min_length=1)
    #: None for English, or for the window's language if the window issues the report.
    language: Literal["en", "zh"] | None = None
    #: Folder with the site's own templates, relative to the station file; default: ``reports`` in the site's folder.
    template: str | None = Field(default=None, min_length=1)
    signing: SigningSection | None = None  #: None for reports without signatures.


def missing_report_places(section: ReportSection, station: Path) -> Iterator[EntryError]:
    """Yield errors for missing files and folders in `[report]` of the station file `station`, which prevent reports.

    The files may be on a share that is currently not mounted, so reading a station file does not check this.
    """
    beside = station.absolute().parent
    for entry in ("folder", "template"):
        name = getattr(section, entry)
        if name is not None and not (path := beside / Path(name).expanduser()).is_dir():
            yield EntryError("station.no_report_place", "report", entry, path=path)
    if section.signing is not None and not (path := beside / Path(section.signing.certificate).expanduser()).is_file():
        yield EntryError("station.no_report_place", "report", "signing", "certificate", path=path)
