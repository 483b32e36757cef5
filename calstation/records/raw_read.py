"""Reads raw logs, those of a run that was killed as well, and finds the runs that did not reach their end."""

import itertools
import json
import time
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from calstation.errors import InputError
from calstation.estimation.common.samples import SampleBlock
from calstation.records.damaged_rows import DamagedRows, without
from calstation.records.locked import held
from calstation.records.meta import LogMeta, meta_from_json
from calstation.records.raw_log import CHUNK_ROWS, FORMAT
from calstation.records.row_check import CHECK, row_checks
from calstation.records.superblock import SUPERBLOCK, AsClosed, left_open, sound, superblock_end

_READ_ROWS = 16 * CHUNK_ROWS
#: What h5py raises of a file that is damaged.
_BROKEN = (OSError, RuntimeError, KeyError)

_NONE = np.empty((0, 2), np.int64)

#: How often a file that a run may be writing is opened, and what is waited in between, s.
_ATTEMPTS, _AGAIN_AFTER = 4, 0.05


@dataclass(frozen=True)
class RawLogContents:
    """What a raw log holds beside its samples; `outcome` is None where the run did not reach its end."""

    meta: LogMeta
    events: list[dict[str, Any]]
    results: list[dict[str, Any]]
    outcome: str | None
    sha256: str | None


def read_contents(path: Path) -> RawLogContents:
    """Read configuration, events and results; raises InputError where the file is no readable raw log."""
    with _Opened(path) as file:
        stored = file["meta"][:]
        if zlib.crc32(stored) != file.attrs.get("meta_crc32", zlib.crc32(stored)):
            raise InputError(f"{path}: its configuration is damaged (crc32); use a copy of the log")
        meta = meta_from_json(_text(stored), path)
        closing = _json_lines(file, "closing")
        last = closing[-1] if closing else {}
        return RawLogContents(
            meta,
            _json_lines(file, "events"),
            _json_lines(file, "results"),
            last.get("outcome"),
            last.get("sha256"),
        )


def being_written(path: Path) -> bool:
    """Whether the run of a log is still going: its writer holds the log's lock until it closes it, or dies.

    Raises InputError where the file cannot be read.
    """
    try:
        return held(path)
    except OSError as exc:
        raise InputError(f"{path}: cannot be read ({exc.strerror or exc})") from exc


def solved_stages(events: Iterable[Mapping[str, Any]]) -> tuple[str, ...]:
    """The stages that a log's events say were solved, in order."""
    return tuple(event["stage"] for event in events if event.get("event") == "StageSolved")


def raw_blocks(path: Path, holes: list[DamagedRows] | None = None) -> Iterator[SampleBlock]:
    """Read a raw log's samples in order in blocks of one stage.

    Rows that do not read as they were written are left out, and put into `holes`; those at the end of a log that
    was not closed were never written out, and are no hole. Of a log whose rows have no checks (InputError) any such
    row spoils the rest.
    """
    with _Opened(path) as file:
        samples = file["samples"]
        checked = CHECK in (samples.dtype.names or ())
        names = [name.decode(errors="replace") for name in file["stages"][:]]
        closed = file["closing"].shape[0] > 0
        end = _row_count(path, samples)
        last, good_end = -1, 0
        for start in range(0, end, _READ_ROWS):
            rows, sound = _rows_and_sound(samples, start, min(start + _READ_ROWS, end), checked)
            sound &= rows["stage"] < len(names)
            sound &= _rising(rows["seq"], sound, last)
            if not checked and not sound.all():
                good = int(np.argmin(sound))
                if closed:
                    raise InputError(f"{path}: row {start + good} is damaged; use a copy of the log")
                yield from _blocks(rows[:good], names)
                return
            for a, b in _stretches(sound):
                if holes is not None and start + a > good_end:
                    after = None if last < 0 else last
                    holes.append(DamagedRows(good_end, start + a - good_end, after, int(rows["seq"][a])))
                last, good_end = int(rows["seq"][b - 1]), start + b
                yield from _blocks(rows[a:b], names)
        lost = int(samples.shape[0]) - good_end
        if holes is not None and closed and lost > 0:
            holes.append(DamagedRows(good_end, lost, None if last < 0 else last, None))


def row_count(path: Path) -> int:
    """Rows in a raw log, those that a crash spoilt included."""
    with _Opened(path) as file:
        return _row_count(path, file["samples"])


def raw_rows(path: Path, start: int, stop: int, holes: NDArray[np.int64] = _NONE) -> np.ndarray:
    """Good rows `start` to `stop` of a raw log as they are stored, structured as `raw_log.row_dtype`.

    holes : first row and number of rows of each, shape (n, 2)
    """
    with _Opened(path) as file:
        samples = file["samples"]
        end = int(samples.shape[0]) - int(holes[:, 1].sum())
        parts = [samples[a:b] for a, b in without(holes, start, min(stop, end))]
        return np.concatenate([samples[:0], *parts])


