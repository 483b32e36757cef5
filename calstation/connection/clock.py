"""Station time: the host's monotonic clock, or the virtual time of the bench."""

import json
import socket
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from calstation.errors import DeviceFaultError
from calstation.messages import os_reason

#: Interval at which the devices are polled, s.
TICK = 0.05

#: Polling interval at full speed, s: long, because each tick has a cost, but shorter than the shortest rest that
#: `find_rests` accepts (`REST_WINDOW` of `estimation.common`).
_FAST_TICK = 0.4

#: Timeout for a reply of the bench at full speed, host time in s.
_REPLY_TIMEOUT = 20.0

#: Timeout for reading the samples that the bench has sent, host time in s.
_READ_TIMEOUT = 5.0

#: Host time in which these samples are usually read, s; until then the wait only yields the processor.
_YIELD_TIME = 0.001


class RealClock:
    """Clock whose station time is the host's monotonic time, s."""

    tick = TICK
    speed = 1.0

    def now(self) -> float:
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)

    idle = sleep


class BenchClock:
    """Clock whose station time is the virtual time of the bench.

    `sleep` returns when the IMUs' readers have read every byte that the bench sent up to the new time, so a run does
    not depend on the computer's load. Raises DeviceFaultError if the bench refuses a request or does not reply.

    endpoint : host and port of the clock service
    speed : multiple of real time; 0 if time advances only by `sleep`
    """

    def __init__(self, endpoint: tuple[str, int], speed: float) -> None:
        self.tick = TICK if speed > 0.0 else _FAST_TICK
        self.speed = speed
        self._received: Callable[[], Mapping[int, int]] = dict
        self._lost: Mapping[int, int] = {}  #: Number of bytes that a reader will never receive, by IMU index.
        try:
            self._socket = socket.create_connection(endpoint, timeout=_REPLY_TIMEOUT)
        except OSError as exc:
            raise DeviceFaultError("connection.bench_silent", cause=os_reason(exc)) from exc
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._file = self._socket.makefile("rb")
        self._asking = threading.Lock()  # the result of a unit that leaves a batch is written in another thread
        self._now = float(self._ask({"now": None})["now"])

    def attach(self, received: Callable[[], Mapping[int, int]]) -> None:
        """Make `sleep` wait for the IMUs' readers.

        `received` returns the number of bytes that each reader has read, by the index of the IMU on the bench.
        """
        self._received = received

    def now(self) -> float:
        """Return the virtual time, s; it is queried from the bench if it follows host time."""
        if self.speed > 0.0:
            self._now = float(self._ask({"now": None})["now"])
        return self._now

    def sleep(self, seconds: float) -> None:
        """Advance virtual time by `seconds` and wait until the samples of this interval are read."""
        answer = self._ask({"advance": seconds})
        self._now = float(answer["now"])
        self._wait_for_bytes(answer["bytes"])

    def idle(self, seconds: float) -> None:
        """Wait in host time; virtual time advances only if it follows host time."""
        time.sleep(seconds)

    def order(self, order: Mapping[str, Any]) -> None:
        """Command the bench to inject a fault, immediately or after a delay."""
        self._ask(dict(order))

    def carry(self, outer: float, inner: float, rest: float) -> None:
        """Let the simulated operator turn the manual rig to these angles, rad, and rest there for `rest` s."""
        self._ask({"carry": [outer, inner], "rest": rest})

    def close(self) -> None:
        self._file.close()
        self._socket.close()

    def _wait_for_bytes(self, sent: Sequence[int]) -> None:
        begin = time.monotonic()
        # only for the current link
        lost = {place: count for place, count in self._lost.items() if count <= sent[place]}
        while late := {
            place: sent[place] - count
            for place, count in self._received().items()
            if count + lost.get(place, 0) < sent[place]
        }:
            waited = time.monotonic() - begin
            time.sleep(0.0 if waited < _YIELD_TIME else _YIELD_TIME)
            if waited > _READ_TIMEOUT:  # the sequencer detects the gap
                lost |= late
                break
        self._lost = lost

    def _ask(self, request: dict[str, Any]) -> dict[str, Any]:
        timeout = _REPLY_TIMEOUT
        if self.speed > 0.0 and request.get("advance"):
            timeout += 2.0 * request["advance"] / self.speed
        try:
            with self._asking:
                self._socket.settimeout(timeout)
                self._socket.sendall(json.dumps(request).encode() + b"\n")
                line = self._file.readline()
        except OSError as exc:
            raise DeviceFaultError("connection.bench_lost", cause=os_reason(exc)) from exc
        if not line:
            raise DeviceFaultError("connection.bench_ended")
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            raise DeviceFaultError("connection.bench_refused", detail=answer["error"])
        return answer
