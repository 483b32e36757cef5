"""The thread that feeds a log and the thread that writes it to disk, on a disk that is slow or fails at any moment."""

import errno
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calstation.errors import ConfigurationError, InputError
from calstation.records import LogMeta, RawLogWriter, open_log
from calstation.records.raw import raw_log
from tests.interleaving.scheduler import Scheduler, failing_seed, run_seeds, with_seeds
from tests.records.records_samples import META, make_block

ROWS = 5


class Disk:
    """`os.fsync` on a disk that takes up to 3 s, and from a certain call on fails."""

    def __init__(self, scheduler: Scheduler) -> None:
        self._random, self._calls = scheduler.random, 0
        self._fails_at = self._random.randrange(2, 12) if self._random.random() < 0.6 else None
        self.writer: RawLogWriter | None = None
        self.failed = False

    def fsync(self, handle: int) -> None:
        self._calls += 1
        time.sleep(self._random.choice((0.0, 0.01, 3.0)))
        is_needed = self.writer is not None and not self.writer._closed  # the last one only hastens what is written
        if is_needed and self._fails_at is not None and self._calls >= self._fails_at:
            self.failed = True
            raise OSError(errno.EIO, os.strerror(errno.EIO))


def write_log(seed: int, folder: Path) -> None:
    """Write a log, and check that it has every sample once and in order, and that a failed disk is reported once."""
    scheduler = Scheduler(seed, (raw_log,))
    random, disk, path = scheduler.random, Disk(scheduler), folder / f"{seed}.h5"
    errors: list[str] = []
    appended = before_close = events = 0

    def append(writer: RawLogWriter) -> None:
        nonlocal appended
        appended += 1
        writer.append(make_block("rate", ROWS * (appended - 1), ROWS))

    def add_event(writer: RawLogWriter) -> None:
        nonlocal events
        events += 1
        writer.event({"number": events})

    actions: list[Callable[[RawLogWriter], Any]] = [
        append,
        append,
        append,
        add_event,
        lambda writer: writer.service(),
        lambda writer: writer.begin_sync(),
        lambda writer: writer.sync(),
    ]

    def attempt(action: Callable[[RawLogWriter], Any], writer: RawLogWriter) -> None:
        try:
            action(writer)
        except ConfigurationError as error:
            errors.append(error.code)

    def main() -> None:
        nonlocal before_close
        writer = disk.writer = RawLogWriter(path, LogMeta.model_validate(META))
        attempt(append, writer)
        for _ in range(random.randrange(2, 25)):
            attempt(random.choice(actions), writer)
            time.sleep(random.choice((0.0, 0.05, 1.0)))
        attempt(lambda writer: writer.close("passed"), writer)
        before_close = appended
        attempt(append, writer)

    extend = raw_log._extend

    def extend_slowly(*arguments: Any) -> None:
        time.sleep(0.01)  # another thread may run
        extend(*arguments)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", disk.fsync)
        patch.setattr(raw_log, "_extend", extend_slowly)
        scheduler.run(main)
    assert errors == ["log.not_written"] * disk.failed, errors
    try:
        log = open_log(path)
        blocks = list(log.blocks())
    except InputError:
        assert disk.failed
        return
    finally:
        path.unlink()
    seq = np.concatenate([block.seq for block in blocks]) if blocks else np.empty(0)
    assert np.array_equal(seq, np.arange(len(seq)))
    assert len(seq) <= ROWS * before_close
    if not disk.failed:
        assert (len(seq), log.outcome) == (ROWS * before_close, "passed")
        assert log.events == [{"number": number + 1} for number in range(events)]


@with_seeds(25)
def test_log_has_every_sample_and_a_failed_disk_is_reported_once(seeds: range, tmp_path: Path) -> None:
    run_seeds(seeds, lambda seed: write_log(seed, tmp_path))


def _close_silently(writer: RawLogWriter, close: Callable[[RawLogWriter, str], Any]) -> None:
    """Close a log as if every failure had been reported."""
    writer._reported = writer._reported or writer._failed
    close(writer, "passed")


#: Faults in the writer, each of which some seed finds.
PLANTED = {
    "the failure is not reported": ("_raise_failure", lambda original: lambda self: None),
    "the disk's thread writes rows": (
        "_write_to_disk",
        lambda original: lambda self: (original(self), self._write_pending()),
    ),
    "the failure is forgotten at the end": (
        "close",
        lambda original: lambda self, outcome: _close_silently(self, original),
    ),
}


@pytest.mark.long
@pytest.mark.parametrize("name", PLANTED)
def test_seeds_find_a_fault_of_the_writer(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    method, plant = PLANTED[name]
    monkeypatch.setattr(RawLogWriter, method, plant(getattr(RawLogWriter, method)))
    assert failing_seed(range(200), lambda seed: write_log(seed, tmp_path)) is not None
