"""Table axes on the link of their IMU: one owner of the port, register access in IMU frames between samples."""

import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from test_framed_imu import PROFILE as IMU_PROFILE
from test_framed_imu import request
from test_frames import reply_frame, stream_frame
from test_modbus_table import image, two_words

from calstation.devices.imu import FramedImu
from calstation.devices.imu.drivers.stream import StreamOnlyImu
from calstation.devices.profiles import SerialSettings, load_imu_profile, load_table_profile
from calstation.devices.table import SharedTable, open_table
from calstation.errors import ConfigurationError, DeviceFaultError
from tests.devices.scripted import ScriptedDevice
from tests.helpers import raises_code

DATA = Path(__file__).parents[2] / "data"
PROFILE = load_table_profile(DATA / "tables" / "indexing_unit.toml")
#: Profile with a long timeout, because a busy computer may process the immediate replies late.
LONG_TIMEOUT = IMU_PROFILE.model_copy(update={"commands": IMU_PROFILE.commands.model_copy(update={"timeout_s": 1.0})})
Pair = tuple[bytes, bytes]


def read(address: int, words: list[int]) -> Pair:
    head = struct.pack("<HB", address, len(words))
    return request(7, head), reply_frame(7, head + struct.pack(f"<{len(words)}H", *words))


def write(address: int, *words: int) -> Pair:
    head = struct.pack("<HB", address, len(words))
    return request(8, head + struct.pack(f"<{len(words)}H", *words)), reply_frame(8, head)


@contextmanager
def system(pairs: list[Pair]) -> Iterator[tuple[SharedTable, FramedImu, ScriptedDevice]]:
    link = ScriptedDevice(pairs)
    imu = FramedImu(link, LONG_TIMEOUT)  # type: ignore[arg-type]
    table = SharedTable(imu, PROFILE)
    try:
        yield table, imu, link
    finally:
        table.close()
        assert not link.closed.is_set(), "the port is the IMU's"
        imu.close()
    assert link.finished


def test_axis_commands_match_the_protocol() -> None:
    text = [int.from_bytes(b"bench-table\0\0\0\0\0"[k : k + 2], "big") for k in range(0, 16, 2)]
    pairs = [
        read(0, text),
        read(8, text),
        *(write(16, word) for word in (0x06, 0x07, 0x0F)),
        write(22, 3),
        write(34, *two_words(-9000000), *two_words(200000), *two_words(400000)),
        write(54, *two_words(72000000), *two_words(200000), *two_words(400000)),
        write(22, 1),
        write(21, 1),
        write(22, 2),
        write(16, 0x06),
    ]
    with system(pairs) as (table, _, _link):
        assert table.identify().model == "bench-table"
        table.enable()
        table.home()
        table.move(*np.deg2rad([-90.0, 720.0, 20.0, 40.0]))
        table.heartbeat()
        table.stop()
        table.disable()


def test_polls_and_samples_share_the_line() -> None:
    polled = image()[17:64]
    ask, answer = read(17, polled)
    between = stream_frame(1, [1] * 6) + answer + stream_frame(2, [2] * 6)
    with system([(ask, between), (ask, answer), (request(1), reply_frame(1, b"bench-imu;SN;1"))]) as (table, imu, _):
        status = table.status()
        np.testing.assert_allclose(status.angles, np.deg2rad([-45.0, 360.00001]), atol=1e-12)
        assert table.status().watchdog == 1.5
        assert imu.identify().serial == "SN"
        assert imu.read().seq.tolist() == [1, 2]


def test_two_threads_share_the_link() -> None:
    polled = image()[17:64]
    ask, answer = read(17, polled)
    with system([(ask, answer)] * 40) as (table, _, _link):
        found: list[float] = []

        def poll() -> None:
            found.extend(table.status().watchdog for _ in range(20))

        threads = [threading.Thread(target=poll) for _ in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert found == [1.5] * 40


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (2, "table.system_write_refused"),
        (3, "table.system_write_busy"),
        (4, "table.system_write_refused"),
        (5, "table.system_write_refused"),
    ],
)
def test_error_reply_is_reported_with_its_meaning(error: int, code: str) -> None:
    with system([(write(22, 2)[0], reply_frame(0xFF, bytes([error])))]) as (table, _, _link):
        with raises_code(DeviceFaultError, code) as caught:
            table.stop()
        assert caught.value.values["address"] == 22
        assert caught.value.values["reason"].code == f"imu.framed_{error}"


@pytest.mark.long
def test_request_with_a_lost_reply_is_repeated_except_homing() -> None:
    stop, home = write(22, 2), write(22, 3)
    between = request(1), reply_frame(1, b"bench-imu;SN;1")
    with system([(stop[0], b""), (stop[0], b""), stop, between, (home[0], b"")]) as (table, _, _link):
        table.stop()
        with raises_code(DeviceFaultError, "imu.answer_not_framed"):
            table.home()


def test_reply_of_the_wrong_length_is_reported() -> None:
    ask, _ = read(0, [0] * 8)
    short = reply_frame(7, ask[4:7] + b"\0\0")
    with system([(ask, short)]) as (table, _, _link), raises_code(DeviceFaultError, "table.answer_length"):
        table.identify()


def test_axes_require_an_imu_with_framed_commands() -> None:
    link = ScriptedDevice([])
    imu = StreamOnlyImu(link, load_imu_profile(DATA / "imus" / "stim300.toml"), "SN")  # type: ignore[arg-type]
    with raises_code(ConfigurationError, "table.imu_without_words"):
        SharedTable(imu, PROFILE, owned=True)
    assert link.closed.is_set()


def test_separate_port_for_shared_axes_is_refused() -> None:
    with raises_code(ConfigurationError, "table.behind_imu"):
        open_table("/dev/ttyUSB0", PROFILE, SerialSettings())