def _row_count(path: Path, samples: h5py.Dataset) -> int:
    """Rows told, but no more than the file has room for: nobody reads for ever what is not there."""
    return min(int(samples.shape[0]), path.stat().st_size // int(samples.dtype.itemsize))


def _rows_and_sound(
    samples: h5py.Dataset, start: int, stop: int, checked: bool
) -> tuple[np.ndarray, NDArray[np.bool_]]:
    """Rows `start` to `stop`, and which of them their check proves; of a chunk that cannot be read none."""
    try:
        rows = samples[start:stop]
    except _BROKEN:
        if not checked or stop - start <= CHUNK_ROWS:
            if not checked:
                raise
            return np.zeros(stop - start, samples.dtype), np.zeros(stop - start, np.bool_)
        cuts = [*range(start, stop, CHUNK_ROWS), stop]
        parts = [_rows_and_sound(samples, a, b, checked) for a, b in itertools.pairwise(cuts)]
        return np.concatenate([rows for rows, _ in parts]), np.concatenate([sound for _, sound in parts])
    return rows, row_checks(rows) == rows[CHECK] if checked else np.ones(len(rows), np.bool_)


def _rising(seq: NDArray[np.int64], sound: NDArray[np.bool_], last: int) -> NDArray[np.bool_]:
    """Which of the sound rows' sequence numbers rise over all sound ones before them."""
    kept = np.where(sound, seq, -1)
    return kept > np.maximum.accumulate(np.concatenate([[last], kept[:-1]]))


def _stretches(sound: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], sound, [False]]).astype(np.int8)))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def _blocks(rows: np.ndarray, names: list[str]) -> Iterator[SampleBlock]:
    stage, columns = rows["stage"], rows.dtype.names or ()
    edges = np.concatenate(([0], np.flatnonzero(stage[1:] != stage[:-1]) + 1, [len(rows)]))
    for a, b in itertools.pairwise(edges.tolist()):
        part = rows[a:b]
        yield SampleBlock(
            names[int(part["stage"][0])],
            np.ascontiguousarray(part["seq"]),
            np.ascontiguousarray(part["time"]),
            np.ascontiguousarray(part["counts"]),
            np.ascontiguousarray(part["angles"]),
            part["step"].astype(np.int64),
            part["valid"] != 0,
            np.ascontiguousarray(part["temperature"]),
            **{name: np.ascontiguousarray(part[name]) for name in ("others", "joints") if name in columns},
        )


class _Opened:
    """An HDF5 file open for reading; every failure inside becomes one InputError."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._unclosed: AsClosed | None = None

    def __enter__(self) -> h5py.File:
        if not self._path.is_file():
            raise InputError(f"{self._path}: no such file; give the path of an existing log")
        for _ in range(_ATTEMPTS):
            try:
                self._file = self._open()
                return self._file
            except InputError:
                self._close()
                raise
            except _BROKEN as exc:
                error = exc
                self._close()
            if not being_written(self._path):
                break
            time.sleep(_AGAIN_AFTER)
        raise self._damaged() from error

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: object) -> None:
        try:
            self._file.close()
        except (OSError, RuntimeError) as exc:
            raise self._damaged() from exc
        finally:
            self._close()
        if isinstance(error, _BROKEN):
            raise self._damaged() from error

    def _open(self) -> h5py.File:
        """The file, a raw log; one not closed, or cut short, is read as it is. Raises InputError or `_BROKEN`."""
        with self._path.open("rb") as stream:
            head = stream.read(SUPERBLOCK)
        if not sound(head):
            raise OSError("no whole superblock")
        short = self._path.stat().st_size < superblock_end(head)
        self._unclosed = AsClosed(self._path) if short or left_open(head) else None
        file = h5py.File(self._unclosed or self._path, "r", libver="latest")
        try:
            if file.attrs.get("format") == FORMAT:
                return file
        except BaseException:
            file.close()
            raise
        file.close()
        raise InputError(f"{self._path}: not a raw log of this program; give a .h5 log or a .csv")

    def _close(self) -> None:
        if self._unclosed is not None:
            self._unclosed.close()
            self._unclosed = None

    def _damaged(self) -> InputError:
        return InputError(f"{self._path}: damaged, cut short or no raw log; use a copy of the log")


def _text(data: NDArray[np.uint8]) -> str:
    return bytes(data).decode("utf-8", errors="replace")


def _json_lines(file: h5py.File, name: str) -> list[dict[str, Any]]:
    """Whole lines that parse; what a crash left half written, or cannot be read, is skipped."""
    try:
        text = _text(file[name][:])
    except _BROKEN:
        return []
    lines = []
    for line in text.split("\n")[:-1]:
        try:
            content = json.loads(line)
        except (ValueError, RecursionError):
            continue
        if isinstance(content, dict):
            lines.append(content)
    return lines
