"""Units of a live pair: a different unit ends the watch, a silent unit is reported, a lost port is logged once."""

import logging
import time
from types import SimpleNamespace
from typing import Any

import pytest

from calstation.connection import LivePair, live_pair
from calstation.connection.live_pair import _LiveImu
from calstation.devices import ImuIdentity, OtherModelError
from calstation.errors import DeviceFaultError
from tests.helpers import raises_code


class FakeImu:
    """An IMU that reports `serial`, or raises `failure` in `wake`, and sends no samples."""

    lost = False

    def __init__(self) -> None:
        self.serial, self.failure, self.fault = "A", None, None
        self.stats = SimpleNamespace(restarts=0)

    def identify(self) -> ImuIdentity:
        return ImuIdentity("model", self.serial, "")

    def start(self) -> None: ...

    def close(self) -> None: ...

    def read(self) -> list[int]:
        if self.fault is not None:
            raise self.fault
        return []

    def wake(self, check_cancelled: Any) -> ImuIdentity:
        if self.failure is not None:
            raise self.failure
        return self.identify()


@pytest.fixture
def imu(monkeypatch: pytest.MonkeyPatch) -> FakeImu:
    imu = FakeImu()
    monkeypatch.setattr(live_pair, "open_imu", lambda setup, port: imu)
    return imu


def revived(unit: _LiveImu) -> None:
    unit.read(0.0)
    unit.read(3.0)
    assert unit._wake_thread is not None
    unit._wake_thread.join(5.0)


def test_different_unit_on_the_port_ends_the_watch(imu: FakeImu) -> None:
    unit = _LiveImu(None, "P")  # type: ignore[arg-type]
    imu.serial = "B"
    revived(unit)
    with raises_code(DeviceFaultError, "connection.other_imu"):
        unit.read(3.1)
    unit = _LiveImu(None, "P")  # type: ignore[arg-type]
    imu.failure = OtherModelError("imu.other_model", found="X", expected="Y")
    revived(unit)
    with raises_code(OtherModelError, "imu.other_model"):
        unit.read(3.1)


def test_the_same_fault_is_logged_once(imu: FakeImu, caplog: pytest.LogCaptureFixture) -> None:
    unit = _LiveImu(None, "P")  # type: ignore[arg-type]
    imu.fault = DeviceFaultError("connection.all_silent", seconds=1.0)
    with caplog.at_level(logging.WARNING):
        for k in range(20):
            unit.read(0.05 * k)
    assert len(caplog.records) == 1


def test_unit_that_never_sends_is_reported(imu: FakeImu) -> None:
    class Sends(_LiveImu):
        def read(self, now: float) -> Any:
            self.heard = True
            return []

    class Clock:
        speed, tick = 1.0, 5.0
        time = 0.0

        def now(self) -> float:
            return self.time

        def sleep(self, seconds: float) -> None:
            self.time += seconds

    class Live(LivePair):
        def __init__(self) -> None:
            self._units = [_LiveImu(None, "P"), Sends(None, "Q")]  # type: ignore[arg-type]
            self._clock, self._polls = Clock(), []  # type: ignore[assignment]
            empty = SimpleNamespace(take=lambda now: ([], []))
            self._aligner = empty  # type: ignore[assignment]

        def _feed(self, number: int, unit: _LiveImu, batch: Any) -> None: ...

    begin = time.monotonic()
    with raises_code(DeviceFaultError, "connection.imu_silent") as caught:
        list(Live().blocks(None, lambda: False))
    assert caught.value.values["number"] == 1
    assert time.monotonic() - begin < 5.0
