"""Writes the raw log: HDF5 in SWMR mode, appended and flushed so that a kill or a power cut costs next to nothing.

One compound dataset holds the samples, so their columns cannot differ in length after a crash;
configuration, events, results and the closing word are JSON lines in byte datasets. Everything is created
before SWMR mode is switched on, because nothing can be created afterwards. Samples are not compressed:
rewriting a partly filled compressed chunk at every flush would leak file space, and a torn one would lose all
its rows.
"""

import errno
import json
import os
import re
import shutil
import time
import zlib
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import DTypeLike

from calstation.errors import ConfigurationError
from calstation.estimation.common.samples import SampleBlock
from calstation.records.facts import FactsBuilder, LogFacts
from calstation.records.locked import take
from calstation.records.meta import LogMeta
from calstation.records.row_check import CHECK, row_checks
from calstation.records.superblock import SUPERBLOCK, superblock_end

FORMAT = "calstation.log/1"
SUFFIX = ".h5"
#: Host seconds between flushes to the operating system: a kill loses less than this and one tick.
FLUSH_INTERVAL = 0.1
#: Whoever looks whether a log is being written holds its lock for a moment, s.
_LOCKED_WITHIN = 1.0
#: Host seconds between fsyncs: a power cut loses less than this, a tick and the fsync itself.
#:
#: They have a thread of their own: a disk may take seconds, and a table's watchdog is to be fed all the while.
SYNC_INTERVAL = 0.8
#: Columns of every log; those of further IMUs and of a gimbal come after them, and each row's check last.
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
CHUNK_ROWS = 1024
#: Bytes that must be left on the disk: a run ends while there is still room for its log's and its result's end.
RESERVE = 32_000_000
_TEXTS = ("events", "results", "closing")


def row_dtype(further_imus: int, joints: bool) -> np.dtype:
    """A row of a log with so many further IMUs, with the joints of a gimbal or without."""
    further = [("others", "<f8", (further_imus, 6))] if further_imus else []
    gimbal = [("joints", "<f8", (3,))] if joints else []
    return np.dtype([*ROW.descr, *further, *gimbal, (CHECK, "<u4")])


_abandoned: list["RawLogWriter"] = []


def free_space(path: Path) -> int:
    """Bytes left on the disk of a file."""
    return shutil.disk_usage(path.parent).free


