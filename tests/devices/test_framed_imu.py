"""The framed IMU driver tested with request and reply bytes, including silence and noise."""

import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from test_frames import reply_frame, stream_frame

from calstation.devices import OtherModelError
from calstation.devices.imu import FramedImu, ImuBusyError, ImuRefusalError
from calstation.devices.profiles import ImuProfile, load_imu_profile
from calstation.errors import DeviceFaultError
from tests.devices.scripted import ScriptedDevice
from tests.helpers import raises_code

PROFILE = load_imu_profile(Path(__file__).parents[2] / "data" / "imus" / "bench_nav.toml")
BRIEF = {"timeout_s": 0.25, "commit_timeout_s": 0.4, "reset_timeout_s": 1.5}
QUICK = PROFILE.model_copy(update={"commands": PROFILE.commands.model_copy(update=BRIEF)})


@contextmanager
def driver(pairs: list[tuple[bytes, bytes]], profile: ImuProfile = QUICK) -> Iterator[tuple[FramedImu, ScriptedDevice]]:
    link = ScriptedDevice(pairs)
    imu = FramedImu(link, profile)  # type: ignore[arg-type]
    try:
        yield imu, link
    finally:
        imu.close()
        assert link.closed.is_set()


def request(op: int, payload: bytes = b"") -> bytes:
    return b"\x55\xa5" + reply_frame(op, payload)[2:]


def wait_for_frames(imu: FramedImu, count: int) -> None:
    deadline = time.monotonic() + 5.0
    while imu.stats.frames < count and time.monotonic() < deadline:
        time.sleep(0.001)


def test_identify_request_and_reply_match_the_protocol() -> None:
    with driver([(request(1), reply_frame(1, b"bench-imu;SN-7;1.2"))]) as (imu, link):
        identity = imu.identify()
        assert (identity.model, identity.serial, identity.firmware) == ("bench-imu", "SN-7", "1.2")
        assert link.finished


@pytest.mark.parametrize(("answer", "code"), [(b"other;SN;1", "imu.other_model"), (b"odd", "imu.identity_malformed")])
def test_another_model_is_rejected(answer: bytes, code: str) -> None:
    with driver([(request(1), reply_frame(1, answer))]) as (imu, _), raises_code(OtherModelError, code):
        imu.identify()


def test_samples_come_with_unwrapped_count_time_and_units() -> None:
    with driver([(request(6, b"\x01"), reply_frame(6, b"\x01"))]) as (imu, link):
        imu.start()
        link.send(stream_frame(65534, [1, 2, 3, 4, 5, 6]) + stream_frame(65535, [0] * 6)[:20])
        link.send(stream_frame(65535, [0] * 6)[20:] + stream_frame(0, [-1] * 6, 2600, 3))
        wait_for_frames(imu, 3)
        batch = imu.read()
        assert batch.seq.tolist() == [65534, 65535, 65536]
        assert batch.time.tolist() == [65535 / 200, 65536 / 200, 65537 / 200]
        assert batch.counts[0].tolist() == [1, 2, 3, 4, 5, 6]
        assert batch.temperature.tolist() == [25.12, 25.12, 26.0]
        assert batch.status.tolist() == [1, 1, 3]
        assert len(batch.arrival) == 3
        assert len(imu.read()) == 0
        link.send(stream_frame(5, [0] * 6) + stream_frame(0, [0] * 6))
        wait_for_frames(imu, 5)
        assert imu.read().seq.tolist() == [65541, 65543]
        assert imu.stats.gaps == 2
        assert imu.received == imu.stats.bytes


def test_registers_are_read_between_samples() -> None:
    entries = [(e.address, len(e.parameters)) for e in PROFILE.registers]
    pairs = []
    for address, count in entries:
        head = struct.pack("<HB", address, count)
        values = struct.pack(f"<{count}f", *(0.001 * (address + i) for i in range(count)))
        noise = stream_frame(address, [0] * 6) + reply_frame(2, b"\xff\xff\x01late")
        pairs.append((request(2, head), noise + reply_frame(2, head + values)))
    with driver(pairs) as (imu, link):
        values = imu.read_registers()
        assert link.finished
        assert values["gyro_bias_z"] == pytest.approx(0.002)
        assert values["gyro_misalign_xy"] == pytest.approx(0.004)
        assert values["inner_lever_z"] == pytest.approx(0.029)


