"""File locks that the operating system releases when their holder dies."""

import errno
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

#: Error numbers for a lock that another process holds.
_HELD = (errno.EACCES, errno.EAGAIN, errno.EWOULDBLOCK, errno.EDEADLK)

#: Seconds between two attempts.
_RETRY_INTERVAL = 0.02

#: Seconds for which `held` tries: another process that tests the lock holds it for a moment.
_TEST_TIMEOUT = 0.2

if sys.platform == "win32":
    import msvcrt

    #: The locked byte; others cannot read it, so it lies beyond the content of the file.
    _FAR = 1 << 30

    def _lock(handle: int, *, shared: bool) -> None:
        os.lseek(handle, _FAR, os.SEEK_SET)
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)

    def _unlock(handle: int) -> None:
        os.lseek(handle, _FAR, os.SEEK_SET)
        msvcrt.locking(handle, msvcrt.LK_UNLCK, 1)

else:
    import fcntl

    def _lock(handle: int, *, shared: bool) -> None:
        fcntl.flock(handle, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)

    def _unlock(handle: int) -> None:
        fcntl.flock(handle, fcntl.LOCK_UN)


@contextmanager
def locked(path: Path, within: float) -> Iterator[None]:
    """Hold the lock on a file, which is created if missing. Raises TimeoutError after `within` s, or OSError."""
    handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        if not take(handle, within):
            raise TimeoutError(f"{path} is held by another program")
        try:
            yield
        finally:
            _unlock(handle)
    finally:
        os.close(handle)


def take(handle: int, within: float, *, shared: bool = False) -> bool:
    """Take the lock on an open file until it is closed; False if another process held it for `within` s.

    `shared` lets others share it, on systems with shared locks. Raises OSError if the file system has no locks.
    """
    deadline = time.monotonic() + within
    while True:
        try:
            _lock(handle, shared=shared)
        except OSError as exc:
            if exc.errno not in _HELD:
                raise
            if time.monotonic() > deadline:
                return False
        else:
            return True
        time.sleep(_RETRY_INTERVAL)


def held(path: Path) -> bool:
    """Whether a process holds the lock on a file. Raises OSError if it cannot be opened or locked."""
    handle = os.open(path, os.O_RDONLY)
    try:
        return not take(handle, _TEST_TIMEOUT)
    finally:
        os.close(handle)