class RawLogWriter:
    """Appends a run's samples, events and results to a new file.

    Its lock on the file says that the run is going (`raw_read.being_written`): a clock may be set, a run may wait.
    Buffers between flushes; `service` (called by every append) flushes and syncs when due. A gimbal's joints are
    kept where `joints` says that blocks have them, further IMUs where the configuration names them.

    Raises
    ------
    ConfigurationError
        where the file cannot be created.
    """

    def __init__(self, path: Path, meta: LogMeta, joints: bool = False) -> None:
        self.path = path
        self.meta = meta
        try:
            # The library's own lock is another's: it is given up when SWMR mode is switched on.
            self._file = h5py.File(path, "x", libver="latest", locking=False)
            self._sync_handle = os.open(path, os.O_RDWR | getattr(os, "O_BINARY", 0))
            if not take(self._sync_handle, _LOCKED_WITHIN, shared=True):
                raise OSError(errno.EBUSY, "another program has locked it")
        except OSError as exc:
            reason = "it exists already" if exc.errno == errno.EEXIST else exc.strerror or str(exc)
            raise ConfigurationError(
                f"{path}: the log cannot be created ({reason}); choose another folder with --out"
            ) from exc
        configuration = np.frombuffer(meta.to_json().encode(), np.uint8)
        self._file.attrs["format"] = FORMAT
        self._file.attrs["meta_crc32"] = zlib.crc32(configuration.tobytes())
        self._file.create_dataset("meta", data=configuration)
        self._row = row_dtype(len(meta.secondaries), joints)
        self._samples = self._growing("samples", self._row, CHUNK_ROWS)
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
        self._refused = self._warned = False
        self._trouble: ConfigurationError | None = None
        self._disk = ThreadPoolExecutor(1, "log-disk")
        self._syncing = self._disk.submit(lambda: None)
        self.sync()

    def append(self, block: SampleBlock) -> None:
        """Keep a block; the end of a stage is flushed at once."""
        if len(block) == 0 or self._refused:
            return
        if block.stage != self._stage:
            self.flush()
            self._stage = block.stage
        rows = np.empty(len(block), self._row)
        rows["seq"], rows["time"], rows["counts"] = block.seq, block.time, block.counts
        rows["angles"], rows["temperature"] = block.angles, block.temperature
        rows["step"], rows["valid"] = block.step, block.valid
        rows["stage"] = self._stage_index(block.stage)
        for name, values in (("others", block.others), ("joints", block.joints)):
            if name in (self._row.names or ()):
                rows[name] = values if values.shape[1] else np.nan
        rows[CHECK] = row_checks(rows)
        self._facts.add(block)
        self._rows.append(rows)
        self.service()

    def event(self, event: Mapping[str, Any]) -> None:
        """Keep an event, a JSON-ready mapping."""
        if self._refused:
            return
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
        """Flush and sync where due; to be called at every tick, data or not. Raises ConfigurationError, once."""
        now = time.monotonic()
        if now - self._flushed >= FLUSH_INTERVAL:
            self.flush()
        self._tell_trouble()
        if now - self._synced >= SYNC_INTERVAL and self._syncing.done():
            self.begin_sync()

    def flush(self) -> None:
        """Hand everything to the operating system: safe from the death of this process."""
        if self._refused:
            return
        with self._told():
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

    def sync(self) -> None:
        """`flush`, and wait until it is on disk: safe from a power cut as well."""
        self.begin_sync().result()
        self._tell_trouble()

    def begin_sync(self) -> Future[None]:
        """`flush`, and begin to bring it to the disk; once that is done, `service` raises what the disk refused."""
        self.flush()
        if not self._refused:
            self._syncing = self._disk.submit(self._arrive)
            self._synced = time.monotonic()
        return self._syncing

    def _arrive(self) -> None:
        try:
            with self._told():
                self._reach_disk()
        except ConfigurationError as trouble:
            self._trouble = trouble

    def _tell_trouble(self) -> None:
        trouble, self._trouble = self._trouble, None
        if trouble is not None:
            raise trouble

    def _reach_disk(self) -> None:
        if not self._warned and free_space(self.path) < RESERVE:
            self._warned = True
            raise ConfigurationError(
                f"{self.path}: its disk is nearly full, less than {RESERVE // 1_000_000} MB are left; make room"
                " on it, then resume the run"
            )
        os.fsync(self._sync_handle)
        if not os.path.samestat(self.path.stat(), os.fstat(self._sync_handle)):
            raise OSError("another file has taken its place")

    def close(self, outcome: str) -> LogFacts:
        """Write the closing word and close; later calls do nothing further."""
        facts = self.facts()
        if not self._file:
            return facts
        if self._refused:
            # Closing what could not be written may take the process along: the library is left alone with it.
            if self not in _abandoned:
                _abandoned.append(self)
                self._disk.submit(os.close, self._sync_handle)  # behind what may still be on its way
                self._disk.shutdown(wait=self._syncing.done())
            return facts
        self._write_line("closing", {"outcome": outcome, "sha256": facts.sha256})
        self.sync()
        self._file.close()
        os.fsync(self._sync_handle)
        os.close(self._sync_handle)
        self._disk.shutdown()
        return facts

    @contextmanager
    def _told(self) -> Iterator[None]:
        """What the disk refuses is told once, as ConfigurationError; what is in the log stays, and nothing is added."""
        try:
            yield
        except (OSError, RuntimeError) as exc:  # h5py knows both
            self._refused = True
            with suppress(OSError):
                self._fill_up()
            reason = os.strerror(exc.errno) if isinstance(exc, OSError) and exc.errno else str(exc)
            found = re.search(r"error message = '([^']*)'", reason)
            raise ConfigurationError(
                f"{self.path}: the log cannot be written any more ({found[1] if found else reason}); make room on"
                " its disk, or bring its folder back, then resume the run"
            ) from exc

    def _fill_up(self) -> None:
        """Make the file as long as it says of itself, by a hole: readers refuse one that was cut short."""
        os.lseek(self._sync_handle, 0, os.SEEK_SET)
        told = superblock_end(os.read(self._sync_handle, SUPERBLOCK))
        if os.fstat(self._sync_handle).st_size < told:
            os.ftruncate(self._sync_handle, told)

    def _growing(self, name: str, dtype: DTypeLike, chunk: int) -> h5py.Dataset:
        return self._file.create_dataset(name, (0,), dtype, maxshape=(None,), chunks=(chunk,))

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
