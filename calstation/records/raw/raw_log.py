"""Writer of the raw log, an HDF5 file in SWMR mode; a killed process or a power failure loses at most 2 s of data.

The samples are in one compound dataset, so that their columns have equal lengths after a crash. Configuration, events,
results and the closing record are JSON lines in byte datasets. All datasets are created before SWMR mode is switched
on, because HDF5 cannot create datasets afterwards. Samples are not compressed, because rewriting a partly filled
compressed chunk at every flush would waste file space, and an incompletely written chunk would lose all its rows. Every
row has a checksum, so that individual damaged rows can be identified.

References
----------
M. Dietzfelbinger, *Universal hashing and k-wise independent random variables via integer arithmetic without primes*,
STACS 1996: multiply, add, and use the upper half. The multipliers are from splitmix64 by S. Vigna.
"""

import itertools
import json
import os
import re
import time
import zlib
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import DTypeLike, NDArray

from calstation.errors import ConfigurationError, InputError
from calstation.estimation.common import SampleBlock
from calstation.messages import Text, os_reason
from calstation.records.facts import FactsBuilder, LogFacts
from calstation.records.files import FILE_MODE, acquire_lock, allocate, free_space
from calstation.records.meta import LogMeta
from calstation.records.raw.superblock import SUPERBLOCK, superblock_end

FORMAT = "calstation.log/1"
SUFFIX = ".h5"
#: Host time between flushes to the operating system, s; a killed process loses less than this time plus one tick.
FLUSH_INTERVAL = 0.1
#: Host time between fsyncs, s; a power failure loses less than this time plus a tick and the duration of an fsync. The
#: fsyncs run in a separate thread, because a disk may take seconds, during which the table's watchdog must be fed.
SYNC_INTERVAL = 0.8
#: Host time to wait for the lock, s, because `being_written` acquires it briefly.
_LOCK_TIMEOUT = 1.0
#: Name of the column with the row checksums.
CHECKSUM_COLUMN = "check"
#: Columns of every log; the optional columns of `row_dtype` follow, and the checksum is last.
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
#: Free disk space, bytes, reserved for the end of the log and the result.
RESERVED_SPACE = 32_000_000
#: Datasets of JSON lines.
TEXTS = ("events", "results", "closing")
#: Initial value of a row's checksum, so that a row of zeros that was never written is invalid.
_SEED = np.uint64(0x9E3779B97F4A7C15)


def row_dtype(further_imus: int, joints: bool = False, station: bool = False, chamber: bool = False) -> np.dtype:
    """Return the dtype of a row.

    Parameters
    ----------
    further_imus : number of secondary IMUs
    joints, station, chamber : whether rows contain joint angles of a gimbal, station time, chamber temperature
    """
    others = [("others", "<f8", (further_imus, 6))] if further_imus else []
    gimbal = [("joints", "<f8", (3,))] if joints else []
    clock = [("station", "<f8", (1,))] if station else []
    air = [("chamber", "<f8", (1,))] if chamber else []
    return np.dtype([*ROW.descr, *others, *gimbal, *clock, *air, (CHECKSUM_COLUMN, "<u4")])


def row_checks(rows: np.ndarray | Mapping[str, np.ndarray]) -> NDArray[np.uint32]:
    """Compute the checksums of n rows, shape (n,), from all columns except `CHECKSUM_COLUMN`.

    `rows` is an array with the dtype `row_dtype`, or its columns in this order, which is faster.
    """
    names = rows.keys() if isinstance(rows, Mapping) else rows.dtype.names or ()
    sums = np.full(len(rows["seq"]), _SEED, np.uint64)
    number = itertools.count()
    for name in names:
        if name == CHECKSUM_COLUMN:
            continue
        values = rows[name]
        bits = values.view(np.uint64) if values.dtype.itemsize == 8 else values.astype(np.uint64)
        for column in bits.reshape(len(sums), -1).T:
            sums += column * _multiplier(next(number))
    return (sums >> np.uint64(32)).astype(np.uint32)


@cache
def _multiplier(column: int) -> np.uint64:
    """Return an odd 64-bit pseudo-random number for a column (splitmix64)."""
    mask = (1 << 64) - 1
    z = ((column + 1) * int(_SEED)) & mask
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & mask
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & mask
    return np.uint64((z ^ (z >> 31)) | 1)


#: Space that is always allocated at the end of an open log, bytes, so that its last records fit on a full disk.
_HEADROOM = 1_000_000
#: Largest size of HDF5's metadata for one flush, bytes, in addition to one chunk of each dataset.
_METADATA = 200_000


