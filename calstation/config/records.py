"""`[records]` of a station file: the shared database, and the archive of logs."""

import re
from urllib.parse import unquote

from pydantic import Field, field_validator

from calstation.schema import EntryError, StrictModel

#: Schemes of the databases that are supported.
_SCHEMES = ("postgresql+psycopg", "sqlite")

#: ``user:password@`` after the scheme; a password may have any character but @, unlike in a well-formed URL.
_PASSWORD = re.compile(r"[^:/]*:[^@]*@")
#: Key of a URL option that contains a credential; `sslkey` is a path.
_SECRET = re.compile(r"[?&][^=&]*(password|passwd|secret|token)[^=&]*=", re.IGNORECASE)


class RecordsSection(StrictModel):
    """`[records]` of a station; without it, records stay on the computer."""

    #: ``postgresql+psycopg://USER@HOST/NAME`` or ``sqlite:////PATH``, without a password.
    database: str | None = None
    #: Folder or URL for copies of the logs, e.g. ``/mnt/share/logs`` or ``s3://bucket/prefix``, without credentials.
    archive: str | None = Field(default=None, min_length=1)

    @field_validator("database")
    @classmethod
    def _database(cls, url: str | None) -> str | None:
        if url is not None:
            check_database_url(url)
        return url

    @field_validator("archive")
    @classmethod
    def _archive(cls, url: str | None) -> str | None:
        if url is not None and has_password(url):
            raise EntryError("database.password_in_archive")
        return url


def check_database_url(url: str) -> None:
    """Raise EntryError for an unsupported URL, or one with a password; the error does not contain the URL."""
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
    return bool(_PASSWORD.match(rest) or _SECRET.search(unquote(rest)))
