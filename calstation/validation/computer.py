"""The computer: its clocks, the disks of site and runs, and who may write what."""

import ctypes
import os
import platform
import secrets
import shutil
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Generator
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path

from calstation.config import access, library
from calstation.messages import Text
from calstation.records import audit_path, key_file, locked, sync_folder, verify_trail, write_atomic
from calstation.validation.lines import CheckStopped, Line, guarded

#: Largest resolution of a clock, s, and largest change of the system clock against the monotonic clock, s.
_RESOLUTION, _STEP = 1e-3, 0.1
#: Smallest free space, bytes, and longest time for 4 MiB to reach the disk, s.
_FREE, _SYNC = 1 << 30, 2.0
_BLOCK = 4 << 20
#: Number of replacements of a file while another thread reads it.
_REPLACEMENTS = 100
#: Longest time for the start of a command, s.
_COMMAND = 10.0
#: Result of the system call `adjtimex` for a clock that is not synchronised.
_UNSYNCHRONISED = 5


class SystemClock:
    """Compares the system clock with the monotonic clock from its creation to the end of a validation."""

    def __init__(self) -> None:
        self._begin = time.time() - time.monotonic()

    def lines(self) -> Generator[Line]:
        """Yield the line about a step of the system clock."""
        yield Line.timed("clock", "step", "", time.time() - time.monotonic() - self._begin, _STEP)


def clock_lines() -> Generator[Line]:
    """Check resolution and order of the clocks, the synchronisation, and the date against the audit trail."""
    for name in ("monotonic", "time"):
        resolution, last = time.get_clock_info(name).resolution, -1.0
        backwards, end = False, time.perf_counter() + 0.1
        while time.perf_counter() < end:
            now = getattr(time, name)()
            backwards, last = backwards or now < last, now
        limit = Text.of("validation.resolution", seconds=f"{_RESOLUTION:g}")
        found = Text("validation.backwards") if backwards else f"{resolution:.0e} s"
        yield Line.compared("clock", "resolution", name, limit, found, resolution <= _RESOLUTION and not backwards)
    now = f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC"
    synchronised, error = _synchronisation()
    if synchronised:
        found = Text.of("validation.synchronised", error=f"{error:.3f}", now=now)
        yield Line.measurement("clock", "synchronised", "", Text("validation.time_server"), found, good=True)
    else:
        reason = Text.of("validation.unsynchronised" if synchronised is False else "validation.unknown_clock", now=now)
        yield Line.unchecked("clock", "synchronised", "", Text("validation.time_server"), reason, required=False)
    entries = verify_trail(library.site_folder()).trail.entries
    if entries:
        last_utc = datetime.fromisoformat(entries[-1].utc)
        expected = Text.of("validation.not_before", time=f"{last_utc:%Y-%m-%d %H:%M:%S} UTC")
        good = datetime.now(UTC) >= last_utc - timedelta(seconds=1)
        yield Line.measurement("clock", "date", "", expected, now, good)


def _synchronisation() -> tuple[bool | None, float]:
    """Return whether a time server has set the clock, and its largest error, s; None and 0 if unknown."""
    if platform.system() != "Linux":
        return None, 0.0
    fields = (ctypes.c_long * 64)()  # struct timex: modes, offset, freq, maxerror, ...; modes 0 changes nothing
    try:
        state = ctypes.CDLL(None, use_errno=True).adjtimex(ctypes.byref(fields))
    except (OSError, AttributeError):
        return None, 0.0
    return (None, 0.0) if state < 0 else (state != _UNSYNCHRONISED, fields[3] * 1e-6)


def disk_lines(runs: Path, check_stopped: CheckStopped) -> Generator[Line]:
    """Check the folders of the site and of the runs: free space, synchronous writing, locks, atomic replacement."""
    for name, folder in (("site", library.site_folder()), ("runs", runs)):
        check_stopped()
        yield from guarded("disk", "writing", f"{name}: {folder}", partial(_folder_lines, name, folder))


