"""Atomic replacement of files, space on the disk, and file locks that the system releases when the process ends."""

import errno
import os
import secrets
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

#: Permissions of a new file before the umask or the default permissions of its folder restrict them; several accounts
#: may share a folder.
FILE_MODE = 0o666

#: Error numbers for a file that another process has locked.
_LOCKED_ERRORS = (errno.EACCES, errno.EAGAIN, errno.EWOULDBLOCK, errno.EDEADLK)

#: Error numbers of a file system without locks.
NO_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS)

#: Error numbers of a file system that cannot allocate space.
_CANNOT_ALLOCATE = (errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP)

#: Time between two attempts, s.
_RETRY_INTERVAL = 0.02

#: Default time for which `is_locked` retries, s, because another process may acquire the lock briefly to test it.
TEST_TIMEOUT = 0.2

if sys.platform == "win32":
    import msvcrt

    #: Offset of the locked byte, beyond the content of the file, because other processes cannot read a locked byte.
    _LOCK_OFFSET = 1 << 30

    def _lock(handle: int, *, shared: bool) -> None:
        os.lseek(handle, _LOCK_OFFSET, os.SEEK_SET)
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)

    def _unlock(handle: int) -> None:
        os.lseek(handle, _LOCK_OFFSET, os.SEEK_SET)
        msvcrt.locking(handle, msvcrt.LK_UNLCK, 1)

else:
    import fcntl

    def _lock(handle: int, *, shared: bool) -> None:
        fcntl.flock(handle, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)

    def _unlock(handle: int) -> None:
        fcntl.flock(handle, fcntl.LOCK_UN)


@contextmanager
def locked(path: Path, timeout: float) -> Iterator[None]:
    """Lock a file, creating it if necessary. Raises TimeoutError after `timeout` s, or OSError."""
    handle = os.open(path, os.O_RDWR | os.O_CREAT, FILE_MODE)
    try:
        if not acquire_lock(handle, timeout):
            raise TimeoutError(f"{path} is locked by another program")
        yield
    finally:
        with suppress(OSError):  # the file may not be locked
            _unlock(handle)
        os.close(handle)


def acquire_lock(handle: int, timeout: float, *, shared: bool = False) -> bool:
    """Lock an open file until it is closed; return False if another process keeps it locked.

    Raises OSError if the file system supports no locks.

    Parameters
    ----------
    handle : descriptor of the open file
    timeout : longest time to wait, s
    shared : whether to request a shared lock, if the system supports it
    """
    deadline = time.monotonic() + timeout
    while True:
        try:
            _lock(handle, shared=shared)
        except OSError as exc:
            if exc.errno not in _LOCKED_ERRORS:
                raise
            if time.monotonic() >= deadline:
                return False
        else:
            return True
        time.sleep(_RETRY_INTERVAL)


def is_locked(path: Path, timeout: float = TEST_TIMEOUT) -> bool:
    """Return whether a process keeps a file locked for at least `timeout` s.

    Raises OSError if the file cannot be opened or locked.
    """
    if not path.is_file():  # opening a pipe would wait forever
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
    handle = os.open(path, os.O_RDONLY)
    try:
        return not acquire_lock(handle, timeout)
    finally:
        os.close(handle)


def write_atomic(path: Path, content: str | bytes, mode: int = FILE_MODE, *, sync: bool = True) -> None:
    """Replace the content of a file atomically.

    Raises OSError, after which the old file is unchanged.

    Parameters
    ----------
    path : file to replace or create
    content : new content; text is encoded as UTF-8
    mode : permissions of the file
    sync : whether to wait until the content is on disk; otherwise a power failure may leave an empty file
    """
    data = content.encode() if isinstance(content, str) else content
    partial = path.with_name(f".{path.name}.{secrets.token_hex(4)}.partial")
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
    try:
        handle = os.open(partial, flags, mode)
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
            stream.flush()
            if sync:
                os.fsync(handle)
        partial.replace(path)
    except BaseException:
        with suppress(OSError):
            partial.unlink()
        raise
    if sync:
        sync_folder(path.parent)


def partial_path(target: Path) -> Path:
    """Return the path under which a file is written before it is complete."""
    return target.with_name("partial-" + target.name)


def sync_folder(folder: Path) -> None:
    """Write the entries of a folder to disk, if the system supports it, so that new names survive a power failure."""
    if sys.platform == "win32":
        return  # NTFS preserves the names of flushed files
    with suppress(OSError):  # a network folder may not support it
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def free_space(path: Path) -> int:
    """Return the free space on the disk of a file, bytes."""
    return shutil.disk_usage(path.parent).free


def allocate(handle: int, size: int) -> None:
    """Extend a file to at least `size` bytes of allocated space. Raises OSError."""
    present = os.fstat(handle).st_size
    if size <= present:
        return
    try:
        os.posix_fallocate(handle, present, size - present)
    except AttributeError:  # Windows and macOS
        os.ftruncate(handle, size)
    except OSError as exc:
        if exc.errno not in _CANNOT_ALLOCATE:
            raise
        os.ftruncate(handle, size)
