"""Damage in a raw log affects only the damaged rows: the others are read and the damaged rows are reported."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from records_samples import META, joined, make_block

from calstation.errors import InputError
from calstation.estimation.common import SampleBlock
from calstation.records import LogMeta, RawLogWriter, open_log, raw_rows
from calstation.records.raw.raw_log import CHECKSUM_COLUMN, CHUNK_ROWS, row_checks, row_dtype
from calstation.records.raw.raw_read import DamagedRows, intact_rows
from tests.helpers import raises_code

ROWS = 30 * CHUNK_ROWS
STEP = 20
#: First row of the second stage.
CHANGE = 14_860
#: Sequence number of the first row.
FIRST = 7


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """A closed log, and the same log just before closing."""
    path = tmp_path_factory.mktemp("logs") / "run.h5"
    writer = RawLogWriter(path, LogMeta.model_validate(META))
    for start in range(0, ROWS, STEP):
        writer.append(make_block("rate" if start < CHANGE else "six_position", FIRST + start, STEP))
        writer.flush()
    writer.event({"event": "StageSolved", "stage": "rate"})
    writer.sync()
    left = path.read_bytes()
    writer.close("passed")
    return {"closed": path.read_bytes(), "left open": left}


def offset_of(data: bytes, row: int) -> int:
    """Return the offset of a row in the file, found by its number and time."""
    (offset,) = [
        at
        for at in _found(data, np.int64(FIRST + row).tobytes())
        if np.frombuffer(data, "<f8", 1, at + 8)[0] == (FIRST + row + 1) / 100.0
    ]
    return offset


def _found(data: bytes, part: bytes) -> list[int]:
    offsets, at = [], data.find(part)
    while at >= 0:
        offsets.append(at)
        at = data.find(part, at + 1)
    return offsets


def read(path: Path) -> tuple[list[int], tuple[DamagedRows, ...]]:
    """Return sequence numbers and damaged rows of a log."""
    log = open_log(path)
    seq: list[int] = joined(list(log.blocks()))["seq"].tolist()
    assert log.facts().samples == len(seq)
    return seq, log.damaged_rows


@pytest.mark.parametrize("name", ["closed", "left open"])
@pytest.mark.parametrize("row", [0, 1, 5000, CHUNK_ROWS * 16, CHANGE - 20, ROWS - 60])
def test_page_of_zeros_damages_only_its_rows(tmp_path: Path, logs: dict[str, bytes], name: str, row: int) -> None:
    data = bytearray(logs[name])
    at = offset_of(logs[name], row) + 20
    data[at : at + 4096] = bytes(4096)
    lost = -(-(20 + 4096) // row_dtype(0, False).itemsize)
    (tmp_path / "run.h5").write_bytes(data)
    seq, (part,) = read(tmp_path / "run.h5")
    assert seq == [n for n in range(FIRST, FIRST + ROWS) if not FIRST + row <= n < FIRST + row + lost]
    assert part == DamagedRows(row, lost, FIRST + row - 1 if row else None, FIRST + row + lost)


def test_checksum_covers_every_bit_of_a_row() -> None:
    rows = np.zeros(1, row_dtype(1, True))
    rows["seq"], rows["time"], rows["counts"], rows["angles"] = 70000, 350.005, 48977.0, np.nan
    rows["temperature"], rows["step"], rows["stage"], rows["valid"] = 23.5, 12, 1, 1
    rows[CHECKSUM_COLUMN] = row_checks(rows)
    wpart = rows.tobytes()
    for bit in range(8 * len(wpart)):
        wrong = bytearray(wpart)
        wrong[bit // 8] ^= 1 << bit % 8
        row = np.frombuffer(bytes(wrong), rows.dtype)
        assert row_checks(row)[0] != row[CHECKSUM_COLUMN][0], bit
    assert row_checks(np.zeros(1, rows.dtype))[0] != 0, "never written"


def test_missing_end_is_damage_only_in_a_closed_log(tmp_path: Path, logs: dict[str, bytes]) -> None:
    for name, damaged in (
        ("left open", ()),
        ("closed", (DamagedRows(ROWS - 30, 30, FIRST + ROWS - 31, None),)),
    ):
        data = bytearray(logs[name])
        at, end = offset_of(logs[name], ROWS - 30), offset_of(logs[name], ROWS - 1)
        data[at : end + 99] = bytes(end + 99 - at)
        (tmp_path / "run.h5").write_bytes(data)
        assert read(tmp_path / "run.h5") == (list(range(FIRST, FIRST + ROWS - 30)), damaged)


@pytest.mark.parametrize("share", [0.1, 0.37, 0.5, 0.83, 0.99])
def test_all_rows_of_a_truncated_log_are_read(tmp_path: Path, logs: dict[str, bytes], share: float) -> None:
    length = int(share * len(logs["closed"]))
    (tmp_path / "run.h5").write_bytes(logs["closed"][:length])
    seq, (part,) = read(tmp_path / "run.h5")
    assert seq == list(range(FIRST, FIRST + len(seq)))
    assert part == DamagedRows(len(seq), ROWS - len(seq), FIRST + len(seq) - 1, None)
    size = row_dtype(0, False).itemsize
    chunk, other = CHUNK_ROWS * size, 40_000  # the truncated last chunk, and other data
    assert len(seq) * size > length - chunk - other


def test_chunks_missing_from_the_index_are_damaged_rows(tmp_path: Path, logs: dict[str, bytes]) -> None:
    data = bytearray(logs["closed"])
    block = logs["closed"].index(b"EADB")  # a part of the chunk index with its own checksum
    data[block + 20] ^= 1
    (tmp_path / "run.h5").write_bytes(data)
    seq, (part,) = read(tmp_path / "run.h5")
    assert part.row % CHUNK_ROWS == 0
    assert part.count % CHUNK_ROWS == 0
    assert 0 < part.count < ROWS
    assert len(seq) == ROWS - part.count
    assert (part.after, part.before) == (FIRST + part.row - 1, FIRST + part.row + part.count)


def test_rows_with_decreasing_sequence_numbers_are_skipped(tmp_path: Path, logs: dict[str, bytes]) -> None:
    data = bytearray(logs["closed"])
    size = row_dtype(0, False).itemsize
    early, late = (offset_of(logs["closed"], row) for row in (100, 2000))
    data[late : late + 3 * size] = data[early : early + 3 * size]
    (tmp_path / "run.h5").write_bytes(data)
    seq, damaged = read(tmp_path / "run.h5")
    assert damaged == (DamagedRows(2000, 3, FIRST + 1999, FIRST + 2003),)
    assert seq == [n for n in range(FIRST, FIRST + ROWS) if not 2000 <= n - FIRST < 2003]


def test_damaged_configuration_is_refused(tmp_path: Path, logs: dict[str, bytes]) -> None:
    data = logs["closed"].replace(b'"latitude_deg":34', b'"latitude_deg":35')
    assert data != logs["closed"]
    (tmp_path / "run.h5").write_bytes(data)
    with raises_code(InputError, "log.damaged_configuration"):
        open_log(tmp_path / "run.h5")


def test_rows_after_damaged_rows_are_read(tmp_path: Path, logs: dict[str, bytes]) -> None:
    data = bytearray(logs["closed"])
    for row in (10, 12, 3000):
        data[offset_of(logs["closed"], row) + 30] ^= 4
    (tmp_path / "run.h5").write_bytes(data)
    seq, damaged = read(tmp_path / "run.h5")
    parts = np.array([(part.row, part.count) for part in damaged])
    for start, stop in ((0, 30), (11, 12), (2990, 3010), (ROWS - 10, ROWS + 10), (40, 40)):
        assert raw_rows(tmp_path / "run.h5", start, stop, parts)["seq"].tolist() == seq[start:stop]


@given(kept=st.lists(st.booleans(), max_size=40), start=st.integers(0, 45), length=st.integers(0, 45))
def test_undamaged_row_numbers_exclude_damaged_rows(kept: list[bool], start: int, length: int) -> None:
    flags = np.array(kept, bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[True], flags, [True]]).astype(int)))
    damaged = np.column_stack([edges[::2], edges[1::2] - edges[::2]]).astype(np.int64)
    good = [*np.flatnonzero(flags).tolist(), *range(len(kept), len(kept) + 100)]
    assert intact_rows(damaged, start, start + length).tolist() == good[start : start + length]


def test_log_without_samples_has_no_damaged_rows(tmp_path: Path) -> None:
    writer = RawLogWriter(tmp_path / "run.h5", LogMeta.model_validate(META))
    empty = make_block("rate", 0, 5).part(0, 0)
    assert isinstance(empty, SampleBlock)
    writer.append(empty)
    writer.close("stopped")
    log = open_log(tmp_path / "run.h5")
    assert (log.facts().samples, log.damaged_rows) == (0, ())
