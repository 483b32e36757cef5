"""Logs of flight controllers and receivers give the same log as the CSV of the same numbers, bit for bit."""

import itertools
import math
import struct
from pathlib import Path

import numpy as np
import pytest
from foreign_samples import NAMES, TOML, UNITS, assert_same_as_csv, samples
from records_samples import joined

from calstation.errors import InputError
from calstation.records import open_log
from calstation.records.foreign import dataflash, ulog
from tests.helpers import raises_code

MICROSECONDS = f'{UNITS}time_s = {{ from = "time_s", unit = "us" }}\n'
_TYPES = {"uint64_t": "Q", "uint32_t": "I", "float": "f", "uint8_t": "B", "int16_t": "h"}


def microseconds() -> np.ndarray:
    """Return samples, shape (n, 7), with times in whole µs."""
    rows = samples()
    rows[:, 0] = np.rint(1e6 * (rows[:, 0] - rows[0, 0] + 1.0))
    return rows


def write_ulog(path: Path, topics: dict[tuple[str, int], tuple[str, list[tuple]]]) -> None:
    """Write an ULog: fields and rows of the messages by name and instance."""

    def message(kind: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(kind)) + body

    content = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0) + message("B", bytes(40))
    for name, fields in {name: fields for (name, _), (fields, _) in topics.items()}.items():
        content += message("F", f"{name}:{fields};".encode())
    for number, ((name, instance), (fields, rows)) in enumerate(topics.items()):
        content += message("A", struct.pack("<BH", instance, number) + name.encode())
        types = [field.split()[0].partition("[") for field in fields.split(";")]
        form = "<" + "".join(f"{size.rstrip(']') or 1}{_TYPES[kind]}" for kind, _, size in types)
        content += b"".join(message("D", struct.pack(f"<H{form[1:]}", number, *row)) for row in rows)
    path.write_bytes(content)


FIELDS = "uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float x;float y;float z"
FIFO = (
    "uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float dt;float scale;uint8_t samples;"
    "int16_t[32] x;int16_t[32] y;int16_t[32] z"
)


def sensor(rows: np.ndarray, columns: slice, shift: int = 0) -> list[tuple]:
    return [(int(row[0]) + 300, int(row[0]) + shift, 7, *row[columns]) for row in rows]


def test_ulog(tmp_path: Path) -> None:
    pyulog = pytest.importorskip("pyulog", reason="pyulog is not installed")
    rows = microseconds()
    topics = {
        ("sensor_gyro", 0): (FIELDS, sensor(rows, slice(1, 4))),
        ("sensor_accel", 0): (FIELDS, sensor(rows, slice(4, 7), shift=-900)),
    }
    write_ulog(path := tmp_path / "rec.ulg", topics)
    assert_same_as_csv(path, rows, units=MICROSECONDS)
    assert set(open_log(path).topics) == {"sensor_gyro/0 (sensor_gyro, 298)", "sensor_accel/0 (sensor_accel, 298)"}
    pyulog.ULog(str(path)).write_ulog(str(tmp_path / "by_library.ulg"))
    assert_same_as_csv(tmp_path / "by_library.ulg", rows, units=MICROSECONDS)
    second = {(name, 1): content for (name, _), content in topics.items()}
    write_ulog(path, topics | second)
    with raises_code(InputError, "foreign.several_imus"):
        open_log(path)
    assert_same_as_csv(path, rows, "sensor_gyro/1", MICROSECONDS)


def test_ulog_sensors_without_common_times_are_refused(tmp_path: Path) -> None:
    pytest.importorskip("pyulog", reason="pyulog is not installed")
    rows = microseconds()
    accel = sensor(rows, slice(4, 7))
    for part, lost in ((accel[:150] + accel[170:], 20), (accel[::2], None)):
        write_ulog(
            path := tmp_path / "rec.ulg",
            {("sensor_gyro", 0): (FIELDS, sensor(rows, slice(1, 4))), ("sensor_accel", 0): (FIELDS, part)},
        )
        path.with_suffix(".toml").write_text(TOML)
        if lost is not None:
            assert open_log(path).facts().damaged == lost
            continue
        with raises_code(InputError, "foreign.sensors_apart") as caught:
            open_log(path)
        assert "298 samples of the gyros and 149 of the accelerometers" in str(caught.value)


