"""The raw log: HDF5 in SWMR mode, appended and flushed so that a kill or a power cut costs next to nothing.

One compound dataset holds the samples, so their columns cannot differ in length after a crash;
configuration, events, results and the closing word are JSON lines in byte datasets. Everything is created
before SWMR mode is switched on, because nothing can be created afterwards. Samples are not compressed:
rewriting a partly filled compressed chunk at every flush would leak file space, and a torn one would lose all
its rows.
"""

import itertools
import json
import os
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import DTypeLike

from calstation.errors import ConfigurationError, InputError
from calstation.estimation.samples import SampleBlock
from calstation.records.facts import FactsBuilder, LogFacts
from calstation.records.meta import LogMeta, meta_from_json

FORMAT = "calstation.log/1"
SUFFIX = ".h5"
FLUSH_INTERVAL = 0.1
"""Host seconds between flushes to the operating system: a kill loses less than this and one tick."""
SYNC_INTERVAL = 0.8
"""Host seconds between fsyncs: a power cut loses less than this, a tick and the fsync itself."""
ROW = np.dtype(
    [
        ("seq", "<i8"),
        ("time", "<f8"),
        ("counts", "<f8", (6,)),
        ("angles", "<f8", (2,)),
        ("temperature", "<f8"),
        ("step", "<i4"),
        ("stage", "<u2"),
        ("valid", "u1"),
    ]
)
_CHUNK_ROWS = 1024
_READ_ROWS = 16 * _CHUNK_ROWS
_SIGNATURE = b"\x89HDF\r\n\x1a\n\x03"
"""First bytes of an HDF5 file with a superblock of version 3."""
_TEXTS = ("events", "results", "closing")


class RawLogWriter:
    """Appends a run's samples, events and results to a new file.

    Buffers between flushes; `service` (called by every append) flushes and syncs when due.

    Raises
    ------
    ConfigurationError
        where the file cannot be created.
    """

    def __init__(self, path: Path, meta: LogMeta) -> None:
        self.path = path
        self.meta = meta
        try:
            self._file = h5py.File(path, "x", libver="latest")
            self._sync_handle = os.open(path, os.O_RDWR | getattr(os, "O_BINARY", 0))
        except OSError as exc:
            reason = "it exists already" if path.exists() else exc.strerror or str(exc)
            raise ConfigurationError(
                f"{path}: the log cannot be created ({reason}); choose another folder with --out"
            ) from exc
        configuration = np.frombuffer(meta.to_json().encode(), np.uint8)
        self._file.attrs["format"] = FORMAT
        self._file.create_dataset("meta", data=configuration)
        self._samples = self._growing("samples", ROW, _CHUNK_ROWS)
        self._stage_names = self._growing("stages", "S64", 16)
        for name in _TEXTS:
            self._growing(name, np.uint8, 8192)
        self._file.swmr_mode = True
        self._facts = FactsBuilder(meta)
        self._stages: dict[str, int] = {}
        self._stage = ""
        self._rows: list[np.ndarray] = []
        self._lines: dict[str, list[str]] = {name: [] for name in _TEXTS}
        self._flushed = self._synced = time.monotonic()
        self._sync()

    def append(self, block: SampleBlock) -> None:
        """Keep a block; the end of a stage is flushed at once."""
        if len(block) == 0:
            return
        if block.stage != self._stage:
            self.flush()
            self._stage = block.stage
        rows = np.empty(len(block), ROW)
        rows["seq"], rows["time"], rows["counts"] = block.seq, block.time, block.counts
        rows["angles"], rows["temperature"] = block.angles, block.temperature
        rows["step"], rows["valid"] = block.step, block.valid
        rows["stage"] = self._stage_index(block.stage)
        self._facts.add(block)
        self._rows.append(rows)
        self.service()

    def event(self, event: Mapping[str, Any]) -> None:
        """Keep an event, a JSON-ready mapping."""
        self._write_line("events", event)
        self.service()

    def add_result(self, result: Mapping[str, Any]) -> None:
        """Keep a result JSON beside the samples; it does not count in the sha256."""
        self._write_line("results", result)
        self.flush()

    def facts(self) -> LogFacts:
        """Range, gaps, temperature and sha256 of everything appended so far."""
        return self._facts.facts()

    def service(self) -> None:
        """Flush and sync where due; to be called at every tick, data or not."""
        now = time.monotonic()
        if now - self._flushed >= FLUSH_INTERVAL:
            self.flush()
        if now - self._synced >= SYNC_INTERVAL:
            self._sync()

    def flush(self) -> None:
        """Hand everything to the operating system: safe from the death of this process."""
        if self._rows:
            rows = np.concatenate(self._rows)
            self._rows.clear()
            end = self._samples.shape[0]
            self._samples.resize((end + len(rows),))
            self._samples[end:] = rows
        for name, lines in self._lines.items():
            if lines:
                _extend(self._file[name], "".join(lines))
                lines.clear()
        self._file.flush()
        self._flushed = time.monotonic()

    def close(self, outcome: str) -> LogFacts:
        """Write the closing word and close; later calls do nothing further."""
        facts = self.facts()
        if not self._file:
            return facts
        self._write_line("closing", {"outcome": outcome, "sha256": facts.sha256})
        self._sync()
        self._file.close()
        os.fsync(self._sync_handle)
        os.close(self._sync_handle)
        return facts

    def _growing(self, name: str, dtype: DTypeLike, chunk: int) -> h5py.Dataset:
        return self._file.create_dataset(name, (0,), dtype, maxshape=(None,), chunks=(chunk,))

    def _sync(self) -> None:
        self.flush()
        os.fsync(self._sync_handle)
        self._synced = time.monotonic()

    def _write_line(self, name: str, content: Mapping[str, Any]) -> None:
        self._lines[name].append(json.dumps(content, default=_plain, ensure_ascii=False) + "\n")

    def _stage_index(self, name: str) -> int:
        if name not in self._stages:
            self._stages[name] = len(self._stages)
            self._stage_names.resize((len(self._stages),))
            self._stage_names[-1] = name.encode()
        return self._stages[name]


