"""Locks on files that the system takes back when their holder dies: no clock says who is alive."""

import errno
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

#: What systems answer where another holds the lock.
_HELD = (errno.EACCES, errno.EAGAIN, errno.EWOULDBLOCK, errno.EDEADLK)

#: Between two tries, s.
_AGAIN_AFTER = 0.02

#: A look at a file takes its lock for a moment: whoever finds it held looks again for so long, s.
_A_LOOK = 0.2

if sys.platform == "win32":
    import msvcrt

    _FAR = 1 << 30
    """The locked byte: nobody else can read it there, so it stands behind all that files of locks contain."""

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
    """Hold the lock on the file `path`, made where it is missing; its content does not matter.

    Raises TimeoutError (an OSError) where another holds it for `within` s, another OSError where the file cannot
    be made or its file system knows no locks.
    """
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
    """Take the lock on an open file until it is closed; False where another holds it for `within` s.

    `shared` : others may share it, where the system knows that

    Raises OSError where the file system knows no locks.
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
        time.sleep(_AGAIN_AFTER)


def held(path: Path) -> bool:
    """Whether somebody holds the lock on a file. Raises OSError where it cannot be opened, or knows no locks."""
    handle = os.open(path, os.O_RDONLY)
    try:
        return not take(handle, _A_LOOK)
    finally:
        os.close(handle)