def test_write_and_commit_requests_match_the_protocol() -> None:
    values = {name: 0.0 for e in PROFILE.registers for name in e.parameters if name}
    values["accel_misalign_zx"] = 0.25 / 4
    pairs = []
    for e in PROFILE.registers:
        head = struct.pack("<HB", e.address, len(e.parameters))
        row = [values.get(name, 0.0) for name in e.parameters]
        pairs.append((request(3, head + struct.pack(f"<{len(row)}f", *row)), reply_frame(3, head)))
    pairs.append((request(4), reply_frame(4, struct.pack("<BI", 0, 17))))
    pairs += [*marking(), (request(5), reply_frame(5, b"\x00")), IDENTITY, bias()]
    with driver(pairs) as (imu, link):
        imu.write_registers(values)
        imu.commit()
        imu.reset()
        assert link.finished


IDENTITY = request(1), reply_frame(1, b"bench-imu;SN;1")
HEAD = struct.pack("<HB", 0, 3)


def bias(value: float = 0.0) -> tuple[bytes, bytes]:
    """Return request and reply of reading the gyro bias."""
    return request(2, HEAD), reply_frame(2, HEAD + struct.pack("<3f", *[value] * 3))


def marking(busy: int = 0) -> list[tuple[bytes, bytes]]:
    """Return the requests that set a marker before a restart: biases within ±0.1 that differ from the flash."""
    mark = -0.1 + 0.2 * 0.381966
    words = request(3, HEAD + struct.pack("<3f", *[mark] * 3))
    return [bias(), *[(words, reply_frame(0xFF, b"\x03"))] * busy, (words, reply_frame(3, HEAD)), bias(mark)]


def test_restart_waits_while_the_flash_is_busy() -> None:
    pairs = [*marking(busy=4), (request(5), reply_frame(5, b"\x00")), IDENTITY, bias()]
    with driver(pairs) as (imu, link):
        imu.reset()
        assert link.finished


def test_restart_waits_until_an_unconfirmed_commit_has_timed_out() -> None:
    pairs = [(request(4), b""), *marking(), (request(5), reply_frame(5, b"\x00")), IDENTITY, bias()]
    with driver(pairs) as (imu, link):
        begun = time.monotonic()
        with pytest.raises(DeviceFaultError):
            imu.commit()
        imu.reset()
        assert link.finished
        assert time.monotonic() - begun >= BRIEF["commit_timeout_s"]
    refused = [(request(4), reply_frame(0xFF, b"\x03")), *pairs[1:]]
    with driver(refused) as (imu, link):
        begun = time.monotonic()
        with raises_code(ImuBusyError, "imu.command_refused"):
            imu.commit()
        imu.reset()
        assert link.finished
        assert time.monotonic() - begun >= BRIEF["commit_timeout_s"]


def test_restart_is_complete_when_the_marker_is_gone() -> None:
    (_, marker_numbers) = bias(-0.1 + 0.2 * 0.381966)
    late = [IDENTITY, (bias()[0], marker_numbers)] * 2
    silent = [(request(1), b"")]
    with driver([*marking(), (request(5), b""), *late, *silent, bias(), IDENTITY, bias()]) as (imu, link):
        imu.reset()
        assert link.finished


@pytest.mark.long
def test_unit_that_never_restarts_is_a_fault_and_its_values_are_restored() -> None:
    (_, marker_numbers) = bias(-0.1 + 0.2 * 0.381966)
    looks = [IDENTITY, (bias()[0], marker_numbers)] * 200
    with driver([*marking(), (request(5), reply_frame(5, b"\x00")), *looks]) as (imu, link):
        with raises_code(DeviceFaultError, "imu.not_restarted"):
            imu.reset()
        assert link.unexpected[0] == request(3, HEAD + struct.pack("<3f", 0.0, 0.0, 0.0))