def _extend(dataset: h5py.Dataset, text: str) -> None:
    data = np.frombuffer(text.encode(), np.uint8)
    end = dataset.shape[0]
    dataset.resize((end + len(data),))
    dataset[end:] = data


def _plain(value: Any) -> Any:
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    return str(value)


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


def _blocks(rows: np.ndarray, names: list[str]) -> Iterator[SampleBlock]:
    stage = rows["stage"]
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
        )


def find_incomplete(folder: Path) -> list[Path]:
    """Raw logs in `folder` (searched with its subfolders) whose run did not reach its end, oldest first."""
    found = []
    for path in sorted(folder.rglob(f"*{SUFFIX}"), key=lambda p: p.stat().st_mtime):
        try:
            if read_contents(path).outcome is None:
                found.append(path)
        except InputError:
            continue
    return found


class _Opened:
    """An HDF5 file open for reading; every failure inside becomes one InputError."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> h5py.File:
        if not self._path.is_file():
            raise InputError(f"{self._path}: no such file; give the path of an existing log")
        try:
            self._file = h5py.File(self._path, "r", libver="latest", swmr=self._left_open())
        except OSError as exc:
            raise self._damaged() from exc
        if self._file.attrs.get("format") != FORMAT:
            self._file.close()
            raise InputError(f"{self._path}: not a raw log of this program; give a .h5 log or a .csv")
        return self._file

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: object) -> None:
        try:
            self._file.close()
        except (OSError, RuntimeError) as exc:
            raise self._damaged() from exc
        if isinstance(error, (OSError, RuntimeError, KeyError)):
            raise self._damaged() from error

    def _left_open(self) -> bool:
        """Whether the file was not closed, from its superblock (HDF5 file format 4.0, II.A, version 3).

        Only then SWMR reading is needed; it retries damaged metadata for ever, so a file shorter than its
        superblock says is refused before.
        """
        with self._path.open("rb") as stream:
            head = stream.read(48)
        if len(head) < 48 or head[:9] != _SIGNATURE:
            raise self._damaged()
        end = int.from_bytes(head[28:36], "little")
        if self._path.stat().st_size < end:
            raise self._damaged()
        return head[11] != 0

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
