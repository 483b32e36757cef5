"""The process and the clock of a virtual bench, as used by the program that starts the bench."""

import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import IO, Any

from calstation.errors import DeviceFaultError
from calstation.messages import os_reason

#: Timeout for the start of the bench, including compilation on a new machine, host time in s.
_START_TIMEOUT = 180.0

_CHECK_INTERVAL = 0.1
#: Timeout for the exit of the bench, host time in s. A bench with a report first waits for the table's watchdog.
_STOP_TIMEOUT = 15.0

#: Polling interval if the bench follows host time, s, as on hardware.
_TICK = 0.05

#: Polling interval at full speed, s. It is long because ticks take time, but shorter than the shortest rest that
#: `find_rests` accepts (`REST_WINDOW` of `estimation.common`).
_FAST_TICK = 0.4

#: Timeout for a reply of the bench at full speed, host time in s.
_REPLY_TIMEOUT = 20.0

#: Timeout for reading the samples that the bench has sent, host time in s.
_READ_TIMEOUT = 5.0

#: Host time within which these samples are usually read, s; until then, the waiting thread only yields the processor.
_YIELD_TIME = 0.001

#: Flag that prevents Ctrl-C in the console from ending the bench on Windows; other systems use a separate session.
_CREATION_FLAGS = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)


@dataclass
class BenchHost:
    """A running bench process; `endpoints` is the JSON object on its first output line."""

    process: subprocess.Popen[bytes]
    endpoints: Mapping[str, Any]

    @classmethod
    def start(cls, config: Mapping[str, Any], check_cancelled: Callable[[], None] = lambda: None) -> "BenchHost":
        """Start a bench, or kill its process if `check_cancelled` raises. Raises DeviceFaultError."""
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
        if self.process.stdin is not None:
            self.process.stdin.close()
        try:
            self.process.wait(_STOP_TIMEOUT)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        for stream in (self.process.stdout, self.process.stderr):
            if stream is not None:
                stream.close()


class BenchClock:
    """Clock whose station time is the virtual time of the bench.

    `sleep` returns once the IMUs' readers have read every byte that the bench sent up to the new time, so that a run
    does not depend on the computer's load. Raises DeviceFaultError if the bench refuses a request or does not reply.

    endpoint : host and port of the control service
    speed : multiple of real time; 0 if time advances only by `sleep`
    """

    def __init__(self, endpoint: tuple[str, int], speed: float) -> None:
        self.tick = _TICK if speed > 0.0 else _FAST_TICK
        self.speed = speed
        self._received: Callable[[], Mapping[int, int]] = dict
        self._missing: Mapping[int, int] = {}  #: Number of bytes that the readers will never receive, by IMU index.
        try:
            self._socket = socket.create_connection(endpoint, timeout=_REPLY_TIMEOUT)
        except OSError as exc:
            raise DeviceFaultError("connection.bench_silent", cause=os_reason(exc)) from exc
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._file = self._socket.makefile("rb")
        self._request_lock = threading.Lock()  # another thread writes the result of a unit that leaves a batch
        self._now = float(self._request({"now": None})["now"])

    def attach(self, received: Callable[[], Mapping[int, int]]) -> None:
        """Make `sleep` wait for the IMUs' readers.

        `received` returns the number of bytes that each reader has read, by the index of the IMU on the bench.
        """
        self._received = received

    def now(self) -> float:
        """Return the virtual time, s."""
        if self.speed > 0.0:
            self._now = float(self._request({"now": None})["now"])
        return self._now

    def sleep(self, seconds: float) -> None:
        """Advance virtual time by `seconds` and wait until the samples of this interval are read."""
        reply = self._request({"advance": seconds})
        self._now = float(reply["now"])
        self._wait_for_bytes(reply["bytes"])

    def idle(self, seconds: float) -> None:
        """Wait for `seconds` of host time, in which virtual time advances only if it follows host time."""
        time.sleep(seconds)

    def inject(self, command: Mapping[str, Any]) -> None:
        """Make the bench inject a fault, immediately or after a delay; `command` is a `FaultCommand` as JSON data."""
        self._request(dict(command))

    def carry(self, outer: float, inner: float, rest: float) -> None:
        """Make the simulated operator turn the manual rig to the given angles and rest there.

        Parameters
        ----------
        outer, inner : angles of the rails, rad
        rest : duration of the rest, s
        """
        self._request({"carry": [outer, inner], "rest": rest})

    def close(self) -> None:
        """Close the connection; the bench keeps running."""
        self._file.close()
        self._socket.close()

    def _wait_for_bytes(self, sent: Sequence[int]) -> None:
        begin = time.monotonic()
        # only bytes missing on the current link
        missing = {index: count for index, count in self._missing.items() if count <= sent[index]}
        while behind := {
            index: sent[index] - count
            for index, count in self._received().items()
            if count + missing.get(index, 0) < sent[index]
        }:
            waited = time.monotonic() - begin
            time.sleep(0.0 if waited < _YIELD_TIME else _YIELD_TIME)
            if waited > _READ_TIMEOUT:  # the sequencer detects the gap
                missing |= behind
                break
        self._missing = missing

    def _request(self, request: dict[str, Any]) -> dict[str, Any]:
        timeout = _REPLY_TIMEOUT
        if self.speed > 0.0 and request.get("advance"):
            timeout += 2.0 * request["advance"] / self.speed
        try:
            with self._request_lock:
                self._socket.settimeout(timeout)
                self._socket.sendall(json.dumps(request).encode() + b"\n")
                line = self._file.readline()
        except OSError as exc:
            raise DeviceFaultError("connection.bench_lost", cause=os_reason(exc)) from exc
        if not line:
            raise DeviceFaultError("connection.bench_ended")
        reply: dict[str, Any] = json.loads(line)
        if "error" in reply:
            raise DeviceFaultError("connection.bench_refused", detail=reply["error"])
        return reply


def _wait_for_line(lines: "SimpleQueue[bytes]", check_cancelled: Callable[[], None]) -> bytes:
    """Return the bench's first line, or empty bytes if none arrives in time."""
    deadline = time.monotonic() + _START_TIMEOUT
    while time.monotonic() < deadline:
        check_cancelled()
        with suppress(Empty):
            return lines.get(timeout=_CHECK_INTERVAL)
    return b""


def _read_line(stream: IO[bytes], lines: "SimpleQueue[bytes]") -> None:
    with suppress(OSError, ValueError):  # a stop may close the pipe while the bench is starting
        lines.put(stream.readline())


def _discard(stream: IO[bytes]) -> None:
    """Discard the stream so that the pipe does not fill up."""
    with suppress(OSError, ValueError):
        while stream.read(4096):
            pass
