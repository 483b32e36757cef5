"""Reader of raw logs, including logs of killed runs, which omits and reports damaged rows."""

import itertools
import time
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from calstation.errors import InputError
from calstation.estimation.common import LARGEST_VALUE, SampleBlock, true_intervals
from calstation.messages import os_reason
from calstation.parsing import parse_json
from calstation.records.files import NO_LOCKS, TEST_TIMEOUT, is_locked
from calstation.records.log import DamagedRows, Log
from calstation.records.meta import meta_from_json
from calstation.records.raw.raw_log import CHECKSUM_COLUMN, CHUNK_ROWS, row_checks
from calstation.records.raw.raw_structure import StructureError, check_structure, is_raw_log
from calstation.records.raw.superblock import SUPERBLOCK, AsClosed, is_unclosed, superblock_end, superblock_valid

#: Reason for the end of a stage that is not solved, because the units fail regardless of its result.
END_FAILING = "failing"
#: Reason for the end of a stage that the operator ended.
END_BY_OPERATOR = "operator"

_READ_ROWS = 16 * CHUNK_ROWS
#: Exceptions that h5py raises for a damaged file.
_HDF5_ERRORS = (
    *(OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError, IndexError, MemoryError, OverflowError),
)
_NO_DAMAGE = np.empty((0, 2), np.int64)
#: Largest magnitude of the integers of a row.
_MAX_INTEGER = 2**53
#: Columns of values that are not used if the sample is invalid.
_OF_VALID = ("counts", "others")
#: Number of attempts to open a file that a run may be writing, and the time between them, s.
_ATTEMPTS, _RETRY_INTERVAL = 4, 0.05
#: Time without changes after which a file on a file system without locks is no longer being written, s.
_RECENT = 10.0


def intact_rows(damaged: NDArray[np.int64], start: int, stop: int) -> NDArray[np.int64]:
    """Return the stored row numbers of a range of intact rows.

    Parameters
    ----------
    damaged : first row and number of rows of each damaged interval, shape (n, 2)
    start, stop : first intact row, and intact row after the last one, both counted without damaged rows
    """
    omitted = np.cumsum(damaged[:, 1])
    number = np.arange(start, stop)
    intervals_before = np.searchsorted(damaged[:, 0] - omitted + damaged[:, 1], number, side="right")
    return np.asarray(number + np.concatenate([[0], omitted])[intervals_before], np.int64)


def open_raw(path: Path, _: Path | None = None) -> Log:
    """Open a raw log and read its configuration, events and results. Raises InputError."""
    with _open_for_reading(path) as file:
        stored = file["meta"][:]
        if zlib.crc32(stored) != file.attrs["meta_crc32"]:
            raise InputError("log.damaged_configuration", file=path, detail="crc32")
        meta = meta_from_json(_text(stored), path)
        events, results, closing = (_json_lines(file, name) for name in ("events", "results", "closing"))
    last, damaged = closing[-1] if closing else {}, list[DamagedRows]()
    blocks = partial(raw_blocks, path, damaged)
    return Log(path, meta, blocks, events, results, last.get("outcome"), last.get("sha256"), _damaged=damaged)


def last_result(path: Path) -> dict[str, Any] | None:
    """Return the last result in a raw log as JSON data, reading nothing else; None if the log has no result.

    Raises InputError.
    """
    with _open_for_reading(path) as file:
        results = _json_lines(file, "results")
    return results[-1] if results else None


def being_written(path: Path, within: float = TEST_TIMEOUT) -> bool:
    """Return whether a run is still writing the log, as shown by its lock, which is tested for `within` s.

    On a file system without locks, where this program records no runs, a recent change counts instead.
    Raises InputError if the file cannot be read.
    """
    try:
        return is_locked(path, within)
    except OSError as exc:
        if exc.errno in NO_LOCKS:
            return time.time() - path.stat().st_mtime < _RECENT
        raise InputError("log.unreadable", file=path, reason=os_reason(exc)) from exc


def solved_stages(events: Iterable[Mapping[str, Any]]) -> tuple[str, ...]:
    """Return the stages that were solved, in order, according to the events of a log."""
    return tuple(event["stage"] for event in events if event.get("event") == "StageSolved")


def completed_points(events: Iterable[Mapping[str, Any]], stage: str) -> dict[int, Mapping[str, Any]]:
    """Return the events of the temperatures of a stage that were completed, by the number of the temperature."""
    return {e["index"]: e for e in events if e.get("event") == "PointCompleted" and e["stage"] == stage}


def can_be_resumed(events: Iterable[Mapping[str, Any]]) -> bool:
    """Return whether a stage or a temperature of a log need not be repeated."""
    return any(event.get("event") in ("StageSolved", "PointCompleted") for event in events)


