"""Start and stop of the virtual bench's process, which also exits when its standard input is closed."""

import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import IO, Any

from calstation.errors import DeviceFaultError

#: Timeout for the start of the bench, including compilation on a new machine, host time in s.
_START_TIMEOUT = 180.0

_CHECK_INTERVAL = 0.1
_STOP_TIMEOUT = 15.0  # more than the watchdog timeout of the virtual table, for which a bench with a report waits

#: On Windows, shields the bench from Ctrl-C in the console; on other systems a separate session does.
_CREATION_FLAGS = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)


@dataclass
class BenchHost:
    """A running bench process; `endpoints` is the JSON object that it printed on its first line."""

    process: subprocess.Popen[bytes]
    endpoints: Mapping[str, Any]

    @classmethod
    def start(cls, config: Mapping[str, Any], check_cancelled: Callable[[], None] = lambda: None) -> "BenchHost":
        """Start a bench; raises DeviceFaultError if it fails. The process is killed if `check_cancelled` raises."""
        command = [sys.executable, "-m", "calstation.bench", "--config", json.dumps(config)]
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            bufsize=0,
            creationflags=_CREATION_FLAGS,
            start_new_session=sys.platform != "win32",
        )
        assert process.stdout is not None
        lines: SimpleQueue[bytes] = SimpleQueue()
        threading.Thread(target=_read_line, args=(process.stdout, lines), daemon=True).start()
        try:
            line = _wait_for_line(lines, check_cancelled)
        except BaseException:
            process.kill()
            process.communicate()
            raise
        try:
            endpoints = json.loads(line)
        except ValueError:
            process.kill()
            _, error_output = process.communicate()
            last = error_output.decode(errors="replace").strip().splitlines()[-1:] or ["no message"]
            raise DeviceFaultError("connection.bench_not_started", detail=last[0]) from None
        threading.Thread(target=_discard, args=(process.stderr,), daemon=True).start()
        return cls(process, endpoints)

    def close(self) -> None:
        """Stop the bench by closing its standard input; kill it if it does not exit."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        try:
            self.process.wait(_STOP_TIMEOUT)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        for stream in (self.process.stdout, self.process.stderr):
            if stream is not None:
                stream.close()


def _wait_for_line(lines: "SimpleQueue[bytes]", check_cancelled: Callable[[], None]) -> bytes:
    """Return the bench's first line, or empty bytes if none arrives in time."""
    deadline = time.monotonic() + _START_TIMEOUT
    while time.monotonic() < deadline:
        check_cancelled()
        with suppress(Empty):
            return lines.get(timeout=_CHECK_INTERVAL)
    return b""


def _read_line(stream: IO[bytes], lines: "SimpleQueue[bytes]") -> None:
    with suppress(OSError, ValueError):  # a stop closed the pipe while the bench was starting
        lines.put(stream.readline())


def _discard(stream: IO[bytes]) -> None:
    """Discard the stream so that the pipe does not fill up."""
    with suppress(OSError, ValueError):
        while stream.read(4096):
            pass