class RawLogWriter:
    """Appends samples, events and results of a run to a new file.

    The file is locked until the writer closes it (see `raw_read.being_written`). Data are buffered between flushes;
    `service`, which every append calls, flushes and syncs when due. Raises ConfigurationError if the file cannot be
    created; all methods that write, flush or sync raise it if a write fails, after which no samples are written.
    Space is allocated before HDF5 needs it, because HDF5 may crash the process after a failed write; if the
    disk is full, `close` writes the last samples and results into the space that is already allocated.

    Parameters
    ----------
    path : file to create
    meta : configuration of the log
    columns : whether the blocks may contain the optional columns of `row_dtype`, by name
    """

    def __init__(self, path: Path, meta: LogMeta, **columns: bool) -> None:
        self.path = path
        self.meta = meta
        self.free_space = free_space
        self._allocated = 0
        self._closed = False
        self._disconnected = False  #: Whether a write has failed and HDF5 was redirected to `os.devnull`.
        content = meta.to_json().encode()
        try:
            flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
            self._sync_handle = os.open(path, flags, FILE_MODE)
        except OSError as exc:
            raise ConfigurationError("log.not_created", file=path, reason=_os_reason(exc)) from exc
        try:
            allocate(self._sync_handle, len(content) + _METADATA + _HEADROOM)
            # HDF5 would release its own lock when SWMR mode is switched on.
            self._file = h5py.File(path, "w", libver="latest", locking=False)
            self._hdf5_handle: int = self._file.id.get_vfd_handle()
            self._reserve(len(content) + _METADATA)
            locked = acquire_lock(self._sync_handle, _LOCK_TIMEOUT, shared=True)
            self._create(content, **columns)
        except (OSError, RuntimeError) as exc:  # h5py raises both
            self._remove()
            raise ConfigurationError("log.not_created", file=path, reason=_os_reason(exc)) from exc
        if not locked:
            self._remove()
            raise ConfigurationError("log.not_created", file=path, reason=Text("log.locked"))
        self._facts = FactsBuilder(meta)
        self._stages: dict[str, int] = {}
        self._stage = ""
        self._rows: list[np.ndarray] = []
        self.stage_ends: list[Mapping[str, Any]] = []  #: Events of the ends of stages.
        self._lines: dict[str, list[str]] = {name: [] for name in TEXTS}
        self._flushed_at = self._synced_at = time.monotonic()
        self._failed = self._warned = False
        self._reported = False  #: Whether the caller knows of the failure.
        self._failure: ConfigurationError | None = None
        self._disk = ThreadPoolExecutor(1, "log-disk")
        self._syncing = self._disk.submit(lambda: None)
        try:
            self.sync()
        except ConfigurationError as exc:
            self.discard()
            raise self._not_created(exc) from exc

    def _create(self, content: bytes, **columns: bool) -> None:
        """Create all datasets, and switch SWMR mode on."""
        configuration = np.frombuffer(content, np.uint8)
        self._file.attrs["format"] = np.bytes_(FORMAT)  # fixed length: see `raw_structure`
        self._file.attrs["meta_crc32"] = zlib.crc32(configuration.tobytes())
        # All datasets are kept open, because h5py ignores a write that fails when a dataset is closed.
        self._configuration = self._file.create_dataset("meta", data=configuration)
        self._row = row_dtype(len(self.meta.secondaries), **columns)
        self._samples = self._create_growing("samples", self._row, CHUNK_ROWS)
        self._stage_names = self._create_growing("stages", "S64", 16)
        self._texts = {name: self._create_growing(name, np.uint8, 8192) for name in TEXTS}
        self._file.swmr_mode = True

    def append(self, block: SampleBlock) -> None:
        """Append a block; the end of a stage is flushed immediately."""
        if len(block) == 0 or self._failed:
            return
        if block.stage != self._stage:
            self.flush()
            self._stage = block.stage
        rows = np.empty(len(block), self._row)
        rows["seq"], rows["time"], rows["counts"] = block.seq, block.time, block.counts
        rows["angles"], rows["temperature"] = block.angles, block.temperature
        rows["step"], rows["valid"] = block.step, block.valid
        with self._writing():
            rows["stage"] = self._stage_index(block.stage)
        columns = self._row.names or ()
        missing = [name for name in ("station", "chamber") if name in columns and not getattr(block, name).shape[1]]
        unknown: dict[str, Any] = dict.fromkeys(missing, np.full((len(block), 1), np.nan))
        block = replace(block, **unknown)
        for name in {"others", "joints", "station", "chamber"}.intersection(columns):
            values = getattr(block, name)
            rows[name] = values if values.shape[1] else np.nan
        rows[CHECKSUM_COLUMN] = row_checks(rows)
        self._facts.add(block)
        self._rows.append(rows)
        self.service()

    def event(self, event: Mapping[str, Any]) -> None:
        """Append an event given as JSON data; if the disk is full, `close` writes it."""
        self._write_line("events", event)
        if event.get("event") == "StageEnded":
            self.stage_ends.append(event)
        self.service()

    def add_result(self, result: Mapping[str, Any]) -> None:
        """Append a result given as JSON data; the sha256 does not include it."""
        self._write_line("results", result)
        self.flush()

    def facts(self) -> LogFacts:
        """Return range, gaps, temperature and sha256 of everything appended so far."""
        return self._facts.facts()

    def service(self) -> None:
        """Flush and sync if due; must be called at every tick, even without data. Raises ConfigurationError once."""
        now = time.monotonic()
        if now - self._flushed_at >= FLUSH_INTERVAL:
            self.flush()
        self._raise_failure()
        if now - self._synced_at >= SYNC_INTERVAL and self._syncing.done():
            self.begin_sync()

    def flush(self) -> None:
        """Pass all data to the operating system, so that they survive the end of this process."""
        if self._failed:
            return
        with self._writing():
            self._reserve(self._pending_size(), _HEADROOM)
            self._write_pending()
        self._flushed_at = time.monotonic()

    def _pending_size(self) -> int:
        """Return the largest number of bytes by which a flush extends the file."""
        rows = sum(len(each) for each in self._rows) + CHUNK_ROWS
        texts = sum(4 * len(line) for lines in self._lines.values() for line in lines)
        return rows * self._row.itemsize + texts + _METADATA

    def _reserve(self, size: int, headroom: int = 0) -> None:
        """Allocate `size` more bytes, plus twice `headroom` if less would be left. Raises _NoSpaceError."""
        end = self._file.id.get_filesize() + size
        if end + headroom > self._allocated:
            try:
                allocate(self._sync_handle, end + 2 * headroom)
            except OSError as exc:
                raise _NoSpaceError(exc.errno, exc.strerror) from exc
            self._allocated = end + 2 * headroom

    def _write_pending(self) -> None:
        """Write all buffered data into the allocated space."""
        if self._rows:
            rows = np.concatenate(self._rows)
            self._rows.clear()
            end = self._samples.shape[0]
            self._samples.resize((end + len(rows),))
            self._samples[end:] = rows
        for name, lines in self._lines.items():
            if lines:
                _extend(self._texts[name], "".join(lines))
                lines.clear()
        self._file.flush()

    def sync(self) -> None:
        """Flush and wait until all data are on disk, so that they survive a power failure."""
        self.begin_sync().result()
        self._raise_failure()

    def begin_sync(self) -> Future[None]:
        """Flush and start to write to disk in the background; a later call of `service` raises any failure."""
        self.flush()
        if not self._failed:
            self._syncing = self._disk.submit(self._sync_in_background)
            self._synced_at = time.monotonic()
        return self._syncing

    def _sync_in_background(self) -> None:
        try:
            with self._writing(is_reported=False):
                self._write_to_disk()
        except ConfigurationError as failure:
            self._failure = failure

    def _raise_failure(self) -> None:
        failure, self._failure = self._failure, None
        if failure is not None and not self._reported:
            self._reported = self._failed
            raise failure

    def _write_to_disk(self) -> None:
        if not self._warned and self.free_space(self.path) < RESERVED_SPACE:
            self._warned = True
            raise ConfigurationError("log.disk_nearly_full", file=self.path, megabytes=RESERVED_SPACE // 1_000_000)
        os.fsync(self._sync_handle)
        if not os.path.samestat(self.path.stat(), os.fstat(self._sync_handle)):
            raise _ReplacedError

    def close(self, outcome: str) -> LogFacts:
        """Write the closing record and close the file; later calls have no effect."""
        facts = self.facts()
        if self._closed:
            return facts
        if not (self._disconnected and self._reported):
            self._syncing.result()  # may fail and disconnect the file
        self._failed, reported = False, self._reported
        try:
            if self._disconnected:
                self._raise_failure()
            else:
                self._write_line("closing", {"outcome": outcome, "sha256": facts.sha256})
                with self._writing():
                    self._reserve(self._pending_size())
                    self._write_pending()
                    os.fsync(self._sync_handle)
        except ConfigurationError:
            if not reported:
                raise
        finally:
            self._close_files()
        return facts

    def discard(self) -> None:
        """Close and remove the file."""
        with suppress(ConfigurationError):  # the disk may have failed
            self.close("incomplete")
        self.path.unlink(missing_ok=True)

    def _not_created(self, error: ConfigurationError) -> ConfigurationError:
        reason = error.values.get("reason", Text("os.disk_full"))
        return ConfigurationError("log.not_created", file=self.path, reason=reason)

    def _close_files(self) -> None:
        self._closed = self._failed = True
        try:
            self._file.close()
        except (OSError, RuntimeError):  # all data have been written before
            self._disconnect()

        def close() -> None:
            with suppress(OSError):
                if not self._disconnected:
                    os.ftruncate(self._sync_handle, self._stated_length())
                    os.fsync(self._sync_handle)
            os.close(self._sync_handle)

        closing = self._disk.submit(close)  # executed after the pending writes
        self._disk.shutdown(wait=False)
        if self._syncing.done():
            closing.result()

    def _remove(self) -> None:
        """Remove a file that could not be created."""
        if hasattr(self, "_hdf5_handle"):
            self._disconnect()
            with suppress(OSError, RuntimeError):  # `os.devnull` cannot be extended
                self._file.close()
        os.close(self._sync_handle)
        self.path.unlink(missing_ok=True)

    @contextmanager
    def _writing(self, *, is_reported: bool = True) -> Iterator[None]:
        """Convert a failed write to a ConfigurationError, after which no samples are written.

        `is_reported` is False in the background, where the caller does not receive the error.
        """
        try:
            yield
        except (OSError, RuntimeError) as exc:  # h5py raises both
            self._failed = True
            self._reported = self._reported or is_reported
            if not isinstance(exc, _NoSpaceError):
                self._disconnect()
            raise ConfigurationError("log.not_written", file=self.path, reason=_os_reason(exc)) from exc

    def _disconnect(self) -> None:
        """Redirect HDF5 to `os.devnull`, because closing its objects after a failed write may crash the process."""
        if self._disconnected:  # the descriptor may already belong to another file
            return
        self._disconnected = True
        with suppress(OSError):
            null = os.open(os.devnull, os.O_RDWR)
            os.dup2(null, self._hdf5_handle)
            os.close(null)
        with suppress(OSError):  # readers reject a file that is shorter than its superblock states
            if os.fstat(self._sync_handle).st_size < (length := self._stated_length()):
                os.ftruncate(self._sync_handle, length)

    def _stated_length(self) -> int:
        """Return the length in the superblock."""
        os.lseek(self._sync_handle, 0, os.SEEK_SET)
        return superblock_end(os.read(self._sync_handle, SUPERBLOCK))

    def _create_growing(self, name: str, dtype: DTypeLike, chunk: int) -> h5py.Dataset:
        return self._file.create_dataset(name, (0,), dtype, maxshape=(None,), chunks=(chunk,))

    def _write_line(self, name: str, content: Mapping[str, Any]) -> None:
        self._lines[name].append(json.dumps(content, default=_plain, ensure_ascii=False) + "\n")

    def _stage_index(self, name: str) -> int:
        if name not in self._stages:
            self._reserve(_METADATA)
            self._stages[name] = len(self._stages)
            self._stage_names.resize((len(self._stages),))
            self._stage_names[-1] = name.encode()
        return self._stages[name]


def _extend(dataset: h5py.Dataset, text: str) -> None:
    data = np.frombuffer(text.encode(), np.uint8)
    end = dataset.shape[0]
    dataset.resize((end + len(data),))
    dataset[end:] = data


class _ReplacedError(OSError):
    """The log has been replaced by another file."""


class _NoSpaceError(OSError):
    """No space can be allocated; nothing has been written."""


def _os_reason(error: OSError | RuntimeError) -> Text:
    """Return the reason why a file cannot be written; h5py gives the system's error number only in its message."""
    if isinstance(error, _ReplacedError):
        return Text("log.replaced")
    if isinstance(error, OSError) and error.errno:
        return os_reason(error)
    number = re.search(r"errno = (\d+)", str(error))
    return os_reason(OSError(int(number[1]), os.strerror(int(number[1]))) if number else OSError(str(error)))


def _plain(value: Any) -> Any:
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    return str(value)


def write_log(target: Path, meta: LogMeta, blocks: Iterator[SampleBlock]) -> LogFacts:
    """Write samples to a raw log; an error leaves no log.

    Raises InputError if the target does not have the name of a log, ConfigurationError if it cannot be written.
    """
    if target.suffix != SUFFIX:
        raise InputError("csv.import_name", file=target, suffix=SUFFIX)
    first = next(blocks)  # raises for a log without samples
    writer = RawLogWriter(target, meta, **{n: getattr(first, n).shape[1] > 0 for n in ("joints", "station", "chamber")})
    try:
        for block in itertools.chain([first], blocks):
            writer.append(block)
        return writer.close("imported")
    except BaseException as error:
        writer.discard()
        if isinstance(error, ConfigurationError):
            raise writer._not_created(error) from error
        raise