def test_unit_with_unwritable_registers_is_not_restarted() -> None:
    pairs = marking()
    with driver([*pairs[:2], bias()]) as (imu, _), raises_code(DeviceFaultError, "imu.not_writable"):
        imu.reset()


def test_commit_is_never_repeated() -> None:
    with driver([]) as (imu, link):
        with raises_code(DeviceFaultError, "imu.silent"):
            imu.commit()
        assert link.unexpected == [request(4)]


def test_request_with_a_lost_reply_is_repeated_after_another_reply() -> None:
    with driver([(request(1), b""), bias(), IDENTITY]) as (imu, link):
        assert imu.identify().serial == "SN"
        assert link.finished
    with driver([]) as (imu, link):
        with raises_code(DeviceFaultError, "imu.silent"):
            imu.identify()
        assert link.unexpected[:2] == [request(1), bias()[0]]
        assert len(set(link.unexpected)) == len(link.unexpected) == 3


def test_a_unit_that_sends_unsolicited_replies_is_still_queried() -> None:
    closing = threading.Event()
    with driver([(request(1), b""), bias(), IDENTITY]) as (imu, link):

        def talk() -> None:
            while not closing.wait(0.005):
                link.send(reply_frame(77, b""))

        talking = threading.Thread(target=talk)
        talking.start()
        try:
            assert imu.identify().serial == "SN"
        finally:
            closing.set()
            talking.join()


def test_late_commit_reply_does_not_confirm_the_next_commit() -> None:
    done = reply_frame(4, struct.pack("<BI", 0, 17))
    with driver([(request(4), b""), (request(1), done + IDENTITY[1]), (request(4), b"")]) as (imu, link):
        for _ in range(2):
            with pytest.raises(DeviceFaultError):
                imu.commit()
        assert link.finished


def test_late_error_reply_is_not_taken_for_the_next_command() -> None:
    refusal = reply_frame(0xFF, b"\x02")
    with driver([(request(4), b""), (IDENTITY[0], refusal + IDENTITY[1])]) as (imu, link):
        with raises_code(DeviceFaultError, "imu.silent"):
            imu.commit()
        assert imu.identify().serial == "SN"
        assert link.finished


@pytest.mark.parametrize(
    ("code", "meaning"),
    [
        (1, "imu.framed_1"),
        (2, "imu.framed_2"),
        (3, "imu.framed_3"),
        (4, "imu.framed_4"),
        (5, "imu.framed_5"),
        (77, "imu.framed_other"),
    ],
)
def test_an_error_reply_is_reported_with_its_meaning(code: int, meaning: str) -> None:
    with driver([(request(4), reply_frame(0xFF, bytes([code])))]) as (imu, _):
        with raises_code(ImuRefusalError, "imu.command_refused") as caught:
            imu.commit()
        assert caught.value.values["command"] == "commit"
        assert caught.value.values["reason"].code == meaning


def test_noise_from_a_wrong_baud_rate_is_reported() -> None:
    with driver([]) as (imu, link):
        link.send(bytes(range(1, 85)) * 30)
        deadline = time.monotonic() + 5.0
        while imu.received == 0 and time.monotonic() < deadline:
            time.sleep(0.001)
        with raises_code(DeviceFaultError, "imu.no_frames"):
            imu.read()
        with raises_code(DeviceFaultError, "imu.no_frames"):
            imu.identify()


def test_failure_of_the_reader_thread_is_reported() -> None:
    with driver([]) as (imu, link):
        link.failure = TypeError("no descriptor")  # type: ignore[assignment]
        with raises_code(DeviceFaultError, "imu.reader_failed"):
            imu.identify()


def test_a_lost_link_is_reported_after_the_last_samples() -> None:
    with driver([]) as (imu, link):
        link.send(stream_frame(1, [0] * 6))
        wait_for_frames(imu, 1)
        link.failure = DeviceFaultError("link.lost", device="imu", port="SCRIPT", reason="no power")
        deadline = time.monotonic() + 5.0
        while not imu.lost and time.monotonic() < deadline:
            time.sleep(0.001)
        assert len(imu.read()) == 1
        with raises_code(DeviceFaultError, "link.lost"):
            imu.read()
