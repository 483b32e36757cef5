"""Small recordings that unpack into more than a computer can hold, or that never end, are refused before."""

import io
import sqlite3
import struct
import zlib
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pytest
from foreign_samples import TOML, imu_message, samples

from calstation.errors import InputError
from calstation.records import open_log
from calstation.records.foreign import mat_size, unpacking
from tests.helpers import raises_code


def assert_refused(path: Path, code: str = "foreign.too_large") -> None:
    path.with_suffix(".toml").write_text(TOML)
    with raises_code(InputError, code):
        list(open_log(path).blocks())


def element(kind: int, content: bytes) -> bytes:
    return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)


def array(kind: int, rows: int, columns: int, content: bytes) -> bytes:
    """Return an array of a MATLAB file of a class, named x, with further elements as content."""
    flags, dimensions = struct.pack("<II", kind, 0), struct.pack("<ii", rows, columns)
    return element(14, element(6, flags) + element(5, dimensions) + element(1, b"x") + content)


ZEROS = element(2, bytes(1 << 20))
NESTED = array(1, 1, 1, b"")
MATLAB = {
    "packed": element(15, zlib.compress(array(6, 1 << 20, 1, ZEROS))),
    "announced": array(6, 1 << 30, 7, element(9, b"")),
    "announced by its content": array(6, 1, 1, struct.pack("<II", 2, 1 << 31)),
    "of many arrays": element(15, zlib.compress(array(1, 2000, 1, array(6, 0, 0, element(9, b"")) * 2000))),
    "nested deeply": NESTED * 30_000,
}


@pytest.mark.parametrize("name", MATLAB)
def test_matlab_arrays_much_larger_than_the_file_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr(mat_size, "MAX_NUMBERS", 1 << 18)
    path = tmp_path / "rec.mat"
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H2s", 0x0100, b"IM") + MATLAB[name])
    assert_refused(path)


@pytest.mark.parametrize("kind", ["size", "other file", "virtual"])
def test_matlab_7_3_arrays_that_are_not_in_the_file_are_refused(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "rec.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        if kind == "size":
            file.create_dataset("imu", (7, 1 << 32), "f8", chunks=(7, 1024))
        elif kind == "other file":
            file.create_dataset("imu", (7, 1000), "f8", external=[("/dev/zero", 0, 56_000)])
        else:
            file.create_virtual_dataset("imu", h5py.VirtualLayout((7, 1000), "f8"))
    assert_refused(path)


def test_matlab_7_3_links_are_not_followed(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "rec.mat", "w", userblock_size=512) as file:
        file["imu"] = h5py.ExternalLink("/dev/zero", "/x")
        file["other"] = h5py.SoftLink("/absent")
    assert_refused(tmp_path / "rec.mat", "foreign.no_imu")


@pytest.mark.parametrize("packing", ["LZ4", "ZSTD"])
@pytest.mark.parametrize("limit", ["MAX_CHUNK", "_MIN_TOTAL"])
def test_mcap_chunks_are_unpacked_up_to_a_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, packing: str, limit: str
) -> None:
    library = pytest.importorskip("mcap.writer", reason="mcap is not installed")
    path = tmp_path / "rec.mcap"
    with path.open("wb") as stream:
        writer = library.Writer(stream, compression=library.CompressionType[packing])
        writer.start()
        channel = writer.register_channel("/imu", "cdr", writer.register_schema("sensor_msgs/msg/Imu", "", b""))
        writer.add_message(channel, 0, imu_message(samples()[0], is_cdr=True) + bytes(400_000), 0)
        writer.finish()
    data = path.read_bytes()
    monkeypatch.setattr(unpacking, limit, 1 << 18)
    assert_refused(path)
    if limit == "MAX_CHUNK":
        size, less = struct.pack("<Q", _size(data)), struct.pack("<Q", 4096)
        chunk, _, index = data.rpartition(size)
        path.write_bytes(chunk.replace(size, less, 1) + less + index)  # it says less
        assert_refused(path)