def test_ulog_fifo_messages_keep_their_counts(tmp_path: Path) -> None:
    pytest.importorskip("pyulog", reason="pyulog is not installed")
    counts = np.random.default_rng(2).integers(-900, 900, (300, 6))
    times = 1_000_000 + 20_000 * np.arange(300)
    scale = np.array([0.0010652645, 0.0047884034], np.float32)

    def batches(first: int, size: np.float32) -> list[tuple]:
        found = []
        for k in [*range(0, 100, 5), *range(105, 300, 5)]:
            axes = [np.concatenate([counts[k : k + 5, first + i], np.full(27, 99)]).tolist() for i in range(3)]
            found.append((int(times[k + 4]) + 90, int(times[k + 4]), 7, 20_000.0, size, 5, *itertools.chain(*axes)))
        return found

    topics = {
        ("sensor_gyro_fifo", 0): (FIFO, batches(0, scale[0])),
        ("sensor_accel_fifo", 0): (FIFO, batches(3, scale[1])),
    }
    write_ulog(path := tmp_path / "rec.ulg", topics)
    rows = np.column_stack([times, counts]).astype(np.float64)
    rows = np.delete(rows, slice(100, 105), axis=0)
    sizes = f'output = "rate"\ngyro_lsb = {float(scale[0])!r}\naccel_lsb = {float(scale[1])!r}\n'
    time = '[columns]\ntime_s = { from = "time_s", unit = "us" }\n'
    assert_same_as_csv(path, rows, units=sizes + time)
    np.testing.assert_array_equal(joined(list(open_log(path).blocks()))["counts"], rows[:, 1:])


