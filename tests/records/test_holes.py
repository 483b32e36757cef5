"""Damage in a raw log costs the rows that it hit: what stands before and behind is read, and the hole is told."""

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from records_samples import META, joined, make_block

from calstation.errors import InputError
from calstation.estimation.common.samples import SampleBlock
from calstation.records.log import open_log
from calstation.records.meta import LogMeta
from calstation.records.raw_log import CHECK, CHUNK_ROWS, RawLogWriter, row_checks, row_dtype
from calstation.records.raw_read import DamagedRows, raw_rows, without
from tests.helpers import raises_code

ROWS = 30 * CHUNK_ROWS
STEP = 20
#: First row of the second stage.
CHANGE = 14_860
#: Sequence number of the first row.
FIRST = 7


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """A log that was closed, and the same one a moment before."""
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


def place_of(data: bytes, row: int) -> int:
    """Where a row stands in the file: by its number, time and what is always the same."""
    (place,) = [
        at
        for at in _found(data, np.int64(FIRST + row).tobytes())
        if np.frombuffer(data, "<f8", 1, at + 8)[0] == (FIRST + row + 1) / 100.0
    ]
    return place


def _found(data: bytes, part: bytes) -> list[int]:
    places, at = [], data.find(part)
    while at >= 0:
        places.append(at)
        at = data.find(part, at + 1)
    return places


def read(path: Path) -> tuple[list[int], tuple[DamagedRows, ...]]:
    """Sequence numbers and holes of a log."""
    log = open_log(path)
    seq: list[int] = joined(list(log.blocks()))["seq"].tolist()
    assert log.facts().samples == len(seq)
    return seq, log.holes


