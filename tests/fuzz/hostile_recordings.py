"""Hostile recordings in the formats of other programs, made of valid ones.

In each, fields of the structure are replaced, rows are replaced by extreme ones, records are removed and repeated, or
the packed content is larger than a computer can hold.
"""

import bz2
import io
import itertools
import random
import sqlite3
import struct
import sys
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path

import h5py
import numpy as np
import scipy.io

sys.path += [str(Path(__file__).parents[2]), str(Path(__file__).parents[1] / "records")]  # as pytest does

from foreign_samples import NAMES, TOML, UNITS, imu_message, samples
from test_flight_logs import FIELDS, FIFO, microseconds, sensor, write_dataflash, write_ulog
from test_foreign_formats import write_mcap

#: Bytes into which a bomb unpacks.
_BOMB = 3 << 30
_NUMBERS = (0, 1, 2, 7, 8, 127, 255, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**48, 2**63 - 1, 2**64 - 1)
_FLOATS = (float("nan"), float("inf"), -1.0, 1e300, 1e18, 1e-300, 5e-324)
_TEXTS = (
    b"",
    b"\0",
    b"[/red]",
    b"\x1b[2J",
    b"../../x",
    b"a" * 40_000,
    b"\xff\xfe",
    b"uint8_t[999999999] x",
    "测".encode(),
)


@cache
def bomb(packing: str) -> bytes:
    """Return packed zeros that unpack into gigabytes."""
    piece, count = bytes(1 << 24), _BOMB >> 24
    if packing == "zlib":
        compressor = zlib.compressobj(1)
        return b"".join([*(compressor.compress(piece) for _ in range(count)), compressor.flush()])
    if packing == "bz2":
        return bz2.compress(bytes(1 << 28)) * 8
    if packing == "lz4":
        import lz4.frame

        lz4_compressor = lz4.frame.LZ4FrameCompressor()
        parts = [
            lz4_compressor.begin(),
            *(lz4_compressor.compress(piece) for _ in range(count)),
            lz4_compressor.flush(),
        ]
        return b"".join(parts)
    import zstandard

    zstd = zstandard.ZstdCompressor().compressobj()
    return b"".join([*(zstd.compress(piece) for _ in range(count)), zstd.flush()])


def mangled(data: bytes, chance: random.Random) -> bytes:
    """Replace numbers, texts and blocks of a file, most often near its ends, where formats keep their structure."""
    content = bytearray(data)
    for _ in range(chance.choice((1, 1, 2, 4))):
        near = chance.choice((64, 1024, len(content)))
        at = chance.randrange(max(1, min(near, len(content))))
        at = at if chance.random() < 0.7 else max(0, len(content) - 1 - at)
        action = chance.randrange(9)
        if action < 4:
            form = chance.choice("BHIQ")
            size = struct.calcsize(form)
            order = chance.choice("<<<>")
            content[at : at + size] = struct.pack(order + form, chance.choice(_NUMBERS) % (1 << (8 * size)))
        elif action == 4:
            content[at : at + 8] = struct.pack("<d", chance.choice(_FLOATS))
        elif action == 5:
            text = chance.choice(_TEXTS)
            content[at : at + (len(text) if chance.random() < 0.5 else 0)] = text
        elif action == 6:
            del content[at : at + chance.choice((1, 8, 100, 5000))]
        elif action == 7:
            block = content[at : at + chance.choice((1, 8, 100, 5000))]
            content[at:at] = block * chance.choice((1, 3, 50))
        else:
            del content[chance.randrange(len(content)) :]
    return bytes(content)


def rows_with_extremes(rows: np.ndarray, chance: random.Random, first: int = 0) -> np.ndarray:
    """Replace numbers of some rows, from a column on."""
    rows = rows.copy()
    for _ in range(chance.choice((0, 1, 3))):
        where: int | slice = chance.randrange(len(rows)) if chance.random() < 0.7 else slice(None)
        rows[where, chance.randrange(first, rows.shape[1])] = chance.choice((*_FLOATS, 0.0, 1e9))
    return rows


