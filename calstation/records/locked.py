"""One program at a time: a lock on a file that the system takes back when its holder dies."""

import errno
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_HELD = (errno.EACCES, errno.EAGAIN, errno.EWOULDBLOCK, errno.EDEADLK)
"""What systems answer where another holds the lock."""

_AGAIN_AFTER = 0.02
"""Between two tries, s."""

if sys.platform == "win32":
    import msvcrt

    def _lock(handle: int) -> None:
        os.lseek(handle, 0, os.SEEK_SET)
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)

    def _unlock(handle: int) -> None:
        os.lseek(handle, 0, os.SEEK_SET)
        msvcrt.locking(handle, msvcrt.LK_UNLCK, 1)

else:
    import fcntl

    def _lock(handle: int) -> None:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)

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
        deadline = time.monotonic() + within
        while True:
            try:
                _lock(handle)
                break
            except OSError as exc:
                if exc.errno not in _HELD:
                    raise
                if time.monotonic() > deadline:
                    raise TimeoutError(f"{path} is held by another program") from exc
            time.sleep(_AGAIN_AFTER)
        try:
            yield
        finally:
            _unlock(handle)
    finally:
        os.close(handle)