@pytest.mark.parametrize("name", ["closed", "left open"])
@pytest.mark.parametrize("row", [0, 1, 5000, CHUNK_ROWS * 16, CHANGE - 20, ROWS - 60])
def test_a_page_of_zeros_costs_the_rows_on_it(tmp_path: Path, logs: dict[str, bytes], name: str, row: int) -> None:
    data = bytearray(logs[name])
    at = place_of(logs[name], row) + 20
    data[at : at + 4096] = bytes(4096)
    lost = -(-(20 + 4096) // row_dtype(0, False).itemsize)
    (tmp_path / "run.h5").write_bytes(data)
    seq, (hole,) = read(tmp_path / "run.h5")
    assert seq == [n for n in range(FIRST, FIRST + ROWS) if not FIRST + row <= n < FIRST + row + lost]
    assert hole == DamagedRows(row, lost, FIRST + row - 1 if row else None, FIRST + row + lost)


def test_every_bit_of_a_row_is_watched() -> None:
    rows = np.zeros(1, row_dtype(1, True))
    rows["seq"], rows["time"], rows["counts"], rows["angles"] = 70000, 350.005, 48977.0, np.nan
    rows["temperature"], rows["step"], rows["stage"], rows["valid"] = 23.5, 12, 1, 1
    rows[CHECK] = row_checks(rows)
    whole = rows.tobytes()
    for bit in range(8 * len(whole)):
        wrong = bytearray(whole)
        wrong[bit // 8] ^= 1 << bit % 8
        row = np.frombuffer(bytes(wrong), rows.dtype)
        assert row_checks(row)[0] != row[CHECK][0], bit
    assert row_checks(np.zeros(1, rows.dtype))[0] != 0, "never written"


def test_the_rows_behind_a_torn_end_were_never_there(tmp_path: Path, logs: dict[str, bytes]) -> None:
    for name, holes in (
        ("left open", ()),
        ("closed", (DamagedRows(ROWS - 30, 30, FIRST + ROWS - 31, None),)),
    ):
        data = bytearray(logs[name])
        at, end = place_of(logs[name], ROWS - 30), place_of(logs[name], ROWS - 1)
        data[at : end + 99] = bytes(end + 99 - at)
        (tmp_path / "run.h5").write_bytes(data)
        assert read(tmp_path / "run.h5") == (list(range(FIRST, FIRST + ROWS - 30)), holes)


@pytest.mark.parametrize("share", [0.1, 0.37, 0.5, 0.83, 0.99])
def test_of_a_log_cut_short_all_is_read_that_is_there(tmp_path: Path, logs: dict[str, bytes], share: float) -> None:
    length = int(share * len(logs["closed"]))
    (tmp_path / "run.h5").write_bytes(logs["closed"][:length])
    seq, (hole,) = read(tmp_path / "run.h5")
    assert seq == list(range(FIRST, FIRST + len(seq)))
    assert hole == DamagedRows(len(seq), ROWS - len(seq), FIRST + len(seq) - 1, None)
    size = row_dtype(0, False).itemsize
    chunk, room = CHUNK_ROWS * size, 40_000  # of the last chunk, which is cut, and of what is no sample
    assert len(seq) * size > length - chunk - room


def test_chunks_whose_place_is_lost_are_holes(tmp_path: Path, logs: dict[str, bytes]) -> None:
    data = bytearray(logs["closed"])
    block = logs["closed"].index(b"EADB")  # part of the list of chunks, with a check of its own
    data[block + 20] ^= 1
    (tmp_path / "run.h5").write_bytes(data)
    seq, (hole,) = read(tmp_path / "run.h5")
    assert hole.row % CHUNK_ROWS == 0
    assert hole.count % CHUNK_ROWS == 0
    assert 0 < hole.count < ROWS
    assert len(seq) == ROWS - hole.count
    assert (hole.after, hole.before) == (FIRST + hole.row - 1, FIRST + hole.row + hole.count)


def test_rows_out_of_their_place_are_left_out(tmp_path: Path, logs: dict[str, bytes]) -> None:
    data = bytearray(logs["closed"])
    size = row_dtype(0, False).itemsize
    early, late = (place_of(logs["closed"], row) for row in (100, 2000))
    data[late : late + 3 * size] = data[early : early + 3 * size]
    (tmp_path / "run.h5").write_bytes(data)
    seq, holes = read(tmp_path / "run.h5")
    assert holes == (DamagedRows(2000, 3, FIRST + 1999, FIRST + 2003),)
    assert seq == [n for n in range(FIRST, FIRST + ROWS) if not 2000 <= n - FIRST < 2003]


def test_a_configuration_that_is_damaged_is_not_believed(tmp_path: Path, logs: dict[str, bytes]) -> None:
    data = logs["closed"].replace(b'"latitude_deg":34', b'"latitude_deg":35')
    assert data != logs["closed"]
    (tmp_path / "run.h5").write_bytes(data)
    with raises_code(InputError, "log.damaged_configuration"):
        open_log(tmp_path / "run.h5")


def without_checks(source: Path, target: Path, spoil: Callable[[np.ndarray], None]) -> None:
    """A log as they were before rows had checks."""
    with h5py.File(source, "r") as old, h5py.File(target, "w", libver="latest") as new:
        new.attrs["format"] = old.attrs["format"]
        for name in ("meta", "stages", "events", "results", "closing"):
            new[name] = old[name][:]
        rows = old["samples"][:]
        plain = np.empty(len(rows), np.dtype(row_dtype(0, False).descr[:-1]))
        for name in plain.dtype.names or ():
            plain[name] = rows[name]
        spoil(plain)
        new["samples"] = plain


def test_logs_without_checks_are_read_as_before(tmp_path: Path, logs: dict[str, bytes]) -> None:
    (tmp_path / "run.h5").write_bytes(logs["closed"])

    def spoil(rows: np.ndarray) -> None:
        rows["seq"][5000] = 3

    without_checks(tmp_path / "run.h5", tmp_path / "old.h5", lambda rows: None)
    assert read(tmp_path / "old.h5") == (list(range(FIRST, FIRST + ROWS)), ())
    without_checks(tmp_path / "run.h5", tmp_path / "spoilt.h5", spoil)
    with raises_code(InputError, "log.damaged_row"):
        read(tmp_path / "spoilt.h5")


def test_stored_rows_are_found_behind_holes(tmp_path: Path, logs: dict[str, bytes]) -> None:
    data = bytearray(logs["closed"])
    for row in (10, 12, 3000):
        data[place_of(logs["closed"], row) + 30] ^= 4
    (tmp_path / "run.h5").write_bytes(data)
    seq, holes = read(tmp_path / "run.h5")
    places = np.array([(hole.row, hole.count) for hole in holes])
    for start, stop in ((0, 30), (11, 12), (2990, 3010), (ROWS - 10, ROWS + 10), (40, 40)):
        assert raw_rows(tmp_path / "run.h5", start, stop, places)["seq"].tolist() == seq[start:stop]


@given(kept=st.lists(st.booleans(), max_size=40), start=st.integers(0, 45), length=st.integers(0, 45))
def test_stretches_between_holes_are_the_good_rows(kept: list[bool], start: int, length: int) -> None:
    flags = np.array(kept, bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[True], flags, [True]]).astype(int)))
    holes = np.column_stack([edges[::2], edges[1::2] - edges[::2]]).astype(np.int64)
    good = [*np.flatnonzero(flags).tolist(), *range(len(kept), len(kept) + 100)]
    found = [row for a, b in without(holes, start, start + length) for row in range(a, b)]
    assert found == good[start : start + length]


def test_a_log_without_samples_has_no_holes(tmp_path: Path) -> None:
    writer = RawLogWriter(tmp_path / "run.h5", LogMeta.model_validate(META))
    empty = make_block("rate", 0, 5).part(0, 0)
    assert isinstance(empty, SampleBlock)
    writer.append(empty)
    writer.close("stopped")
    log = open_log(tmp_path / "run.h5")
    assert (log.facts().samples, log.holes) == (0, ())
