"""Reads raw logs, those of a run that was killed as well, and finds the runs that did not reach their end."""

import itertools
import json
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from calstation.errors import InputError
from calstation.estimation.samples import SampleBlock
from calstation.records.locked import held
from calstation.records.meta import LogMeta, meta_from_json
from calstation.records.raw_log import CHUNK_ROWS, FORMAT
from calstation.records.superblock import SUPERBLOCK, AsClosed, left_open, sound, superblock_end

_READ_ROWS = 16 * CHUNK_ROWS
_BROKEN = (OSError, RuntimeError, KeyError)
"""What h5py raises of a file that is damaged."""

_ATTEMPTS, _AGAIN_AFTER = 4, 0.05
"""How often a file that a run may be writing is opened, and what is waited in between, s."""


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
        meta = meta_from_json(_text(file["meta"]), path)
        closing = _json_lines(file["closing"])
        last = closing[-1] if closing else {}
        return RawLogContents(
            meta,
            _json_lines(file["events"]),
            _json_lines(file["results"]),
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


def raw_blocks(path: Path) -> Iterator[SampleBlock]:
    """Read a raw log's samples in order in blocks of one stage.

    After a crash the rows behind the first that does not rise (never written out) are left off; in a closed
    log such a row is an error (InputError).
    """
    with _Opened(path) as file:
        samples = file["samples"]
        names = [name.decode() for name in file["stages"][:]]
        closed = file["closing"].shape[0] > 0
        last = np.int64(-1)
        for start in range(0, samples.shape[0], _READ_ROWS):
            rows = samples[start : start + _READ_ROWS]
            rising = np.diff(rows["seq"], prepend=last) > 0
            sound = rising & (rows["stage"] < len(names))
            good = len(rows) if sound.all() else int(np.argmin(sound))
            if good < len(rows) and closed:
                raise InputError(f"{path}: row {start + good} is damaged; use a copy of the log")
            rows = rows[:good]
            if good:
                last = rows["seq"][-1]
                yield from _blocks(rows, names)
            if good < len(sound):
                return


def row_count(path: Path) -> int:
    """Rows in a raw log, those that a crash spoilt included."""
    with _Opened(path) as file:
        return int(file["samples"].shape[0])


def raw_rows(path: Path, start: int, stop: int) -> np.ndarray:
    """Rows `start` to `stop` of a raw log as they are stored, structured as `raw_log.row_dtype`."""
    with _Opened(path) as file:
        rows: np.ndarray = file["samples"][start:stop]
        return rows


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
        """The file, a raw log; one that was not closed is read as if it had been. Raises InputError or `_BROKEN`."""
        with self._path.open("rb") as stream:
            head = stream.read(SUPERBLOCK)
        if not sound(head) or self._path.stat().st_size < superblock_end(head):
            raise OSError("no whole superblock, or a file shorter than it tells")
        self._unclosed = AsClosed(self._path) if left_open(head) else None
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


def _text(dataset: h5py.Dataset) -> str:
    return bytes(dataset[:]).decode("utf-8", errors="replace")


def _json_lines(dataset: h5py.Dataset) -> list[dict[str, Any]]:
    """Whole lines that parse; what a crash left half written is skipped."""
    lines = []
    for line in _text(dataset).split("\n")[:-1]:
        try:
            lines.append(json.loads(line))
        except ValueError:
            continue
    return lines