def write_dataflash(path: Path, formats: dict[str, tuple[str, str]], messages: list[tuple[str, tuple]]) -> None:
    """Write a binary DataFlash log; a format has the types and the names of its fields."""
    from pymavlink.DFReader import FORMAT_TO_STRUCT

    head, numbers = b"\xa3\x95", {name: 130 + k for k, name in enumerate(formats)}
    forms = {name: "<" + "".join(FORMAT_TO_STRUCT[t][0] for t in types) for name, (types, _) in formats.items()}

    def described(number: int, length: int, name: str, types: str, labels: str) -> bytes:
        body = struct.pack("<BB4s16s64s", number, length, name.encode(), types.encode(), labels.encode())
        return head + b"\x80" + body

    content = described(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
    for name, (types, labels) in formats.items():
        content += described(numbers[name], 3 + struct.calcsize(forms[name]), name, types, labels)
    for name, values in messages:
        content += head + bytes([numbers[name]]) + struct.pack(forms[name], *values)
    path.write_bytes(content)


def test_dataflash_imu(tmp_path: Path) -> None:
    pytest.importorskip("pymavlink", reason="pymavlink is not installed")
    rows = microseconds()
    formats = {"IMU": ("QBffffffb", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,T"), "MSG": ("QZ", "TimeUS,Message")}
    messages = [("IMU", (int(row[0]), 0, *row[1:], 31)) for row in rows]
    write_dataflash(path := tmp_path / "rec.bin", formats, [("MSG", (9, b"x")), *messages])
    path.with_suffix(".toml").write_text(TOML)
    log = open_log(path)
    np.testing.assert_array_equal(joined(list(log.blocks()))["temperature"], 31.0)
    formats["IMU"] = ("Qffffff", "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    write_dataflash(path, formats, [("IMU", (int(row[0]), *row[1:])) for row in rows])
    assert_same_as_csv(path, rows, units=MICROSECONDS)


DATAFLASH_TEXT = "FMT, 130, 36, IMU, QBffffff, TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ\n"


def test_dataflash_text(tmp_path: Path) -> None:
    rows = microseconds()
    head = f"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n{DATAFLASH_TEXT}"
    lines = [f"IMU, {int(row[0])}, 0, {', '.join(map(repr, row[1:].tolist()))}\n" for row in rows]
    (path := tmp_path / "rec.log").write_text(head + "".join(lines))
    assert_same_as_csv(path, rows, units=MICROSECONDS)


@pytest.mark.parametrize("old", [True, False])
def test_dataflash_sensors_apart(tmp_path: Path, old: bool) -> None:
    pytest.importorskip("pymavlink", reason="pymavlink is not installed")
    rows = microseconds()
    fields = {"GYR": "GyrX,GyrY,GyrZ", "ACC": "AccX,AccY,AccZ"}
    formats = {
        name + "1" * old: ("QQfff" if old else "QBQfff", f"TimeUS,{'' if old else 'I,'}SampleUS,{axes}")
        for name, axes in fields.items()
    }
    messages = []
    for name, columns in (("GYR", slice(1, 4)), ("ACC", slice(4, 7))):
        for row in rows:
            head = (int(row[0]) + 40,) if old else (int(row[0]) + 40, 0)
            messages.append((name + "1" * old, (*head, int(row[0]), *row[columns])))
    write_dataflash(path := tmp_path / "rec.bin", formats, messages)
    assert_same_as_csv(path, rows, units=MICROSECONDS)
    assert "GYR/0 (GYR, 298)" in open_log(path).topics


COUNTS = np.random.default_rng(4).integers(-90_000, 90_000, (298, 6)).astype(np.float64)


def novatel_rows() -> np.ndarray:
    """Return times, GPS time of week, s, and counts, shape (n, 7)."""
    return np.column_stack([np.round(samples()[:, 0] - 1_700_000_000 + 345_600.0, 6), COUNTS])


def novatel_log(name: str, rows: np.ndarray, binary: bool, imu_type: int = 32) -> bytes:
    """Return messages as NovAtel's library writes them."""
    from novatel_edie.oem import messages

    content = []
    for time, gx, gy, gz, ax, ay, az in rows.tolist():
        values = {"accel_z": az, "accel_y": -ay, "accel_x": ax, "gyro_z": gz, "gyro_y": -gy, "gyro_x": gx}
        numbers = {key: int(value) for key, value in values.items()}
        more = {"imu_type": imu_type} if name.endswith("X") else {}
        message = getattr(messages, name)(gps_week=2100, gps_seconds=time, **more, **numbers)
        content.append((message.to_binary() if binary else message.to_ascii()).message)
    return b"".join(content)


@pytest.mark.parametrize("binary", [True, False], ids=["binary", "ASCII"])
@pytest.mark.parametrize("name", ["RAWIMU", "RAWIMUS", "RAWIMUX", "RAWIMUSX"])
def test_novatel(tmp_path: Path, name: str, binary: bool) -> None:
    pytest.importorskip("novatel_edie", reason="novatel-edie is not installed")
    rows = novatel_rows()
    (path := tmp_path / "rec.gps").write_bytes(novatel_log(name, rows, binary))
    sizes = f'output = "increment"\ngyro_lsb = {2.0**-21 * math.pi / 180.0!r}\naccel_lsb = {2.0**-22!r}\n'
    if not name.endswith("X"):
        path.with_suffix(".toml").write_text(TOML)
        with raises_code(InputError, "foreign.no_scale"):
            open_log(path)
    assert_same_as_csv(path, rows, units=sizes, toml=TOML + ("" if name.endswith("X") else sizes))
    np.testing.assert_array_equal(joined(list(open_log(path).blocks()))["counts"], COUNTS)


def test_damaged_novatel_message_is_a_gap(tmp_path: Path) -> None:
    pytest.importorskip("novatel_edie", reason="novatel-edie is not installed")
    content = bytearray(novatel_log("RAWIMUSX", novatel_rows(), binary=True))
    content[50 * len(content) // 298 + 40] ^= 1
    (path := tmp_path / "rec.log").write_bytes(content)
    path.with_suffix(".toml").write_text(TOML)
    facts = open_log(path).facts()
    assert (facts.samples, facts.gaps) == (297, 2)


@pytest.mark.parametrize("end", [struct.pack("<HB", 10_100, 0) + bytes(99), bytes(300_000)], ids=["cut", "zeros"])
def test_search_for_messages_in_a_damaged_ulog_ends(
    tmp_path: Path, end: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pyulog", reason="pyulog is not installed")
    monkeypatch.setattr(ulog, "_MAX_REPEATED", 1 << 26)
    write_ulog(path := tmp_path / "rec.ulg", {})
    path.write_bytes(path.read_bytes() + struct.pack("<HB", 10_000, ord("?")) + bytes(10_000) + end)
    path.with_suffix(".toml").write_text(TOML)
    with raises_code(InputError, "foreign.damaged"):
        open_log(path)


def test_nothing_is_printed_about_a_damaged_ulog(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pyulog", reason="pyulog is not installed")
    write_ulog(path := tmp_path / "rec.ulg", {("sensor_gyro", 0): (FIELDS, sensor(microseconds(), slice(1, 4)))})
    content = path.read_bytes()
    path.write_bytes(content[:-9000] + bytes([0x80, 0xFF, 0x41] * 1000) + content[-6000:])
    path.with_suffix(".toml").write_text(TOML)
    with raises_code(InputError, "foreign.no_imu"):
        open_log(path)
    assert capfd.readouterr() == ("", "")


def test_damaged_part_of_a_dataflash_log_is_a_gap(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pymavlink", reason="pymavlink is not installed")
    formats = {"IMU": ("Qffffff", "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")}
    messages = [("IMU", (int(row[0]), *row[1:])) for row in microseconds()]
    write_dataflash(path := tmp_path / "rec.bin", formats, messages)
    path.with_suffix(".toml").write_text(TOML)
    content = path.read_bytes().replace(b"BBnNZ", b"BBnNN", 1)  # the description of FMT itself is not used
    damaged = content[: -150 * 35] + bytes(5_000_000) + content[-140 * 35 :]
    path.write_bytes(damaged + bytes(1_000_000))  # as after a power cut
    facts = open_log(path).facts()
    assert (facts.samples, facts.gaps, facts.damaged) == (286, 2, 0)  # the sample before a damaged part is lost
    assert capfd.readouterr() == ("", "")


def test_layouts_of_dataflash_messages_are_those_of_ardupilot() -> None:
    layouts = pytest.importorskip("pymavlink.DFReader", reason="pymavlink is not installed").FORMAT_TO_STRUCT
    assert {letter: layout for letter, (layout, *_) in layouts.items()} == dataflash._TYPES
    assert {letter: scale for letter, (_, scale, _) in layouts.items() if scale} == dataflash._SCALES


def test_damaged_lines_of_a_dataflash_text_log_are_damaged_rows(tmp_path: Path) -> None:
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns", DATAFLASH_TEXT.strip()]
    lines += [f"IMU, {int(row[0])}, 0, {', '.join(map(repr, row[1:].tolist()))}" for row in microseconds()]
    lines[40] = lines[40].replace("9.", "9*")
    (path := tmp_path / "rec.log").write_text("\n".join(lines)[:-1])  # the last line is cut
    path.with_suffix(".toml").write_text(TOML)
    facts = open_log(path).facts()
    assert (facts.samples, facts.damaged) == (296, 1)


@pytest.mark.parametrize("module", ["pyulog", "novatel_edie.oem"])
def test_missing_library_is_one_sentence(tmp_path: Path, module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    name, content = {
        "pyulog": ("a.ulg", b"ULog"),
        "novatel_edie.oem": ("a.log", b"%RAWIMUSA,1,2;"),
    }[module]
    (tmp_path / name).write_bytes(content)
    (tmp_path / "a.toml").write_text(TOML)
    monkeypatch.setitem(__import__("sys").modules, module, None)
    with raises_code(InputError, "foreign.no_library"):
        open_log(tmp_path / name)


def test_other_files_with_these_names_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(b"firmware")
    (tmp_path / "a.toml").write_text(TOML)
    for name in ("a.bin", "absent.log"):
        with raises_code(InputError, "log.not_a_log"):
            open_log(tmp_path / name)
    assert len(NAMES) == 7
