"""A unit that restarted unexpectedly is queried until it responds, and its stream is configured again."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from calstation.bench import BenchConfig
from calstation.bench.imu import UNITS, ImuUnit
from calstation.bench.imu.unit import crc16, stream_frames
from calstation.bench.imu.units.framed import REPLY_SYNC, pack
from calstation.config import library
from calstation.devices import ImuIdentity, NoFramesError, OtherModelError
from calstation.devices.imu import StreamedImu, open_imu
from calstation.devices.profiles import load_imu_profile
from calstation.errors import DeviceFaultError
from tests.devices.powered_unit import shipped
from tests.helpers import raises_code


def read_for(imu: StreamedImu, seconds: float) -> None:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        imu.read()


class BootingLink:
    """A simulated unit that ignores a number of requests after its restart, then sends `unsolicited`."""

    port = "memory"
    received_at = property(lambda link: time.monotonic())

    def __init__(self, unit: ImuUnit) -> None:
        self.unit, self.lost, self.unsolicited = unit, 0, b""
        self._parse: Callable[[bytes, float], list[bytes]] = unit.new_parser()
        self._waiting = bytearray()
        crc16(b"")  # compiles the function before a reply is expected

    def restart(self, lost: int, unsolicited: bytes = b"") -> None:
        """Restart it."""
        self.unit.restart(1.0)
        self.lost, self.unsolicited = lost, unsolicited

    def send(self, data: bytes) -> None:
        """Send unsolicited bytes."""
        self._waiting += data

    def write(self, data: bytes) -> None:
        if self.lost:
            self.lost -= 1
            return
        self._waiting += b"".join(self._parse(data, 100.0))

    def read(self, wait: float) -> bytes:
        data = self.unsolicited + bytes(self._waiting)
        self._waiting.clear()
        time.sleep(0.0005)
        return data

    def close(self) -> None: ...


@contextmanager
def driver(protocol: str, reset_timeout_s: float = 30.0) -> Iterator[tuple[StreamedImu, BootingLink]]:
    link = BootingLink(UNITS[protocol](BenchConfig(serial="SN-7")))
    profile = shipped(protocol).with_commands(timeout_s=0.4, reset_timeout_s=reset_timeout_s)
    imu = open_imu(link, profile, "SN-7")  # type: ignore[arg-type]
    try:
        yield imu, link
    finally:
        imu.close()


@pytest.mark.long
@pytest.mark.parametrize("corrected", [False, True])
@pytest.mark.parametrize("protocol", UNITS)
def test_restarting_unit_is_queried_until_it_responds_and_streams(protocol: str, corrected: bool) -> None:
    heard: list[bool] = []
    with driver(protocol) as (imu, link):
        imu.start(corrected=corrected)
        link.restart(lost=2)
        assert not link.unit.corrected
        identity = imu.wake(lambda: heard.append(True), corrected=corrected)
        assert isinstance(identity, ImuIdentity)
        assert identity.serial == "SN-7"
        assert (link.unit.streaming, link.unit.corrected) == (True, corrected)
    assert len(heard) > 1


@pytest.mark.parametrize("protocol", UNITS)
def test_unresponsive_unit_is_reported_within_the_restart_timeout(protocol: str) -> None:
    with driver(protocol, reset_timeout_s=0.2) as (imu, link):
        imu.start()
        link.restart(lost=10**6)
        with raises_code(DeviceFaultError, "imu.answer_not_framed"):
            imu.wake(lambda: None)


@pytest.mark.long
@pytest.mark.parametrize("protocol", UNITS)
def test_cancellation_is_checked_between_two_queries(protocol: str) -> None:
    with driver(protocol) as (imu, link):
        imu.start()
        link.restart(lost=10**6)
        calls: list[int] = []

        def check_cancelled() -> None:
            calls.append(1)
            if len(calls) == 3:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            imu.wake(check_cancelled)


def test_unsolicited_bytes_do_not_count_as_a_wrong_baud_rate() -> None:
    with driver("vectornav") as (imu, link):
        imu.start()
        # A unit with factory settings sends lines of text, which contain no frame of the profile.
        link.restart(lost=0, unsolicited=b"$VNYMR,+006.271,+000.031,-002.000,+01.0640,-00.2531,+03.0614*65\r\n")
        with raises_code(NoFramesError, "imu.no_frames"):
            read_for(imu, 20.0)
        imu.wake(lambda: None)
        assert link.unit.streaming


def test_different_model_is_reported_immediately() -> None:
    with driver("framed") as (imu, link):
        link.unit.answer = lambda op, payload, time: pack(REPLY_SYNC, op, b"other;SN-7;1")  # type: ignore[method-assign]
        with raises_code(OtherModelError, "imu.other_model"):
            imu.wake(lambda: None)


def test_a_unit_without_commands_cannot_be_queried() -> None:
    profile = load_imu_profile(library.shipped_folder() / "imus" / "stim300.toml")
    imu = open_imu(BootingLink(UNITS["framed"](BenchConfig(serial="SN-7"))), profile, "SN-7")  # type: ignore[arg-type]
    try:
        assert imu.wake(lambda: None) is None
    finally:
        imu.close()


def test_a_counter_restart_is_counted_in_the_link_statistics() -> None:
    with driver("framed") as (imu, link):
        for counters in ([5000, 5001], [0, 1]):
            frames = imu.stats.frames
            link.send(stream_frames(np.array(counters), np.zeros((2, 6)), 20.0, np.zeros(2, np.int64)))
            deadline = time.monotonic() + 20.0
            while imu.stats.frames < frames + 2 and time.monotonic() < deadline:
                time.sleep(0.001)
            imu.read()
        assert imu.stats.restarts == 1
