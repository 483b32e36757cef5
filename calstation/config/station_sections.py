"""The sections of a station file: links, site, hand-over, sign-in, certificates and shared database."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal
from urllib.parse import unquote

from pydantic import Field, field_validator, model_validator

from calstation.config.slots import DeviceSection
from calstation.devices.links import host_and_port
from calstation.errors import ConfigurationError
from calstation.records import InstrumentSection as InstrumentSection
from calstation.records import LaboratorySection as LaboratorySection
from calstation.records import SiteSection
from calstation.schema import EntryError, Pattern, StrictModel

#: Difference of ambient temperature and dew point at 75 % of relative humidity, K (Magnus).
_DEW_POINT_SPREAD = 5.0

#: URL schemes of the supported databases.
_SCHEMES = ("postgresql+psycopg", "sqlite")

#: ``user:password@`` after the scheme; unlike in a well-formed URL, a password may contain any character except @.
_PASSWORD = re.compile(r"[^:/]*:[^@]*@")
#: Key of a URL option that contains a credential; `sslkey` is a path.
_CREDENTIAL_KEY = re.compile(r"[?&][^=&]*(password|passwd|secret|token)[^=&]*=", re.IGNORECASE)


class TableLinkSection(DeviceSection):
    """`[table]` of a station: table profile and link; the port of a manual rig is ignored."""

    profile: str
    unit: int | None = Field(default=None, ge=0, le=255)  #: Modbus unit number; default from the profile.


class ChamberLinkSection(DeviceSection):
    """`[chamber]` of a station: chamber profile and link, and the room outside the chamber.

    ambient_c : temperature to which the chamber returns, °C
    dew_point_c : dew point of the room, °C; by default the dew point at 75 % relative humidity
    agreement_c : largest difference of a unit's sensor from the chamber's after a soak, K
    """

    profile: str
    ambient_c: float = Field(default=23.0, ge=5, le=40)
    dew_point_c: float | None = Field(default=None, ge=-40, le=40)
    agreement_c: float = Field(default=10.0, gt=0, le=40)

    @model_validator(mode="after")
    def _check_dew_point(self) -> "ChamberLinkSection":
        if self.dew_point >= self.ambient_c:
            raise EntryError("station.dew_point", "dew_point_c", value=self.dew_point, ambient=self.ambient_c)
        return self

    @property
    def dew_point(self) -> float:
        """Dew point of the room, °C."""
        return self.ambient_c - _DEW_POINT_SPREAD if self.dew_point_c is None else self.dew_point_c


class SecondaryLinkSection(DeviceSection):
    """`[imu2]` and `[imu3]` of a station: the link of a secondary IMU on the same body."""

    profile: str | None = None  #: Name of the IMU profile, by default the product's.
    #: Serial number of a unit that cannot report its own.
    serial_number: str | None = Field(default=None, pattern=r"[A-Za-z0-9][A-Za-z0-9_.-]*")


class HandoverSection(StrictModel):
    """`[handover]` of a station: the existing folder, relative to the station file, that receives results."""

    folder: str = Field(min_length=1)


class LabelSection(StrictModel):
    """`[label]` of a station: address of its label printer, ``tcp://host:port``."""

    printer: str

    @field_validator("printer")
    @classmethod
    def _check_printer(cls, printer: str) -> str:
        if not printer.startswith("tcp://") or host_and_port(printer) is None:
            raise EntryError("station.not_an_address", port=printer, scheme="tcp")
        return printer


class StationSite(SiteSection):
    """`[site]` of a station: its location, and the computers on which the location was confirmed."""

    #: Confirmation keys, see `calstation.config.site_check.confirmation_key`.
    confirmed_on: list[str] = Field(default_factory=list)

    @property
    def location(self) -> SiteSection:
        """The location without the confirmations."""
        return SiteSection.model_validate(self.model_dump(exclude={"confirmed_on"}))


