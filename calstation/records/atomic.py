"""Writes a file whole or not at all: whoever reads it sees the old content or the new, even after a power cut."""

import os
import secrets
import sys
from contextlib import suppress
from pathlib import Path


def write_atomic(path: Path, content: str | bytes, mode: int = 0o644) -> None:
    """Put `content` (text as UTF-8) in place of the file `path`. Raises OSError, the old file then untouched.

    `mode` : permissions of the new file, which another program may thus never read with wider ones
    """
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
    """Make new names in a folder survive a power cut, where the system can."""
    if sys.platform == "win32":
        return  # its file system keeps the names of files that were flushed
    with suppress(OSError):  # a network folder may not know how, and its names are the server's matter
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