def _size(data: bytes) -> int:
    """Return the unpacked size of the only chunk."""
    from mcap.reader import make_reader

    summary = make_reader(io.BytesIO(data)).get_summary()
    assert summary is not None
    return int(summary.chunk_indexes[0].uncompressed_size)


@pytest.mark.parametrize("packing", ["BZ2", "LZ4"])
def test_chunks_of_ros_1_bags_are_unpacked_up_to_a_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, packing: str
) -> None:
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    writer = Writer(path := tmp_path / "rec.bag")
    writer.set_compression(Writer.CompressionFormat[packing])
    with writer:
        store = get_typestore(Stores.ROS1_NOETIC)
        connection = writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
        for k, row in enumerate(samples()):
            writer.write(connection, k, imu_message(row, is_cdr=False))
    monkeypatch.setattr(unpacking, "MAX_CHUNK", 10_000)
    assert_refused(path)


@pytest.mark.parametrize("mode", ["FILE", "MESSAGE", "query", "description"])
def test_ros_2_bags_are_read_up_to_a_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mode: str) -> None:
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, Writer
    from rosbags.typesys import Stores, get_typestore

    writer = Writer(path := tmp_path / "rec", version=9)
    if mode.isupper():
        writer.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
    with writer:
        store = get_typestore(Stores.ROS2_HUMBLE)
        connection = writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
        for k, row in enumerate(samples()):
            writer.write(connection, k, imu_message(row, is_cdr=True))
    if mode == "query":
        endless = (
            "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT count(*) AS schema_version FROM c"
        )
        file = next(path.glob("*.db3")).rename(path / "any name")
        yaml = path / "metadata.yaml"
        yaml.write_text(yaml.read_text("utf-8").replace("rec.db3", file.name), "utf-8")
        with sqlite3.connect(file) as database:
            database.executescript(f"DROP TABLE schema; CREATE VIEW schema AS {endless}")
        database.close()
        assert_refused(path, "foreign.damaged")
    elif mode == "description":
        file = path / "metadata.yaml"
        file.write_text(file.read_text("utf-8") + "#" * (1 << 20), "utf-8")
        assert_refused(path)
    else:
        monkeypatch.setattr(unpacking, "_MIN_TOTAL", 1000)
        monkeypatch.setattr(unpacking, "_MAX_RATIO", 1)
        assert_refused(path)


def test_packed_recordings_within_the_limits_are_read(tmp_path: Path) -> None:
    import scipy.io

    rows = samples()
    imu = np.column_stack([0.02 * rows[:, 1:], rows[:, 0]])
    settings = {"a": imu, "names": np.array(["x", "yy"], object), "empty": np.zeros((0, 7))}
    for packed in (False, True):
        scipy.io.savemat(tmp_path / "rec.mat", {"imu": imu, "s": settings}, do_compression=packed)
        (tmp_path / "rec.toml").write_text(TOML)
        assert open_log(tmp_path / "rec.mat", None, "imu").facts().samples == len(rows)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("value", [0.0, 1e300, np.inf, np.nan])
def test_impossible_numbers_cause_no_warning(tmp_path: Path, value: float) -> None:
    import scipy.io

    rows = samples()
    imu = np.column_stack([0.02 * rows[:, 1:], rows[:, 0]])
    for columns in (slice(0, 1), slice(0, 6), slice(3, 6), slice(6, 7)):
        changed = imu.copy()
        changed[:, columns] = value
        scipy.io.savemat(tmp_path / "rec.mat", {"imu": changed})
        (tmp_path / "rec.toml").write_text(TOML)
        with suppress(InputError):
            list(open_log(tmp_path / "rec.mat", None, "imu").blocks())


def test_damaged_text_of_tdms_is_not_printed(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    tdms = pytest.importorskip("nptdms", reason="npTDMS is not installed")
    with tdms.TdmsWriter(path := tmp_path / "rec.tdms") as writer:
        writer.write_segment([tdms.ChannelObject("imu", "accel_x", np.arange(9.0), {"unit_string": "äöü" * 9})])
    path.write_bytes(path.read_bytes().replace("äöü".encode(), b"\xff" * 6))
    assert_refused(path, "foreign.no_imu")
    assert capfd.readouterr() == ("", "")
