"""Logs of which every call that changes the file fails in turn: `python tests/faults/failing_log.py FOLDER`.

Each is written in a forked process, which must end with an error of the program or none; prints the others.
"""

import ctypes
import errno
import os
import sys
from itertools import product
from pathlib import Path

import numpy as np

from calstation.errors import ConfigurationError, InputError
from calstation.records import LogMeta, RawLogWriter, open_log

sys.path.append(str(Path(__file__).parents[2]))  # as pytest does

from tests.faults.failing_disks import preloaded
from tests.records.records_samples import META, make_block

ROWS = 1500


def write(path: Path) -> None:
    """Write a log with samples, events and a result."""
    writer = RawLogWriter(path, LogMeta.model_validate(META))
    try:
        for k in range(3):
            writer.append(make_block("rate", ROWS * k, ROWS))
            writer.event({"event": "x" * 9000})
            writer.sync()
        writer.add_result({"outcome": "passed"})
    finally:
        writer.close("passed")


def is_intact(path: Path) -> bool:
    """Whether a log contains only samples that were written; a call that failed once may have lost some."""
    try:
        blocks = list(open_log(path).blocks())
    except InputError:
        return True
    written = np.concatenate([make_block("rate", ROWS * k, ROWS).counts for k in range(3)])
    seq, counts = (np.concatenate([getattr(block, name) for block in blocks]) for name in ("seq", "counts"))
    return bool((np.diff(seq) > 0).all() and (counts == written[seq]).all())


def attempt(library: ctypes.CDLL, folder: Path, first: int, number: int, once: int) -> int:
    """Write a log in a forked process, in which a call fails; return its exit status, 0 if all is well."""
    path = folder / f"{first}-{number}-{once}.h5"
    if (pid := os.fork()) == 0:
        code = 1
        try:
            library.failing_disk(str(folder).encode(), ctypes.c_long(first), number, once)
            try:
                write(path)
                calls = library.failing_disk_calls()
                library.failing_disk(b"", ctypes.c_long(0), 0, 0)
                (folder / "calls").write_text(str(calls), "ascii")
                code = 0
            except ConfigurationError:
                library.failing_disk(b"", ctypes.c_long(0), 0, 0)
                code = 0 if not path.exists() or is_intact(path) else 2
        finally:
            os._exit(code)
    status = os.waitpid(pid, 0)[1]
    path.unlink(missing_ok=True)
    return status


def main(folder: Path) -> int:
    """Let every call fail, once and from it on; return the number of processes that crashed or raised another error."""
    library = preloaded()
    attempt(library, folder, 0, 0, 0)
    calls = int((folder / "calls").read_text("ascii"))
    failures = 0
    for first, number, once in product(range(1, calls + 1), (errno.ENOSPC, errno.EIO), (0, 1)):
        if status := attempt(library, folder, first, number, once):
            failures += 1
            print(f"call {first} {errno.errorcode[number]} {'once' if once else 'and all later'}: status {status}")
    print(f"{calls} calls, {failures} failures")
    return failures


if __name__ == "__main__":
    sys.exit(min(1, main(Path(sys.argv[1]))))