def unsolved_stages(events: Iterable[Mapping[str, Any]]) -> frozenset[str]:
    """Return the stages that the run ended without solving them, because the unit failed regardless of them."""
    ends = (event for event in events if event.get("event") == "StageEnded" and event.get("reason") == END_FAILING)
    return frozenset(event["stage"] for event in ends)


def stages_ended_by_hand(
    events: Iterable[Mapping[str, Any]], schedules: Mapping[str, Mapping[str, Any]]
) -> tuple[str, ...]:
    """Return the stages that the operator ended before their schedules did, in order.

    A schedule without a number of rounds, duration and targets has no end of its own.
    """
    ends = (event for event in events if event.get("event") == "StageEnded" and event.get("reason") == END_BY_OPERATOR)
    schedule_of = {event["stage"]: schedules.get(event["stage"], {}) for event in ends}
    return tuple(
        stage
        for stage, schedule in schedule_of.items()
        if "rounds" not in schedule or any(schedule.get(name) for name in ("rounds", "duration_s", "targets"))
    )


def completed_rounds(events: Iterable[Mapping[str, Any]]) -> dict[str, int]:
    """Return the number of completed rounds, by stage, of the stages whose motion ended after a round."""
    ends = [event for event in events if event.get("event") == "StageEnded" and event.get("reason") != "plan"]
    return {event["stage"]: event["rounds"] for event in ends if "rounds" in event}


def step_labels(events: Iterable[Mapping[str, Any]]) -> dict[int, tuple[str | float, ...]]:
    """Return the labels of the moves by step number, according to the events of a log."""
    return {e["step"]: tuple(e["label"]) for e in events if e.get("event") == "StepStarted" and e.get("label")}


def raw_blocks(path: Path, damaged: list[DamagedRows] | None = None) -> Iterator[SampleBlock]:
    """Yield the samples of a raw log in order, in blocks of one stage.

    Damaged rows are omitted and added to `damaged`. Rows at the end of a log that was not closed were never written and
    are not damaged.

    Raises InputError if other parts of the file are damaged.
    """
    with _open_for_reading(path) as file:
        samples = file["samples"]
        names = [name.decode(errors="replace") for name in file["stages"][:]]
        closed = file["closing"].shape[0] > 0
        end = _row_count(path, samples)
        last, intact_end = -1, 0
        stored = np.empty(min(_READ_ROWS, end), samples.dtype)
        for start in range(0, end, _READ_ROWS):
            rows = stored[: end - start]
            _read(samples, start, rows)
            columns = {name: np.ascontiguousarray(rows[name]) for name in rows.dtype.names or ()}
            intact = (columns["stage"] < len(names)) & (row_checks(columns) == columns[CHECKSUM_COLUMN])
            intact &= _is_increasing(columns["seq"], intact, last)
            _check_magnitudes(path, columns, intact)
            for a, b in true_intervals(intact):
                if damaged is not None and start + a > intact_end:
                    after = None if last < 0 else last
                    damaged.append(DamagedRows(intact_end, start + a - intact_end, after, int(columns["seq"][a])))
                last, intact_end = int(columns["seq"][b - 1]), start + b
                yield from _blocks(columns, a, b, names)
        missing = int(samples.shape[0]) - intact_end
        if damaged is not None and closed and missing > 0:
            damaged.append(DamagedRows(intact_end, missing, None if last < 0 else last, None))


def _check_magnitudes(path: Path, columns: Mapping[str, np.ndarray], intact: NDArray[np.bool_]) -> None:
    """Raise InputError for a value beyond `LARGEST_VALUE`; NaN and the counts of invalid samples are permitted."""
    for name, values in columns.items():
        if name == CHECKSUM_COLUMN:
            continue
        limit = LARGEST_VALUE if values.dtype.kind == "f" else _MAX_INTEGER
        is_large = ((values > limit) | (values < -limit)).reshape(len(intact), -1).any(axis=1) & intact
        if name in _OF_VALID:
            is_large &= columns["valid"] != 0
        if is_large.any():
            seq = int(columns["seq"][np.argmax(is_large)])
            raise InputError("log.impossible_sample", file=path, column=name, seq=seq)


def row_count(path: Path) -> int:
    """Return the number of rows in a raw log, including damaged ones. Raises InputError."""
    with _open_for_reading(path) as file:
        return _row_count(path, file["samples"])


def raw_rows(path: Path, start: int, stop: int, damaged: NDArray[np.int64] = _NO_DAMAGE) -> np.ndarray:
    """Read the intact rows `start` to `stop` of a raw log as they are stored (see `raw_log.row_dtype`).

    Raises InputError.

    Parameters
    ----------
    path : the log
    start, stop : first row, and row after the last one
    damaged : first row and number of rows of each damaged interval, shape (n, 2)
    """
    with _open_for_reading(path) as file:
        samples = file["samples"]
        end = int(samples.shape[0]) - int(damaged[:, 1].sum())
        rows = intact_rows(damaged, start, max(start, min(stop, end)))
        intervals = np.split(rows, np.flatnonzero(np.diff(rows) != 1) + 1) if len(rows) else []
        return np.concatenate([samples[:0], *(samples[part[0] : part[-1] + 1] for part in intervals)])