class SignInSection(StrictModel):
    """`[sign_in]` of a station, at which every run requires the badge of its operator."""

    badge_pattern: Pattern  #: Regular expression for the whole badge.
    #: Names by badge; unless empty, other badges are refused.
    names: dict[str, Annotated[str, Field(min_length=1)]] = Field(default_factory=dict)
    #: Badges of the engineers, who override failed units and confirm each other's actions with personal PINs.
    engineers: list[str] = Field(default_factory=list)
    #: Idle time after which the window signs the operator out.
    idle_minutes: float | None = Field(default=None, gt=0, le=1440)

    @model_validator(mode="after")
    def _check_badges(self) -> "SignInSection":
        for badge in self.names:
            if not self.is_badge(badge):
                raise EntryError("station.badge_unlike", "names", badge, badge=badge, pattern=self.badge_pattern)
        for number, badge in enumerate(self.engineers):
            if not self.is_badge(badge):
                raise EntryError("station.badge_unlike", "engineers", number, badge=badge, pattern=self.badge_pattern)
            if self.names and badge not in self.names:
                raise EntryError("station.engineer_unnamed", "engineers", number, badge=badge)
        return self

    def is_badge(self, text: str) -> bool:
        """Return whether a text has the form of a badge."""
        return re.fullmatch(self.badge_pattern, text) is not None

    def knows(self, badge: str) -> bool:
        """Return whether the station accepts a badge: a badge in `names`, or any valid badge if `names` is empty."""
        return badge in self.names if self.names else self.is_badge(badge)

    def operator(self, badge: str | None) -> str:
        """Return the name of the operator with a badge, or the badge if the station lists no names.

        Raises ConfigurationError if the badge is missing or not accepted.
        """
        if not badge:
            raise ConfigurationError("station.badge_missing")
        if not self.knows(badge):
            raise ConfigurationError("station.badge_unknown", badge=badge)
        return self.names.get(badge, badge)

    def person(self, entered: str) -> str:
        """Return how records name a person: by name and badge, or as entered if the station does not know both.

        A name with several badges remains unchanged.
        """
        badges = [badge for badge, name in self.names.items() if entered == (badge if entered in self.names else name)]
        name = self.names[badges[0]] if len(badges) == 1 else entered
        return entered if len(badges) != 1 or name == badges[0] else f"{name} ({badges[0]})"


class SigningSection(StrictModel):
    """`[report.signing]` of a station: the site's certificate for signatures."""

    #: PKCS #12 file, relative to the station file; the environment or the keyring contains its password.
    certificate: str = Field(min_length=1)


class ReportSection(StrictModel):
    """`[report]` of a station: language and templates of its reports, and the folder for automatic reports."""

    #: Existing folder for automatic reports of all verdicts, relative to the station file; None to write none.
    folder: str | None = Field(default=None, min_length=1)
    #: Language of the reports; None for the language of the window that issues the report, or English.
    language: Literal["en", "zh"] | None = None
    #: Folder of the site's templates, relative to the station file; by default ``reports`` in the site's folder.
    template: str | None = Field(default=None, min_length=1)
    signing: SigningSection | None = None  #: None for reports without signatures.


def missing_report_paths(section: ReportSection, station: Path) -> Iterator[EntryError]:
    """Yield errors for missing files and folders named in `[report]` of the station file `station`.

    They are not checked when a station file is read, because they may be on a share that is not mounted.
    """
    beside = station.absolute().parent
    for entry in ("folder", "template"):
        name = getattr(section, entry)
        if name is not None and not (path := beside / Path(name).expanduser()).is_dir():
            yield EntryError("station.no_report_place", "report", entry, path=path)
    if section.signing is not None and not (path := beside / Path(section.signing.certificate).expanduser()).is_file():
        yield EntryError("station.no_report_place", "report", "signing", "certificate", path=path)


class RecordsSection(StrictModel):
    """`[records]` of a station: shared database and archive; without them, records stay on the computer."""

    #: ``postgresql+psycopg://USER@HOST/NAME`` or ``sqlite:////PATH``, without a password.
    database: str | None = None
    #: Folder or URL for copies of the logs, e.g. ``/mnt/share/logs`` or ``s3://bucket/prefix``, without credentials.
    archive: str | None = Field(default=None, min_length=1)

    @field_validator("database")
    @classmethod
    def _check_database(cls, url: str | None) -> str | None:
        if url is not None:
            check_database_url(url)
        return url

    @field_validator("archive")
    @classmethod
    def _check_archive(cls, url: str | None) -> str | None:
        if url is not None and has_password(url):
            raise EntryError("database.password_in_archive")
        return url


def check_database_url(url: str) -> None:
    """Raise EntryError if a URL is not supported or contains a password; the error does not contain the URL."""
    scheme, separator, _ = url.partition("://")
    if not separator:
        raise EntryError("database.no_url")
    if scheme not in _SCHEMES:
        raise EntryError("database.other_kind", kind=scheme)
    if has_password(url):
        raise EntryError("database.password_in_url")


def has_password(url: str) -> bool:
    """Return whether a URL contains a password or another credential; False for a path."""
    rest = url.partition("://")[2]
    return bool(_PASSWORD.match(rest) or _CREDENTIAL_KEY.search(unquote(rest)))
