"""Station time: the host's monotonic clock, or the virtual time of the bench."""

import json
import socket
import time
from collections.abc import Callable, Mapping
from typing import Any

from calstation.errors import DeviceFaultError
from calstation.messages import os_reason

#: Interval at which the devices are polled, s.
TICK = 0.05

#: The same at full speed: longer, since each tick costs work, but shorter than the shortest rest whose angles are used.
_FAST_TICK = 0.4

#: Host time allowed for an answer of the bench at its fastest, s.
_ANSWER_WITHIN = 20.0

#: Host time in which the samples of the bench must have been read, s.
_SAMPLES_WITHIN = 5.0

#: Host time within which they are usually read; until then the processor is only yielded, s.
_YIELD_FOR = 0.001


class RealClock:
    """Station time is host time."""

    tick = TICK

    def now(self) -> float:
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)

    idle = sleep


class BenchClock:
    """Station time is the bench's virtual time, which advances only with the station.

    `sleep` returns when the IMU reader has read every byte that the bench sent up to the new time, so a run does not
    depend on the load of the computer.

    speed : multiple of real time; 0 if time advances only by `sleep`
    """

    def __init__(self, endpoint: tuple[str, int], speed: float) -> None:
        self.tick = TICK if speed > 0.0 else _FAST_TICK
        self._speed = speed
        self._received: Callable[[], int] | None = None
        try:
            self._socket = socket.create_connection(endpoint, timeout=_ANSWER_WITHIN)
        except OSError as exc:
            raise DeviceFaultError("connection.bench_silent", cause=os_reason(exc)) from exc
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._file = self._socket.makefile("rb")
        self._now = 0.0
        self._now = float(self._ask({"now": None})["now"])

    def attach(self, received: Callable[[], int]) -> None:
        """Wait for the IMU reader from now on; `received` counts the bytes that it has read."""
        self._received = received

    def now(self) -> float:
        """Virtual time, s; the present one if the bench follows host time."""
        if self._speed > 0.0:
            self._now = float(self._ask({"now": None})["now"])
        return self._now

    def sleep(self, seconds: float) -> None:
        """Let virtual time pass and wait until its samples are read."""
        answer = self._ask({"advance": seconds})
        self._now = float(answer["now"])
        if self._received is not None:
            self._wait_for_bytes(int(answer["bytes"]))

    def idle(self, seconds: float) -> None:
        """Let host time pass; virtual time does not advance unless it follows host time."""
        time.sleep(seconds)

    def order(self, order: Mapping[str, Any]) -> None:
        """Order a fault from the bench, now or after a delay."""
        self._ask(dict(order))

    def carry(self, outer: float, inner: float, rest: float) -> None:
        """Have the simulated operator turn the rails to angles, rad, and leave them there for `rest` s."""
        self._ask({"carry": [outer, inner], "rest": rest})

    def close(self) -> None:
        self._file.close()
        self._socket.close()

    def _wait_for_bytes(self, count: int) -> None:
        assert self._received is not None
        begin = time.monotonic()
        while self._received() < count:
            waited = time.monotonic() - begin
            time.sleep(0.0 if waited < _YIELD_FOR else _YIELD_FOR)
            if waited > _SAMPLES_WITHIN:
                return  # the sequencer detects the gap of a link that loses bytes

    def _ask(self, request: dict[str, Any]) -> dict[str, Any]:
        timeout = _ANSWER_WITHIN
        if self._speed > 0.0 and request.get("advance"):
            timeout += 2.0 * request["advance"] / self._speed
        try:
            self._socket.settimeout(timeout)
            self._socket.sendall(json.dumps(request).encode() + b"\n")
            line = self._file.readline()
        except OSError as exc:
            raise DeviceFaultError("connection.bench_lost", cause=os_reason(exc)) from exc
        if not line:
            raise DeviceFaultError("connection.bench_ended")
        answer: dict[str, Any] = json.loads(line)
        return answer
