"""Starts and ends the process of the virtual bench, which also ends when its input closes."""

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

#: Host time for the bench to start, including its compilation on a new machine, s.
_START_WITHIN = 180.0

_CHECK_INTERVAL = 0.1
_END_WITHIN = 5.0

#: On Windows, keeps Ctrl-C of the console from the bench; elsewhere it inherits that the engine ignores it.
_OWN_GROUP = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)


@dataclass
class BenchHost:
    """The running bench process; `endpoints` is what it announced on its first line."""

    process: subprocess.Popen[bytes]
    endpoints: Mapping[str, Any]

    @classmethod
    def start(cls, config: Mapping[str, Any], check_cancelled: Callable[[], None] = lambda: None) -> "BenchHost":
        """Start a bench; raises DeviceFaultError if it does not. What `check_cancelled` raises meanwhile ends it."""
        command = [sys.executable, "-m", "calstation.bench", "--config", json.dumps(config)]
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            bufsize=0,
            creationflags=_OWN_GROUP,
        )
        assert process.stdout is not None
        lines: SimpleQueue[bytes] = SimpleQueue()
        threading.Thread(target=_read_line, args=(process.stdout, lines), daemon=True).start()
        try:
            line = _first(lines, check_cancelled)
        except BaseException:
            process.kill()
            process.communicate()
            raise
        try:
            endpoints = json.loads(line)
        except ValueError:
            process.kill()
            _, complaint = process.communicate()
            last = complaint.decode(errors="replace").strip().splitlines()[-1:] or ["no message"]
            raise DeviceFaultError("connection.bench_not_started", detail=last[0]) from None
        threading.Thread(target=_discard, args=(process.stderr,), daemon=True).start()
        return cls(process, endpoints)

    def close(self) -> None:
        """End the bench by closing its input; kill it if it does not end."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        try:
            self.process.wait(_END_WITHIN)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        for stream in (self.process.stdout, self.process.stderr):
            if stream is not None:
                stream.close()


def _first(lines: "SimpleQueue[bytes]", check_cancelled: Callable[[], None]) -> bytes:
    """The bench's first line; empty if none comes in time."""
    deadline = time.monotonic() + _START_WITHIN
    while time.monotonic() < deadline:
        check_cancelled()
        with suppress(Empty):
            return lines.get(timeout=_CHECK_INTERVAL)
    return b""


def _read_line(stream: IO[bytes], lines: "SimpleQueue[bytes]") -> None:
    with suppress(OSError, ValueError):  # a stop closed the pipe while the bench was starting
        lines.put(stream.readline())


def _discard(stream: IO[bytes]) -> None:
    """Keep the pipe from filling up."""
    with suppress(OSError, ValueError):
        while stream.read(4096):
            pass
