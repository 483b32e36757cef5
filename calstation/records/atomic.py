"""Atomic replacement of a file: a reader finds the old or the new content, even after a power failure."""

import os
import secrets
import sys
from contextlib import suppress
from pathlib import Path


def write_atomic(path: Path, content: str | bytes, mode: int = 0o644) -> None:
    """Replace the content of a file by bytes or UTF-8 text. Raises OSError, which leaves the old file unchanged."""
    data = content.encode() if isinstance(content, str) else content
    partial = path.with_name(f".{path.name}.{secrets.token_hex(4)}.partial")
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
    try:
        handle = os.open(partial, flags, mode)
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(handle)
        partial.replace(path)
    except BaseException:
        with suppress(OSError):
            partial.unlink()
        raise
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Write new names in a folder to disk, if the system supports it, so that they survive a power failure."""
    if sys.platform == "win32":
        return  # NTFS preserves the names of flushed files
    with suppress(OSError):  # a network folder may not support it
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