class Recordings:
    """Makes hostile recordings in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._valid: dict[str, bytes] = {}
        self.kinds: tuple[Callable[[random.Random], Path], ...] = (
            *(self._bag1, self._bag2, self._mcap, self._ulog, self._dataflash, self._novatel),
            *(self._matlab5, self._matlab7, self._tdms),
        )

    def make(self, kind: int, chance: random.Random) -> list[str]:
        """Write a recording and its TOML, and return the arguments of the command that opens it."""
        path = self.kinds[kind](chance)
        sizes = "gyro_lsb = 1e-6\naccel_lsb = 1e-5\n"  # NovAtel's logs do not give it
        toml = TOML + {".tdms": UNITS, ".asc": sizes}.get(path.suffix, "")
        (self.folder / "hostile.toml").write_text(toml, "utf-8")
        target = self.folder / f"imported{chance.randrange(1 << 30)}.h5"
        command: list[object] = ["import", path, "-o", target, "--meta", self.folder / "hostile.toml"]
        if chance.random() < 0.1:
            command += ["--topic", chance.choice(("/imu", "", "x[/red]"))]
        return [str(word) for word in command]

    def _base(self, name: str, make: Callable[[Path], None]) -> bytes:
        """Return the bytes of a valid file, which is written once."""
        if name not in self._valid:
            path = self.folder / f"valid{Path(name).suffix}"
            make(path)
            self._valid[name] = path.read_bytes()
        return self._valid[name]

    def _write(self, name: str, data: bytes) -> Path:
        path = self.folder / name
        path.write_bytes(data)
        return path

    def _bag1(self, chance: random.Random) -> Path:
        from rosbags.rosbag1 import Writer
        from rosbags.typesys import Stores, get_typestore

        def make(path: Path, packing: str) -> None:
            path.unlink(missing_ok=True)
            writer = Writer(path)
            if packing:
                writer.set_compression(Writer.CompressionFormat[packing])
            with writer:
                store = get_typestore(Stores.ROS1_NOETIC)
                connection = writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
                for k, row in enumerate(samples()):
                    writer.write(connection, int(2e7 * k), imu_message(row, is_cdr=False))

        packing = chance.choice(("", "", "BZ2", "LZ4"))
        data = self._base(f"1{packing}.bag", lambda path: make(path, packing))
        if packing and chance.random() < 0.15:
            return self._write("hostile.bag", self._bag_with_bomb(data, packing.lower()))
        return self._write("hostile.bag", mangled(data, chance))

    @staticmethod
    def _bag_with_bomb(data: bytes, packing: str) -> bytes:
        """Replace the content of the first chunk, and move the position of the index."""
        magic = {"bz2": b"BZh", "lz4": b"\x04\x22\x4d\x18"}[packing]
        size_at = data.index(magic) - 4
        (size,) = struct.unpack_from("<I", data, size_at)
        packed = bomb(packing)
        moved = len(packed) - size
        content = data[:size_at] + struct.pack("<I", len(packed)) + packed + data[size_at + 4 + size :]
        index = content.index(b"index_pos=") + 10
        (position,) = struct.unpack_from("<Q", content, index)
        return content[:index] + struct.pack("<Q", position + moved) + content[index + 8 :]

    def _bag2(self, chance: random.Random) -> Path:
        from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore

        storage = chance.choice(("SQLITE3", "SQLITE3", "MCAP"))
        packing = chance.choice(("", "FILE", "MESSAGE")) if storage == "SQLITE3" else ""
        folder = self.folder / f"valid{storage}{packing}"
        if not folder.exists():
            writer = Writer(folder, version=9, storage_plugin=StoragePlugin[storage])
            if packing:
                writer.set_compression(CompressionMode[packing], CompressionFormat.ZSTD)
            with writer:
                store = get_typestore(Stores.ROS2_HUMBLE)
                connection = writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
                for k, row in enumerate(samples()):
                    writer.write(connection, int(2e7 * k), imu_message(row, is_cdr=True))
        hostile = self.folder / "hostile_bag"
        hostile.mkdir(exist_ok=True)
        for old in hostile.iterdir():
            old.unlink()
        for file in folder.iterdir():
            (hostile / file.name).write_bytes(file.read_bytes())
        (data,) = (file for file in hostile.iterdir() if file.name != "metadata.yaml")
        yaml = hostile / "metadata.yaml"
        action = chance.randrange(5)
        if action == 0:
            nested = "[" * 20_000
            lines = yaml.read_text("utf-8").splitlines()
            k = chance.randrange(len(lines))
            value = chance.choice(("1e400", nested, "*a", "&a [*a, *a]", "!!python/object:os.system x", "null", "-1"))
            lines[k] = lines[k].partition(":")[0] + ": " + value
            yaml.write_text("\n".join(lines), "utf-8")
        elif action == 1 and storage == "SQLITE3" and not packing:
            self._hostile_database(data, chance)
        elif action == 2 and packing == "FILE":
            data.write_bytes(bomb("zstd"))
        elif action == 3 and packing == "MESSAGE":
            with sqlite3.connect(data) as database:
                database.execute("UPDATE messages SET data = ? WHERE rowid = 5", (bomb("zstd"),))
            database.close()
        else:
            data.write_bytes(mangled(data.read_bytes(), chance))
        return hostile if chance.random() < 0.7 else data

    @staticmethod
    def _hostile_database(path: Path, chance: random.Random) -> None:
        """Change a database in a way that keeps it valid."""
        endless = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT count(*)"
        statements = [
            f"DROP TABLE IF EXISTS schema; CREATE VIEW schema AS {endless} AS schema_version, 1 AS ros_distro FROM c",
            f"ALTER TABLE messages RENAME TO m; CREATE VIEW messages AS {endless} AS id FROM c",
            "UPDATE topics SET name = 5",
            "UPDATE topics SET offered_qos_profiles = '" + "[" * 30_000 + "'",
            "UPDATE topics SET type = 'x[/red]'",
            "UPDATE messages SET timestamp = 9e99",
            "UPDATE messages SET timestamp = NULL",
            "UPDATE messages SET data = zeroblob(90000000) WHERE rowid < 2",
            "UPDATE messages SET data = 'text'",
            "UPDATE messages SET data = zeroblob(0)",
            "UPDATE messages SET topic_id = 99",
        ]
        database = sqlite3.connect(path)
        try:
            database.executescript(chance.choice(statements))
        except sqlite3.Error:
            pass
        finally:
            database.close()

    def _mcap(self, chance: random.Random) -> Path:
        messages = [imu_message(row, is_cdr=True) for row in rows_with_extremes(samples(), chance, 1)]
        packing = chance.choice(("", "zstd", "lz4"))
        path = self.folder / "hostile.mcap"
        write_mcap(path, {"/imu": messages}, packed=packing == "zstd")
        data = path.read_bytes()
        if packing and chance.random() < 0.2:
            path.write_bytes(mcap_with_bomb(packing, chance.choice((True, False))))
            return path
        return self._write("hostile.mcap", mangled(data, chance) if chance.random() < 0.8 else data)

    def _ulog(self, chance: random.Random) -> Path:
        rows = microseconds()
        name = "sensor_gyro", "sensor_accel"
        topics = {
            (name[0], 0): (FIELDS, sensor(rows, slice(1, 4))),
            (name[1], 0): (FIELDS, sensor(rows, slice(4, 7), shift=-900)),
        }
        if chance.random() < 0.3:
            scale = chance.choice((0.001, 0.0, float("nan"), 1e30))
            count = chance.choice((0, 5, 32, 33, 255))
            batch = [
                (1000 * k, 1000 * k + 1, 7, chance.choice((200.0, 0.0, 1e30)), scale, count, *range(96))
                for k in range(50)
            ]
            topics = {(f"{each}_fifo", 0): (FIFO, batch) for each in name}
        path = self.folder / "hostile.ulg"
        write_ulog(path, topics)
        data = path.read_bytes()
        if chance.random() < 0.3:
            old, new = chance.choice(
                (
                    (b"float x", b"float[60000] x"),
                    (b"float x", b"float[999999999] x"),
                    (b"float x", b"sensor_gyro x"),
                    (b"float x", b"nothing x"),
                    (b"uint64_t timestamp;", b""),
                    (b"float x", b"char[7] x"),
                    (b":", b""),
                )
            )
            data = self._replaced_format(data, old, new)
        return self._write("hostile.ulg", mangled(data, chance) if chance.random() < 0.7 else data)

    @staticmethod
    def _replaced_format(data: bytes, old: bytes, new: bytes) -> bytes:
        """Replace text in the messages that describe formats, with valid lengths."""
        result, at = data[:16], 16
        while at + 3 <= len(data):
            size, kind = struct.unpack_from("<HB", data, at)
            body = data[at + 3 : at + 3 + size]
            if kind == ord("F"):
                body = body.replace(old, new)
            result += struct.pack("<HB", len(body) & 0xFFFF, kind) + body
            at += 3 + size
        return result

    def _dataflash(self, chance: random.Random) -> Path:
        if chance.random() < 0.4:
            head = "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n"
            head += "FMT, 130, 36, IMU, QBffffff, TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ\n"
            lines = [f"IMU, {int(row[0])}, 0, {', '.join(map(repr, row[1:].tolist()))}\n" for row in microseconds()]
            return self._write("hostile.log", mangled((head + "".join(lines)).encode(), chance))
        types = chance.choice(("QBffffffb", "QBffffffb", "ZZZZZZZZZ", "QBdddddda", "QBeeeeeeb", "", "????"))
        values = {"Q": lambda x: int(x), "f": float, "d": float}
        form = {"IMU": ("QBffffffb", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,T")}
        path = self.folder / "hostile.bin"
        messages = [("IMU", (values["Q"](row[0]), 0, *row[1:], 31)) for row in microseconds()]
        write_dataflash(path, form, messages)
        data = path.read_bytes().replace(b"QBffffffb" + bytes(7), types.encode().ljust(16, b"\0"), 1)
        return self._write("hostile.bin", mangled(data, chance))

    def _novatel(self, chance: random.Random) -> Path:
        rows = rows_with_extremes(samples(), chance, 1)
        text = b""
        for row in rows:
            seconds, counts = (
                row[0] % 604800,
                [int(c) if np.isfinite(c) and abs(c) < 1e9 else 0 for c in 1000 * row[1:]],
            )
            body = f"RAWIMUA,COM1,0,55.0,FINESTEERING,2068,{seconds:.3f},00000000,97b7,0;2068,{seconds:.9f},00000017,"
            body += ",".join(map(str, [counts[5], -counts[4], counts[3], counts[2], -counts[1], counts[0]]))
            text += f"#{body}*{zlib.crc32(body.encode(), 2**32 - 1) ^ (2**32 - 1):08x}\r\n".encode()
        return self._write("hostile.asc", mangled(text, chance) if chance.random() < 0.8 else text)

    def _matlab5(self, chance: random.Random) -> Path:
        rows = rows_with_extremes(samples(), chance)
        stream = io.BytesIO()
        imu = np.column_stack([rows[:, 1:], rows[:, 0]])
        extra = chance.choice(
            ({}, {"s": {"a": imu, "b": "text"}}, {"c": np.array([1, "x", imu], object)}, {"e": np.zeros((0, 7))})
        )
        packed = chance.random() < 0.5
        scipy.io.savemat(stream, {"imu": imu, **extra}, do_compression=packed)
        data = stream.getvalue()
        if chance.random() < 0.25:
            return self._write("hostile.mat", matlab_bomb(chance))
        if packed and chance.random() < 0.7:
            (size,) = struct.unpack_from("<I", data, 132)
            content = mangled(zlib.decompress(data[136 : 136 + size]), chance)
            element = zlib.compress(content)
            return self._write("hostile.mat", data[:128] + struct.pack("<II", 15, len(element)) + element)
        return self._write("hostile.mat", mangled(data, chance))

    def _matlab7(self, chance: random.Random) -> Path:
        path = self.folder / "hostile.mat"
        path.unlink(missing_ok=True)
        rows = rows_with_extremes(samples(), chance)
        with h5py.File(path, "w", userblock_size=512) as file:
            imu = np.column_stack([rows[:, 1:], rows[:, 0]]).T
            action = chance.randrange(10)
            if action == 0:
                file.create_dataset("imu", (7, 1 << 32), "f8", chunks=(7, 1024))
            elif action == 1:
                file.create_dataset("imu", (7, 1 << 26), "u1", chunks=(7, 1 << 20), compression="gzip")
                file["imu"][0, :5] = 1
            elif action == 2:
                file["imu"] = h5py.ExternalLink("/dev/zero", "/x")
            elif action == 3:
                file.create_group("a")["b"] = h5py.SoftLink("/a")
                file["a"]["c"] = file["a"]
                file["a"]["d"] = file["a"]
            elif action == 4:
                file.create_dataset("imu", (7, 1000), "f8", external=[("/dev/zero", 0, 56_000)])
            elif action == 5:
                layout = h5py.VirtualLayout((7, 1 << 30), "f8")
                file.create_virtual_dataset("imu", layout)
            elif action == 6:
                file.create_dataset("imu", (3, 3), h5py.vlen_dtype(np.float64))
                file["kind"] = np.dtype("f8")
            else:
                file["imu"] = imu
        data = path.read_bytes()
        return self._write("hostile.mat", mangled(data, chance) if chance.random() < 0.5 else data)

    def _tdms(self, chance: random.Random) -> Path:
        import nptdms

        rows = rows_with_extremes(samples(), chance)
        path = self.folder / "hostile.tdms"
        segments = np.array_split(rows, chance.choice((1, 3)))
        with nptdms.TdmsWriter(path) as writer:
            for part in segments:
                channels = [nptdms.ChannelObject("imu", n, c) for n, c in zip(NAMES, part.T.copy(), strict=True)]
                text = nptdms.ChannelObject("imu", "note", ["a", "b" * 100])
                writer.write_segment([*channels, text] if chance.random() < 0.3 else channels)
        data = path.read_bytes()
        return self._write("hostile.tdms", mangled(data, chance) if chance.random() < 0.9 else data)


def mcap_with_bomb(packing: str, says_so: bool) -> bytes:
    """Return an MCAP file with one chunk that unpacks into gigabytes, and says a small size or the true one."""

    def record(code: int, content: bytes) -> bytes:
        return struct.pack("<BQ", code, len(content)) + content

    def text(content: bytes) -> bytes:
        return struct.pack("<I", len(content)) + content

    size = _BOMB if says_so else 4096
    magic = b"\x89MCAP0\r\n"
    schema = record(3, struct.pack("<H", 1) + text(b"sensor_msgs/msg/Imu") + text(b"ros2msg") + text(b""))
    channel = record(4, struct.pack("<HH", 1, 1) + text(b"/imu") + text(b"cdr") + text(b""))
    head = magic + record(1, text(b"") + text(b"x")) + schema + channel
    packed = bomb(packing)
    chunk = record(
        6, struct.pack("<QQQI", 0, 10, size, 0) + text(packing.encode()) + struct.pack("<Q", len(packed)) + packed
    )
    index = record(7, struct.pack("<H", 1) + text(struct.pack("<QQ", 1, 0)))
    at = len(head)
    entry = struct.pack("<QQQQ", 0, 10, at, len(chunk)) + text(struct.pack("<HQ", 1, at + len(chunk)))
    entry += struct.pack("<Q", len(index)) + text(packing.encode()) + struct.pack("<QQ", len(packed), size)
    body = head + chunk + index + record(15, struct.pack("<I", 0))
    statistics = struct.pack("<QHIIIIQQ", 1, 1, 1, 0, 0, 1, 0, 10) + text(struct.pack("<HQ", 1, 1))
    summary = schema + channel + record(11, statistics) + record(8, entry)
    return body + summary + record(2, struct.pack("<QQI", len(body), 0, 0)) + magic


def matlab_bomb(chance: random.Random) -> bytes:
    """Return a MATLAB file whose packed array is enormous, or says so, or that has very many small arrays."""
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H2s", 0x0100, b"IM")
    kind = chance.choice(("zeros", "bytes", "cells", "announced", "text", "nested"))

    def tagged(code: int, content: bytes) -> bytes:
        return struct.pack("<II", code, len(content)) + content + bytes(-len(content) % 8)

    def start(array: int, dims: tuple[int, ...], name: bytes) -> bytes:
        return (
            tagged(6, struct.pack("<II", array, 0)) + tagged(5, struct.pack(f"<{len(dims)}i", *dims)) + tagged(1, name)
        )

    if kind == "nested":
        nested, count = start(1, (1, 1), b"c"), 60_000
        size = 8 + len(nested)
        return head + b"".join(struct.pack("<II", 14, size * (count - k) - 8) + nested for k in range(count))
    if kind == "cells":
        cell = tagged(14, start(6, (0, 0), b"") + tagged(9, b""))
        count = 1_000_000
        content = start(1, (count, 1), b"c") + cell * count
        return head + element(tagged(14, content))
    rows = {"zeros": 1 << 25, "bytes": 1 << 27, "announced": 1 << 27, "text": 1 << 28}[kind]
    code, array, width = {"zeros": (9, 6, 8), "text": (4, 4, 2)}.get(kind, (2, 6, 1))
    shape = (1, rows) if kind == "text" else (rows, 7)
    size = int(np.prod(shape)) * width
    prefix = start(array, shape, b"imu") + struct.pack("<II", code, min(size, 2**32 - 8))
    pieces = itertools.repeat(bytes(1 << 24), 1 if kind == "announced" else min(size, 2**32 - 8) >> 24)
    compressor = zlib.compressobj(1)
    announced = struct.pack("<II", 14, min(len(prefix) + size, 2**32 - 8))
    packed = [compressor.compress(announced + prefix), *map(compressor.compress, pieces), compressor.flush()]
    data = b"".join(packed)
    return head + struct.pack("<II", 15, len(data)) + data


def element(content: bytes) -> bytes:
    """Return a packed element of a MATLAB file."""
    data = zlib.compress(content, 1)
    return struct.pack("<II", 15, len(data)) + data
