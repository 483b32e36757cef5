"""The logs to solve, from files, folders and URLs or from the archive of the shared database, and their selection."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any, NamedTuple

from sqlalchemy import Engine, select

from calstation.config import has_password
from calstation.database import log_copies, runs
from calstation.errors import ConfigurationError, InputError
from calstation.messages import os_reason
from calstation.records import LogMeta, log_format

#: Name of the source that consists of all logs in the archive of the database.
ARCHIVE = "archive"
#: Properties of a file that change with its content, in various file systems.
_STAMP_PROPERTIES = ("ETag", "etag", "mtime", "LastModified", "last_modified", "modify")


class Origin(NamedTuple):
    """Station, product and start of a log, each None if unknown."""

    station: str | None
    product: str | None
    started_utc: str | None  #: ISO 8601.

    @classmethod
    def of(cls, meta: LogMeta) -> "Origin":
        """Return the origin of a log from its configuration."""
        run, product = meta.run, meta.product
        station, started = (None, None) if run is None else (run.station, run.started_utc)
        return cls(station, None if product is None else product.name, started)


@dataclass(frozen=True)
class Selection:
    """Conditions for the selection of logs, None for no condition; a log whose property is unknown is not selected."""

    station: str | None = None
    product: str | None = None
    since: date | None = None  #: First day of the start, UTC.
    until: date | None = None  #: Last day of the start, UTC.

    def includes(self, origin: Origin) -> bool:
        """Return whether a log is selected."""
        day = (origin.started_utc or "")[:10]
        return (
            self.station in (None, origin.station)
            and self.product in (None, origin.product)
            and (self.since is None or day >= self.since.isoformat())
            and (self.until is None or "" < day <= self.until.isoformat())
        )


@dataclass(frozen=True)
class StoredLog:
    """A log in a file system."""

    location: str  #: Absolute path of a local file, otherwise the URL.
    fingerprint: str | None  #: Stamp of its files, or the digest of the file in the archive; None if unknown.
    sizes: tuple[int | None, ...]  #: Size of each of its files, bytes; None if the file system does not report it.
    file_sha256: str | None = None  #: Digest of the file; None outside the archive.
    origin: Origin | None = None  #: None if it is known only after the log has been read.


def find_logs(sources: Sequence[str], engine: Engine) -> Iterator[StoredLog]:
    """Yield the logs of all sources without duplicates; the logs of a folder are sorted by name.

    Raises ConfigurationError if a source contains a password, or InputError if a source is missing, contains no log or
    is unreachable.
    """
    for source in sources:
        if has_password(source):
            raise ConfigurationError("fleet.password_in_source")
    seen: set[str] = set()
    for source in sources:
        for log in _archived_logs(engine) if source == ARCHIVE else _logs_at(source):
            if log.location not in seen:
                seen.add(log.location)
                yield log


def _archived_logs(engine: Engine) -> Iterator[StoredLog]:
    """Yield the logs of the archive that the database lists, without a request to the archive."""
    is_same_run = (runs.c.outbox == log_copies.c.outbox) & (runs.c.name == log_copies.c.name)
    columns = (log_copies.c.url, log_copies.c.file_sha256, log_copies.c.size, runs.c.started_utc, runs.c.content)
    query = select(*columns).join_from(log_copies, runs, is_same_run).order_by(log_copies.c.url)
    with engine.connect() as connection:
        rows = connection.execute(query).all()
    if not rows:
        raise InputError("fleet.archive_empty")
    for row in rows:
        content = json.loads(row.content)
        origin = Origin(content["station"], content["product"], row.started_utc)
        yield StoredLog(row.url, row.file_sha256, (row.size,), row.file_sha256, origin)


def _logs_at(source: str) -> Iterator[StoredLog]:
    """Yield the logs at a file or folder; one request lists all logs with their sizes and stamps."""
    try:
        system, path = _file_system(source, use_listings_cache=False)
        if not system.exists(path):
            raise InputError("fleet.source_missing", source=source)
        if system.isdir(path):
            files = system.find(path, detail=True)
            logs = [name for name in sorted(files) if log_format(Path(name)) is not None]
            names = [name for name in logs if (configuration_of(name) or name) in files]
        else:
            configuration = configuration_of(path)
            names, existing = [path], [name for name in (path, configuration) if name and system.exists(name)]
            files = {name: system.info(name) for name in existing}
    except (InputError, ConfigurationError):
        raise
    except Exception as exc:  # every file system and every unknown kind of URL has its own errors
        raise InputError("fleet.source_unreachable", source=source, reason=storage_reason(exc)) from exc
    if not names:
        raise InputError("fleet.no_logs", source=source)
    for name in names:
        each = [files.get(file, {}) for file in (name, configuration_of(name)) if file is not None]
        sizes = tuple(info.get("size") for info in each)
        yield StoredLog(_location(system, source, path, name), _fingerprint(each), sizes)


def configuration_of(path: str) -> str | None:
    """Return the path of the configuration next to a CSV log, or None for another file."""
    known = log_format(Path(path))
    if known is None or known.configuration_path is None:
        return None
    folder, slash, name = path.rpartition("/")
    return folder + slash + known.configuration_path(Path(name)).name


def files_of(location: str) -> tuple[Any, list[str]]:
    """Return the file system of a log and the paths of its files. Raises errors of the file system."""
    system, path = _file_system(location)
    configuration = configuration_of(path)
    return system, [path] if configuration is None else [path, configuration]


def _file_system(location: str, **options: bool) -> Any:
    """Return the file system of a path or URL, and the path in it."""
    try:
        from fsspec.core import url_to_fs  # fsspec is an optional dependency
    except ImportError as exc:
        raise ConfigurationError("database.not_installed") from exc
    return url_to_fs(location, **options)


def storage_reason(error: Exception) -> Any:
    """Return the reason for a file system error: the operating system's message or the first line of the error."""
    if isinstance(error, OSError) and error.errno is not None:
        return os_reason(error)
    return str(error).partition("\n")[0] or type(error).__name__


def _location(system: Any, source: str, root: str, name: str) -> str:
    """Return the location of a file below the path `root` of a source, with the host and user in the source's URL."""
    if "file" in system.protocol:
        return str(Path(name).absolute())
    return source.rstrip("/") + name.removeprefix(root.rstrip("/"))


def _fingerprint(files: Sequence[Mapping[str, Any]]) -> str | None:
    """Return a stamp that changes with the files, or None if the file system does not provide one."""
    stamps = [next((info[name] for name in _STAMP_PROPERTIES if info.get(name) is not None), None) for info in files]
    if None in stamps:
        return None
    return " ".join(f"{info.get('size')} {stamp}" for info, stamp in zip(files, stamps, strict=True))
