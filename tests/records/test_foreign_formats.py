"""Recordings in foreign formats give the same log as the CSV of the same numbers, bit for bit."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from foreign_samples import COUNT, NAMES, TOML, UNITS, assert_same_as_csv, imu_message, samples
from records_samples import joined

from calstation.errors import InputError
from calstation.records import arrival, open_log, temporary_rows
from calstation.records.foreign import mcap
from tests.helpers import raises_code


def write_mcap(path: Path, topics: dict[str, list[bytes]], *, is_cdr: bool = True, packed: bool = True) -> None:
    library = pytest.importorskip("mcap.writer", reason="mcap is not installed")
    compression = library.CompressionType.ZSTD if packed else library.CompressionType.NONE
    with path.open("wb") as stream:
        writer = library.Writer(stream, chunk_size=4096, compression=compression)
        writer.start()
        kind, encoding = ("sensor_msgs/msg/Imu", "ros2msg") if is_cdr else ("sensor_msgs/Imu", "ros1msg")
        schema = writer.register_schema(kind, encoding, b"")
        text = writer.register_schema("std_msgs/msg/String", "ros2msg", b"")
        other = writer.register_channel("/rosout", "cdr", text)
        writer.add_message(other, 0, b"\0\1\0\0", 0)
        for name, messages in topics.items():
            channel = writer.register_channel(name, "cdr" if is_cdr else "ros1", schema)
            for k, data in enumerate(messages):
                writer.add_message(channel, int(2e7 * k), data, int(2e7 * k))
        writer.finish()


@pytest.mark.parametrize("is_cdr", [True, False], ids=["ROS 2", "ROS 1"])
def test_mcap(tmp_path: Path, is_cdr: bool) -> None:
    rows = samples()
    path = tmp_path / "rec.mcap"
    write_mcap(path, {"/imu/data": [imu_message(row, is_cdr=is_cdr) for row in rows]}, is_cdr=is_cdr)
    assert_same_as_csv(path, rows)
    kind = "sensor_msgs/msg/Imu" if is_cdr else "sensor_msgs/Imu"
    assert open_log(path).topics == ("/rosout (std_msgs/msg/String, 1)", f"/imu/data ({kind}, {len(rows)})")


def test_topic_is_chosen_if_there_are_several(tmp_path: Path) -> None:
    rows = samples()
    messages = [imu_message(row, is_cdr=True) for row in rows]
    write_mcap(path := tmp_path / "rec.mcap", {"/a/imu": messages, "/b/imu": messages[:20]})
    assert_same_as_csv(path, rows, "/a/imu")
    for topic, code in (
        (None, "foreign.several_imus"),
        ("/a/im", "foreign.no_topic"),
        ("/rosout", "foreign.not_imu"),
    ):
        with raises_code(InputError, code):
            open_log(path, None, topic)
    with raises_code(InputError, "foreign.no_topic") as caught:
        open_log(path, None, "camera")
    assert "/b/imu" in str(caught.value)
    write_mcap(path, {})
    with raises_code(InputError, "foreign.no_imu") as caught:
        open_log(path)
    assert "/rosout (std_msgs/msg/String, 1)" in str(caught.value)


def test_damaged_messages_and_files_are_reported(tmp_path: Path) -> None:
    rows = samples()
    messages = [imu_message(row, is_cdr=True) for row in rows]
    messages[50] = messages[50][:100]
    write_mcap(path := tmp_path / "rec.mcap", {"/imu": messages})
    (tmp_path / "rec.toml").write_text(TOML)
    log = open_log(path)
    assert (log.facts().samples, log.facts().gaps, log.facts().damaged) == (len(rows) - 1, 2, 1)
    path.write_bytes(path.read_bytes()[:-3000])
    with raises_code(InputError, "foreign.damaged"):
        open_log(path)
    with raises_code(InputError, "log.not_found"):
        open_log(tmp_path / "absent.mcap")


def test_altered_and_enormous_chunks_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    messages = [imu_message(row, is_cdr=True) for row in samples()]
    write_mcap(path := tmp_path / "rec.mcap", {"/imu": messages}, packed=False)
    (tmp_path / "rec.toml").write_text(TOML)
    monkeypatch.setattr(mcap, "MAX_CHUNK", 1000)
    with raises_code(InputError, "foreign.too_large"):
        open_log(path)
    monkeypatch.undo()
    content = bytearray(path.read_bytes())
    content[content.index(messages[50]) + 200] ^= 1
    path.write_bytes(content)
    with raises_code(InputError, "foreign.damaged") as caught:
        open_log(path)
    assert "crc" in str(caught.value)


@pytest.mark.parametrize(
    ("column", "value", "code"),
    [
        (2, 1e300, "csv.cell_too_large"),
        (3, 1e4, "csv.cell_implausible"),
        (4, -1e6, "csv.cell_implausible"),
    ],
)
def test_excessive_numbers_are_refused_as_in_a_csv(tmp_path: Path, column: int, value: float, code: str) -> None:
    rows = samples()
    rows[50, column] = value
    write_mcap(path := tmp_path / "rec.mcap", {"/imu": [imu_message(row, is_cdr=True) for row in rows]})
    (tmp_path / "rec.toml").write_text(TOML)
    with raises_code(InputError, code) as caught:
        list(open_log(path).blocks())
    assert (caught.value.values["line"], caught.value.values["column"]) == (51, NAMES[column])


@pytest.mark.parametrize(
    ("columns", "code"),
    [('stage = { value = "x" }', "csv.column_missing"), (UNITS.split("\n", 1)[1], "csv.no_such_column")],
)
def test_columns_of_unknown_topics_must_be_complete(tmp_path: Path, columns: str, code: str) -> None:
    write_mcap(path := tmp_path / "rec.mcap", {"/imu": [imu_message(row, is_cdr=True) for row in samples()]})
    (tmp_path / "rec.toml").write_text(f"{TOML}[columns]\n{columns}")
    with raises_code(InputError, code):
        open_log(path, None, "/rosout").facts()


def test_long_stage_is_refused(tmp_path: Path) -> None:
    write_mcap(path := tmp_path / "rec.mcap", {"/imu": [imu_message(row, is_cdr=True) for row in samples()]})
    (tmp_path / "rec.toml").write_text(f'{TOML}[columns]\nstage = {{ value = "{"s" * 65}" }}')
    with raises_code(InputError, "csv.stage_too_long"):
        open_log(path).facts()


def peak_of_reading(path: Path, repetitions: int) -> int:
    """Return the peak of the memory, bytes, for reading a recording of so many times 298 messages."""
    rows = np.tile(samples(), (repetitions, 1))
    rows[:, 0] = 0.02 * np.arange(1, len(rows) + 1) + np.random.default_rng(1).exponential(0.004, len(rows))
    rows[:, 0] = np.maximum.accumulate(rows[:, 0])
    write_mcap(path, {"/imu": [imu_message(row, is_cdr=True) for row in rows]})
    path.with_suffix(".toml").write_text(TOML)
    tracemalloc.start()
    log = open_log(path)
    count = sum(len(block) for block in log.blocks())
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert count == len(rows)
    assert log.times.jitter > 0.001
    return peak


@pytest.mark.long
def test_memory_does_not_grow_with_the_length_of_a_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arrival, "_MAX_ROWS", 500)
    monkeypatch.setattr(temporary_rows, "_MEMORY", 1000)
    monkeypatch.setattr(temporary_rows.TemporaryRows, "part_rows", 500)
    write_mcap(path := tmp_path / "first.mcap", {"/imu": [imu_message(row, is_cdr=True) for row in samples()]})
    path.with_suffix(".toml").write_text(TOML)
    assert open_log(path).facts().samples == COUNT - 2, "imports all that is needed"
    peaks = [peak_of_reading(tmp_path / f"{k}.mcap", k) for k in (3, 9)]
    assert (peaks[1] - peaks[0]) / (6 * COUNT) < 30.0  # bytes per message


def test_messages_out_of_order_and_without_an_index_are_ordered(tmp_path: Path) -> None:
    rows = samples()
    writer_type = pytest.importorskip("mcap.writer", reason="mcap is not installed").Writer
    index_types = __import__("mcap.writer").writer.IndexType
    swapped = [*range(0, 100), 101, 100, *range(102, len(rows))]
    for name, options in {"swapped": {}, "unindexed": {"index_types": index_types.CHUNK}}.items():
        with (tmp_path / f"{name}.mcap").open("wb") as stream:
            writer = writer_type(stream, chunk_size=4096, **options)
            writer.start()
            channel = writer.register_channel("/imu", "cdr", writer.register_schema("sensor_msgs/msg/Imu", "", b""))
            for k in swapped:
                writer.add_message(channel, int(2e7 * k), imu_message(rows[k], is_cdr=True), 0)
            writer.finish()
        assert_same_as_csv(tmp_path / f"{name}.mcap", rows)


@pytest.mark.parametrize("version", [1, 2])
def test_ros_bag(tmp_path: Path, version: int) -> None:
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    from rosbags.typesys import Stores, get_typestore

    rows = samples()
    if version == 1:
        from rosbags.rosbag1 import Writer

        store, kind, path = get_typestore(Stores.ROS1_NOETIC), "sensor_msgs/msg/Imu", tmp_path / "rec.bag"
        with Writer(path) as writer:
            connection = writer.add_connection("/imu", kind, typestore=store)
            for k, row in enumerate(rows):
                writer.write(connection, int(2e7 * k), imu_message(row, is_cdr=False))
    else:
        from rosbags.rosbag2 import Writer as Writer2

        store, kind, path = get_typestore(Stores.ROS2_HUMBLE), "sensor_msgs/msg/Imu", tmp_path / "rec"
        with Writer2(path, version=9) as writer:
            connection = writer.add_connection("/imu", kind, typestore=store)
            for k, row in enumerate(rows):
                writer.write(connection, int(2e7 * k), imu_message(row, is_cdr=True))
    assert_same_as_csv(path, rows)


def test_missing_library_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "rec.mcap").write_bytes(b"x")
    (tmp_path / "rec.toml").write_text(TOML)
    monkeypatch.setitem(__import__("sys").modules, "mcap.reader", None)
    with raises_code(InputError, "foreign.no_library") as caught:
        open_log(tmp_path / "rec.mcap")
    assert 'pip install "calstation[formats]"' in str(caught.value)


@pytest.mark.parametrize("version", [5, 7.3])
def test_matlab_array_of_psins(tmp_path: Path, version: float) -> None:
    import h5py
    import scipy.io

    rows = samples()
    rows[:, 1:] *= 0.02
    imu, path = np.column_stack([rows[:, 1:], rows[:, 0]]), tmp_path / "rec.mat"
    if version == 5:
        scipy.io.savemat(path, {"imu": imu, "note": "x", "avp0": np.zeros((9, 1))})
    else:
        with h5py.File(path, "w", userblock_size=512) as file:
            file["imu"], file["ts"] = imu.T, np.array([[0.02]])
    units = UNITS.replace("rad/s", "rad").replace("m/s2", "m/s")
    assert_same_as_csv(path, rows, units=units)


def test_matlab_variables_are_mapped(tmp_path: Path) -> None:
    import scipy.io

    rows = samples()
    scipy.io.savemat(tmp_path / "rec.mat", {"log": {"t": rows[:, 0], "w": rows[:, 1:4], "f": rows[:, 4:]}})
    sources = ["log.t", *(f"log.{v}(:,{k})" for v in "wf" for k in (1, 2, 3))]
    units = ["s", *["rad/s"] * 3, *["m/s2"] * 3]
    entries = "".join(
        f'{n} = {{ from = "{s}", unit = "{u}" }}\n' for n, s, u in zip(NAMES, sources, units, strict=True)
    )
    (tmp_path / "rec.toml").write_text(f"{TOML}[columns]\n{entries}")
    for topic in (None, "log.t"):
        log = open_log(tmp_path / "rec.mat", None, topic)
        np.testing.assert_array_equal(joined(list(log.blocks()))["time"], rows[:, 0])


def test_tdms(tmp_path: Path) -> None:
    tdms = pytest.importorskip("nptdms", reason="npTDMS is not installed")
    rows = samples()
    units = ["s", *["rad/s"] * 3, *["m/s2"] * 3]
    channels = [
        tdms.ChannelObject("imu", name, column, {"unit_string": unit})
        for name, column, unit in zip(NAMES, rows.T.copy(), units, strict=True)
    ]
    with tdms.TdmsWriter(tmp_path / "rec.tdms") as writer:
        writer.write_segment([*channels, tdms.ChannelObject("chamber", "dew", np.arange(9.0))])
    assert_same_as_csv(tmp_path / "rec.tdms", rows)


def test_channels_of_different_lengths_are_refused(tmp_path: Path) -> None:
    tdms = pytest.importorskip("nptdms", reason="npTDMS is not installed")
    channels = [
        tdms.ChannelObject("imu", name, column[: -9 if name == "gyro_z" else None])
        for name, column in zip(NAMES, samples().T.copy(), strict=True)
    ]
    with tdms.TdmsWriter(path := tmp_path / "rec.tdms") as writer:
        writer.write_segment(channels)
    path.with_suffix(".toml").write_text(TOML + UNITS)
    with raises_code(InputError, "foreign.lengths_differ") as caught:
        open_log(path).facts()
    assert "gyro_z has 289 values, but accel_x has 298." in str(caught.value)
