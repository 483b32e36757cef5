"""Logs to solve: files, folders and URLs, or the archive of the shared database."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sqlalchemy import Engine, select

from calstation.database import log_copies
from calstation.errors import ConfigurationError, InputError
from calstation.messages import os_reason
from calstation.records import SUFFIX, meta_path

try:
    from fsspec.core import url_to_fs
except ImportError as exc:
    raise ConfigurationError("database.not_installed") from exc

#: Source that stands for all logs in the archive of the database.
ARCHIVE = "archive"


@dataclass(frozen=True)
class StoredLog:
    """A log in a file system."""

    location: str  #: Absolute path of a local file, otherwise the URL.
    fingerprint: str | None  #: Stamp of its files; None if they cannot be reached.


def find_logs(sources: Sequence[str], engine: Engine) -> Iterator[StoredLog]:
    """Yield the logs of all sources once, those of a folder in the order of their names.

    Raises InputError for a source that is missing, contains no log or is not reachable.
    """
    seen: set[str] = set()
    for source in sources:
        for location in _archived(engine) if source == ARCHIVE else _locations(source):
            if location not in seen:
                seen.add(location)
                yield StoredLog(location, _fingerprint(location))


def _archived(engine: Engine) -> list[str]:
    with engine.connect() as connection:
        found = list(connection.execute(select(log_copies.c.url).order_by(log_copies.c.url)).scalars())
    if not found:
        raise InputError("fleet.archive_empty")
    return found


def _locations(source: str) -> list[str]:
    try:
        system, path = url_to_fs(source)
        if not system.exists(path):
            raise InputError("fleet.source_missing", source=source)
        if not system.isdir(path):
            return [_location(system, path)]
        names = set(system.find(path))
    except OSError as exc:
        raise InputError("fleet.source_unreachable", source=source, reason=os_reason(exc)) from exc
    except (ValueError, ImportError) as exc:  # an unknown kind of URL, or one whose package is not installed
        raise InputError("fleet.source_unreachable", source=source, reason=str(exc)) from exc
    found = [name for name in sorted(names) if name.endswith(SUFFIX) or configuration_of(name) in names]
    if not found:
        raise InputError("fleet.no_logs", source=source)
    return [_location(system, name) for name in found]


def configuration_of(path: str) -> str | None:
    """Return the path of the TOML file of a CSV; None for another file."""
    if not path.endswith((".csv", ".csv.gz")):
        return None
    folder, slash, name = path.rpartition("/")
    return folder + slash + meta_path(Path(name)).name


def files_of(location: str) -> tuple[Any, list[str]]:
    """Return the file system of a log and the paths of its files. Raises OSError."""
    system, path = url_to_fs(location)
    beside = configuration_of(path)
    return system, [path] if beside is None else [path, beside]


def _location(system: Any, path: str) -> str:
    local = "file" in system.protocol
    return str(Path(path).absolute()) if local else str(system.unstrip_protocol(path))


def _fingerprint(location: str) -> str | None:
    try:
        system, paths = files_of(location)
        if "file" in system.protocol:  # fsspec's stamp changes when the folder is mounted again
            stamps = [Path(path).stat() for path in paths]
            return " ".join(f"{stamp.st_size} {stamp.st_mtime_ns}" for stamp in stamps)
        return " ".join(system.ukey(path) for path in paths)
    except OSError:
        return None