def _row_count(path: Path, samples: h5py.Dataset) -> int:
    """Return the stored number of rows, limited by the file size because the number itself may be damaged."""
    return min(int(samples.shape[0]), path.stat().st_size // int(samples.dtype.itemsize))


def _read(samples: h5py.Dataset, start: int, rows: np.ndarray) -> None:
    """Read `rows` from `start` on; an unreadable chunk becomes zeros, which are invalid."""
    try:
        samples.read_direct(rows, np.s_[start : start + len(rows)])
    except _HDF5_ERRORS:
        if len(rows) <= CHUNK_ROWS:
            rows[:] = np.zeros((), rows.dtype)
            return
        for first in range(0, len(rows), CHUNK_ROWS):
            _read(samples, start + first, rows[first : first + CHUNK_ROWS])


def _is_increasing(seq: NDArray[np.int64], intact: NDArray[np.bool_], last: int) -> NDArray[np.bool_]:
    """Return a mask of the intact rows whose sequence number exceeds all preceding ones."""
    numbers = np.where(intact, seq, -1)
    return numbers > np.maximum.accumulate(np.concatenate([[last], numbers[:-1]]))


def _blocks(columns: Mapping[str, np.ndarray], start: int, stop: int, names: list[str]) -> Iterator[SampleBlock]:
    """Yield rows `start` to `stop` in blocks of one stage, which share the memory of `columns`."""
    stage = columns["stage"]
    edges = np.unique([start, *(start + 1 + np.flatnonzero(np.diff(stage[start:stop]))), stop])
    for a, b in itertools.pairwise(edges.tolist()):
        part = {name: values[a:b] for name, values in columns.items()}
        yield SampleBlock(
            names[int(stage[a])],
            part["seq"],
            part["time"],
            part["counts"],
            part["angles"],
            part["step"].astype(np.int64),
            part["valid"] != 0,
            part["temperature"],
            **{name: part[name] for name in ("others", "joints", "station", "chamber") if name in part},
        )


@contextmanager
def _open_for_reading(path: Path) -> Iterator[h5py.File]:
    """Open an HDF5 file for reading; every failure inside the context is raised as InputError."""
    if not path.is_file():
        raise InputError("log.not_found", file=path)
    try:
        with ExitStack() as stack:
            yield _open_repeatedly(path, stack)
    except StructureError as exc:
        raise InputError("log.structure", file=path, part=exc.part, what=exc.what) from exc
    except _HDF5_ERRORS as exc:
        raise InputError("log.damaged", file=path) from exc


def _open_repeatedly(path: Path, stack: ExitStack) -> h5py.File:
    """Open the file, with retries while a run is writing it. Raises InputError or `_HDF5_ERRORS`."""
    for _ in range(_ATTEMPTS - 1):
        with suppress(*_HDF5_ERRORS), ExitStack() as opened:
            file = _open(path, opened)
            stack.push(opened.pop_all())
            return file
        if not being_written(path):
            break
        time.sleep(_RETRY_INTERVAL)
    return _open(path, stack)


def _open(path: Path, stack: ExitStack) -> h5py.File:
    """Open the file, whether or not it was closed. Raises InputError if the format is different, or `_HDF5_ERRORS`."""
    with path.open("rb") as stream:
        head = stream.read(SUPERBLOCK)
    if not superblock_valid(head):
        raise OSError("the superblock is damaged")
    short = path.stat().st_size < superblock_end(head)
    source = stack.enter_context(AsClosed(path)) if short or is_unclosed(head) else path
    # HDF5's chunk cache is off, because no chunk would be reused; HDF5's lock would fail on a share without locks
    file = stack.enter_context(h5py.File(source, "r", libver="latest", rdcc_nbytes=0, locking=False))
    if not is_raw_log(file):
        raise InputError("log.foreign", file=path)
    check_structure(file)
    return file


def _text(data: NDArray[np.uint8]) -> str:
    return bytes(data).decode("utf-8", errors="replace")


def _json_lines(file: h5py.File, name: str) -> list[dict[str, Any]]:
    """Return all lines that can be parsed; incomplete lines after a crash and damaged lines are skipped."""
    try:
        text = _text(file[name][:])
    except _HDF5_ERRORS:
        return []
    lines = []
    for line in text.split("\n")[:-1]:
        try:
            content = parse_json(line)
        except ValueError:
            continue
        if isinstance(content, dict):
            lines.append(content)
    return lines
