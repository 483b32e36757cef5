"""Archive of closed logs in a folder, a mounted share or an S3 bucket (fsspec).

The file system finds its own credentials, which for S3 are in the environment or the AWS profile.
"""

import hashlib
import os
import shutil
from contextlib import suppress
from pathlib import Path
from typing import Any

from calstation.database.outbox import ArchivedLog
from calstation.errors import ConfigurationError, InputError
from calstation.jobs import ProgressCallback
from calstation.messages import Text, os_reason
from calstation.records import sync_folder

try:
    from botocore.exceptions import BotoCoreError
    from fsspec import AbstractFileSystem
    from fsspec.core import url_to_fs
    from fsspec.implementations.local import LocalFileSystem
except ImportError as exc:
    raise ConfigurationError("database.not_installed") from exc

#: Number of bytes read at once.
_CHUNK = 8 * 1024 * 1024

#: Errors of an archive that is unreachable, full or refuses access.
_FAILURES = (OSError, BotoCoreError)


def archive_log(log: Path, archive: str, folder: str) -> ArchivedLog:
    """Copy a closed log to a folder in an archive, unless the same bytes are already there.

    The copy is renamed to its final name after its bytes have been read back and compared, so that an interrupted copy
    leaves no file with that name. Raises InputError, after which the copy can be tried again. A missing local path
    is also an error, because an unmounted share must not become a local folder.

    Parameters
    ----------
    log : path of the log
    archive : URL or path of the archive
    folder : name of the folder in the archive
    """
    url = f"{archive.rstrip('/')}/{folder}/{log.name}"
    try:
        files, path = _open(url)
        if isinstance(files, LocalFileSystem) and not files.isdir(_open(archive)[1]):
            raise InputError("database.archive_absent", archive=archive)
        with log.open("rb") as stream:
            location = path if isinstance(files, LocalFileSystem) else url
            copy = ArchivedLog(log.stem, location, _digest(stream), stream.tell())
        if not (files.exists(path) and _digest_at(files, path) == copy.file_sha256):
            _copy(log, files, path, copy)
    except _FAILURES as exc:
        raise InputError("database.archive_failed", log=log.name, archive=archive, reason=_reason(exc)) from exc
    return copy


def copy_from_archive(url: str, target: Path, report: ProgressCallback) -> None:
    """Copy a log from the archive to a file; a failed copy leaves no file. Raises InputError."""
    partial = target.with_name(f".{target.name}.partial")
    try:
        files, path = _open(url)
        size = max(1, files.size(path))
        with files.open(path, "rb", block_size=_CHUNK) as source, partial.open("wb") as copy:
            while chunk := source.read(_CHUNK):
                copy.write(chunk)
                report(copy.tell() / size)
        partial.replace(target)
    except _FAILURES as exc:
        raise InputError("database.log_not_read", log=url, reason=_reason(exc)) from exc


def _copy(log: Path, files: AbstractFileSystem, path: str, copy: ArchivedLog) -> None:
    folder, _, name = path.rpartition("/")
    temporary = f"{folder}/.{name}.partial"
    files.makedirs(folder, exist_ok=True)
    try:
        with log.open("rb") as source, files.open(temporary, "wb", block_size=_CHUNK) as target:
            shutil.copyfileobj(source, target, _CHUNK)
            if isinstance(files, LocalFileSystem):
                target.flush()
                os.fsync(target.fileno())
        if _digest_at(files, temporary) != copy.file_sha256:
            raise InputError("database.copy_damaged", log=copy.url)
        if isinstance(files, LocalFileSystem):
            Path(temporary).replace(path)
            sync_folder(Path(folder))
        else:
            files.mv(temporary, path)
    except BaseException:
        with suppress(*_FAILURES):
            files.rm_file(temporary)
        raise


def _open(url: str) -> tuple[AbstractFileSystem, str]:
    """Return the file system of a URL or path, without a directory cache, and the path in it."""
    try:
        files, path = url_to_fs(url, use_listings_cache=False, skip_instance_cache=True)
    except (ValueError, ImportError) as exc:  # an unknown file system, or one that is not installed
        raise InputError("database.no_archive", url=url, reason=str(exc)) from exc
    return files, path


def _reason(error: Exception) -> Text | str:
    """Return the reason for a failure; a storage service provides its own text."""
    return os_reason(error) if isinstance(error, OSError) and error.errno is not None else str(error)


def _digest_at(files: AbstractFileSystem, path: str) -> str:
    with files.open(path, "rb", block_size=_CHUNK) as stream:
        return _digest(stream)


def _digest(stream: Any) -> str:
    digest = hashlib.sha256()
    while chunk := stream.read(_CHUNK):
        digest.update(chunk)
    return digest.hexdigest()