def _folder_lines(name: str, folder: Path) -> Generator[Line]:
    folder.mkdir(parents=True, exist_ok=True)
    subject = f"{name}: {folder}"
    free = shutil.disk_usage(folder).free
    expected = Text.of("validation.at_least", size=f"{_FREE / 1e9:.1f} GB")
    yield Line.measurement("disk", "space", subject, expected, f"{free / 1e9:.1f} GB", free >= _FREE)
    test = folder / f".validate-{secrets.token_hex(4)}"
    content = secrets.token_bytes(_BLOCK)
    try:
        begin = time.monotonic()
        with test.open("wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        sync_folder(folder)
        seconds = time.monotonic() - begin
        good = test.read_bytes() == content and seconds <= _SYNC
        limit = Text.of("validation.at_most_s", seconds=f"{_SYNC:g}")
        yield Line.measurement("disk", "writing", subject, limit, f"{seconds:.3f} s", good)
        yield _lock_line(subject, test)
        partial = _partial_reads(test)
        yield Line.compared("disk", "replacement", subject, "0", str(partial), partial == 0)
    finally:
        with suppress(OSError):
            test.unlink(missing_ok=True)


def _lock_line(subject: str, test: Path) -> Line:
    """Return whether a locked file cannot be locked again."""
    found = Text("validation.excluded")
    with locked(test, 0.0):
        try:
            with locked(test, 0.0):
                found = Text("validation.not_excluded")
        except TimeoutError:
            pass
    return Line.compared("disk", "lock", subject, Text("validation.excluded"), found, found.code.endswith(".excluded"))


def _partial_reads(test: Path) -> int:
    """Return how often another thread reads a file incompletely while it is replaced."""
    contents = [bytes([letter]) * 65_536 for letter in b"ab"]
    write_atomic(test, contents[0], sync=False)
    done, partial = threading.Event(), []

    def read() -> None:
        while not done.is_set():
            with suppress(PermissionError):  # Windows, at the moment of the replacement
                if test.read_bytes() not in contents:
                    partial.append(1)

    reader = threading.Thread(target=read)
    reader.start()
    try:
        for number in range(_REPLACEMENTS):
            write_atomic(test, contents[number % 2], sync=False)
    finally:
        done.set()
        reader.join()
    return len(partial)


def rights_lines(runs: Path) -> Generator[Line]:
    """Check the audit trail, the PIN, and who may write the site's folder, key and trail, the runs and the program."""
    site = library.site_folder()
    state = verify_trail(site, every_signature=True)
    found = state.faults[0] if state.faults else Text.of("validation.intact", lines=len(state.trail.digests))
    yield Line.measurement("rights", "trail", "", Text("validation.unchanged"), found, not state.faults)
    pin = Text("validation.pin_set" if access.has_pin() else "validation.pin_unset")
    yield Line.compared("rights", "pin", "", Text("validation.pin_set"), pin, pin == Text("validation.pin_set"))
    program = Path(__file__).parent.parent
    paths = {"site": site, "runs": runs, "trail_file": audit_path(site), "key": key_file(site), "program": program}
    if sys.platform == "win32":
        for name, path in paths.items():
            reason = Text("validation.no_modes")
            yield Line.unchecked("rights", name, str(path), Text("validation.owner_writes"), reason, required=False)
        return
    for name, path in paths.items():
        yield from guarded("rights", name, str(path), partial(_mode_line, name, path))


def _mode_line(name: str, path: Path) -> Generator[Line]:
    secret = name == "key"
    expected = Text("validation.owner_reads" if secret else "validation.owner_writes")
    if not path.exists():
        yield Line.unchecked(
            "rights", name, str(path), expected, Text("validation.missing"), required=name in ("site", "runs")
        )
        return
    import grp
    import pwd

    status = path.stat()
    owner, group = str(status.st_uid), str(status.st_gid)
    with suppress(KeyError):
        owner, group = pwd.getpwuid(status.st_uid).pw_name, grp.getgrgid(status.st_gid).gr_name
    forbidden = stat.S_IRWXG | stat.S_IRWXO if secret else stat.S_IWOTH
    good = not status.st_mode & forbidden
    if name in ("site", "runs"):
        good = good and os.access(path, os.W_OK)
    user = Text("validation.this_user" if os.access(path, os.W_OK) else "validation.not_this_user")
    found = Text.of("validation.mode", mode=stat.filemode(status.st_mode), owner=owner, group=group, user=user)
    yield Line.compared("rights", name, str(path), expected, found, good)


def command_lines(check_stopped: CheckStopped) -> Generator[Line]:
    """Measure the start of a command."""
    check_stopped()
    begin = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-m", "calstation", "--version"], capture_output=True, timeout=60.0, check=False
    )
    line = Line.timed("time", "command", "calstation --version", time.monotonic() - begin, _COMMAND)
    yield line if done.returncode == 0 else replace(line, state="failed")
