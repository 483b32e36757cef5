"""The raw log keeps every value, reports damage, and survives a kill and a power cut."""

import errno
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from records_samples import assert_same, joined, make_block

from calstation.errors import ConfigurationError, InputError
from calstation.estimation.common import SampleBlock
from calstation.messages import Text
from calstation.records import LogMeta, RawLogWriter, being_written, completed_rounds, open_log, stages_ended_by_hand
from calstation.records.raw import raw_log
from calstation.records.raw.raw_log import row_checks
from calstation.records.raw.raw_read import raw_blocks
from tests.helpers import raises_code


def test_log_is_read_as_written(tmp_path: Path, meta: LogMeta, blocks: list[SampleBlock]) -> None:
    path = tmp_path / "run.h5"
    writer = RawLogWriter(path, meta)
    for block in blocks:
        writer.append(block)
        writer.event({"kind": "block", "value": np.float64(1.5)})
    writer.add_result({"schema": "x", "passed": True})
    facts = writer.close("passed")
    writer.close("again")
    log = open_log(path)
    assert log.meta == meta
    assert log.outcome == "passed"
    assert log.events == [{"kind": "block", "value": 1.5}] * len(blocks)
    assert log.results == [{"schema": "x", "passed": True}]
    assert_same(list(log.blocks()), blocks)
    assert log.facts() == facts
    assert (facts.first_seq, facts.last_seq, facts.gaps) == (0, 4384, 1)


def test_log_can_be_read_during_the_run_without_an_outcome(tmp_path: Path, meta: LogMeta) -> None:
    writer = RawLogWriter(tmp_path / "sub.h5", meta)
    writer.append(make_block("rate", 0, 50))
    writer.flush()
    log = open_log(tmp_path / "sub.h5")
    assert log.outcome is None
    assert sum(len(b) for b in log.blocks()) == 50
    writer.close("stopped")
    assert open_log(tmp_path / "sub.h5").outcome == "stopped"


def test_log_is_being_written_until_it_is_closed(tmp_path: Path, meta: LogMeta) -> None:
    path = tmp_path / "run.h5"
    writer = RawLogWriter(path, meta)
    for touched in (0.0, 4e9):
        os.utime(path, (touched, touched))
        assert being_written(path)
    read = "import h5py, sys; print(h5py.File(sys.argv[1], 'r', libver='latest', swmr=True)['samples'].shape)"
    other = subprocess.run([sys.executable, "-c", read, str(path)], capture_output=True, text=True, check=True)
    assert other.stdout == "(0,)\n", "other programs may read it all the same"
    writer.close("stopped")
    assert not being_written(path)
    assert list(raw_blocks(path)) == []
    with raises_code(InputError, "log.unreadable"):
        being_written(tmp_path / "none.h5")


def test_digest_covers_samples_and_configuration_but_not_results(
    tmp_path: Path, meta: LogMeta, blocks: list[SampleBlock]
) -> None:
    def digest(name: str, meta: LogMeta, blocks: list[SampleBlock], result: str = "") -> str:
        writer = RawLogWriter(tmp_path / name, meta)
        for block in blocks:
            writer.append(block)
        if result:
            writer.add_result({"result": result})
        return writer.close("passed").sha256

    reference = digest("a.h5", meta, blocks)
    halves = [
        type(b)(b.stage, *(getattr(b, n)[k] for n in list(b.__dataclass_fields__)[1:]))
        for b in blocks
        for k in (slice(3), slice(3, None))
    ]
    assert digest("b.h5", meta, halves, "other") == reference
    other = meta.model_copy(update={"registers": {}})
    assert digest("c.h5", other, blocks) != reference
    blocks[1].counts[17, 2] += 1
    assert digest("d.h5", meta, blocks) != reference
    blocks[1].counts[17, 2] -= 1
    blocks[-1] = type(blocks[-1])("rate", *list(vars(blocks[-1]).values())[1:])
    assert digest("e.h5", meta, blocks) != reference


def test_modified_truncated_and_foreign_files_are_reported(
    tmp_path: Path, meta: LogMeta, blocks: list[SampleBlock]
) -> None:
    path = tmp_path / "run.h5"
    writer = RawLogWriter(path, meta)
    for block in blocks:
        writer.append(block)
    writer.close("passed")
    whole = path.read_bytes()
    altered = tmp_path / "altered.h5"
    altered.write_bytes(whole)
    with h5py.File(altered, "r+", libver="latest") as file:
        row = file["samples"][100:101]
        row["counts"][0, 2] += 1.0
        row["check"] = row_checks(row)
        file["samples"][100:101] = row
    errors = [_error(altered)]
    for length in (0, 47, 100, 400):
        cut = tmp_path / "cut.h5"
        cut.write_bytes(whole[:length])
        errors.append(_error(cut))
    (tmp_path / "text.h5").write_text("seq,time_s\n")
    errors.append(_error(tmp_path / "text.h5"))
    with h5py.File(tmp_path / "foreign.h5", "w", libver="latest") as file:
        file["x"] = 1
    errors.append(_error(tmp_path / "foreign.h5"))
    assert errors[0].code == "log.altered"
    assert {error.code for error in errors[1:]} == {"log.damaged", "log.foreign"}


def _error(path: Path) -> InputError:
    with pytest.raises(InputError) as caught:
        list(open_log(path).blocks())
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)
    return caught.value


def test_a_file_that_cannot_be_created_is_reported(tmp_path: Path, meta: LogMeta) -> None:
    with raises_code(ConfigurationError, "log.not_created") as caught:
        RawLogWriter(tmp_path / "absent" / "x.h5", meta)
    assert caught.value.values["reason"] == Text("os.not_found")
    (tmp_path / "x.h5").write_text("kept")
    with raises_code(ConfigurationError, "log.not_created") as caught:
        RawLogWriter(tmp_path / "x.h5", meta)
    assert caught.value.values["reason"] == Text("os.exists")
    assert (tmp_path / "x.h5").read_text() == "kept"


_CHILD = """
import sys, time
from pathlib import Path
import numpy as np
from calstation.estimation.common.samples import SampleBlock
from calstation.records.meta import LogMeta
from calstation.records.raw.raw_log import RawLogWriter
from calstation.records.raw.raw_read import being_written, raw_blocks
from calstation.records.raw.raw_log import row_checks
writer = RawLogWriter(Path(sys.argv[1]), LogMeta.model_validate_json(sys.argv[2]))
begin, done = time.monotonic(), 0
while True:
    now = time.monotonic() - begin
    count = int(now * 1000) - done
    if count:
        seq = np.arange(done, done + count)
        stage = "rate" if now % 0.4 < 0.2 else "excitation"
        block = SampleBlock(stage, seq, (seq + 1) / 1000, np.tile(seq[:, None] * 1.0, 6),
            np.zeros((count, 2)), np.zeros(count, int), np.ones(count, bool), np.full(count, 20.0))
        writer.append(block)
        writer.event({"at": done})
        done += count
        print(done, flush=True)
    writer.service()
    time.sleep(0.01)
"""


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="needs SIGKILL")
@pytest.mark.parametrize(
    "after", [0.81, *(pytest.param(after, marks=pytest.mark.exhaustive) for after in (0.35, 1.23, 1.64))]
)
def test_killed_process_loses_less_than_half_a_second(tmp_path: Path, meta: LogMeta, after: float) -> None:
    path = tmp_path / "run.h5"
    child = subprocess.Popen(
        [sys.executable, "-c", _CHILD, str(path), meta.to_json()], stdout=subprocess.PIPE, text=True
    )
    assert child.stdout is not None
    child.stdout.readline()
    time.sleep(after)
    os.kill(child.pid, signal.SIGKILL)
    produced = int(child.stdout.read().split()[-1])
    child.wait()
    child.stdout.close()
    log = open_log(path)
    columns = joined(list(log.blocks()))
    np.testing.assert_array_equal(columns["seq"], np.arange(len(columns["seq"])))
    np.testing.assert_array_equal(columns["counts"][:, 3], columns["seq"])
    assert produced - len(columns["seq"]) <= 500
    assert log.events[-1]["at"] >= produced - 500
    assert log.outcome is None


def test_power_cut_loses_less_than_two_seconds(tmp_path: Path, meta: LogMeta, monkeypatch: pytest.MonkeyPatch) -> None:
    path, synced = tmp_path / "run.h5", tmp_path / "synced.h5"
    now = 0.0
    snapshots: list[float] = []

    def fsync(handle: int) -> None:
        shutil.copyfile(path, synced)
        snapshots.append(now)

    class AtOnce:
        """Run submitted work in this thread."""

        def submit(self, work: Callable[..., None], *values: object) -> Future[None]:
            done: Future[None] = Future()
            done.set_result(work(*values))
            return done

        def shutdown(self, wait: bool) -> None:
            """Do nothing, because no thread is running."""

    monkeypatch.setattr(raw_log.os, "fsync", fsync)
    monkeypatch.setattr(raw_log.time, "monotonic", lambda: now)
    monkeypatch.setattr(raw_log, "ThreadPoolExecutor", lambda *_: AtOnce())
    writer = RawLogWriter(path, meta)
    for k in range(200):
        now = 0.05 * k
        writer.append(make_block("rate", 10 * k, 10))
        if k > 0:
            assert now - snapshots[-1] <= 1.0
        if k % 37 == 36:
            log = open_log(synced)
            kept = sum(len(b) for b in log.blocks())
            assert 10 * (k + 1) - kept <= 2.0 * 200
            assert log.outcome is None
    writer.close("passed")
    assert open_log(synced).facts().samples == 2000


def test_rows_not_written_to_disk_are_removed(tmp_path: Path, meta: LogMeta) -> None:
    path = tmp_path / "run.h5"
    writer = RawLogWriter(path, meta)
    block = make_block("rate", 5, 100)
    writer.append(block)
    writer.flush()
    copy = bytearray(path.read_bytes())
    row = copy.find(block.counts[60].astype("<f8").tobytes()) - raw_log.row_dtype(0, False).fields["counts"][1]
    copy[row : row + 40 * raw_log.row_dtype(0, False).itemsize] = bytes(40 * raw_log.row_dtype(0, False).itemsize)
    (tmp_path / "copy.h5").write_bytes(copy)
    assert joined(list(open_log(tmp_path / "copy.h5").blocks()))["seq"].tolist() == list(range(5, 65))
    writer.close("passed")


def test_memory_and_time_do_not_grow_with_the_log(tmp_path: Path, meta: LogMeta) -> None:
    import tracemalloc

    path = tmp_path / "run.h5"
    writer = RawLogWriter(path, meta)
    block = make_block("rate", 0, 1000)
    tracemalloc.start()
    for k in range(150):
        seq = block.seq + 1000 * k
        writer.append(SampleBlock("rate", seq, (seq + 1) / 100, *list(vars(block).values())[3:]))
        writer.flush()
    _, peak = tracemalloc.get_traced_memory()
    writer.close("passed")
    tracemalloc.reset_peak()
    assert sum(len(b) for b in open_log(path).blocks()) == 150_000
    _, reading = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 5e6
    assert reading < 12e6
    assert path.stat().st_size < 150_000 * raw_log.row_dtype(0, False).itemsize * 1.05 + 1e5


def test_full_disk_is_reported_once_and_keeps_recorded_samples(
    tmp_path: Path, meta: LogMeta, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = RawLogWriter(tmp_path / "a.h5", meta)
    log.append(make_block("rate", 0, 500))
    log.sync()

    def full(handle: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with raises_code(ConfigurationError, "log.not_written") as caught:
        log.sync()
    assert caught.value.values["reason"] == Text("os.disk_full")
    log.append(make_block("rate", 500, 10))
    log.event({"event": "x"})
    log.service()
    log.close("fault")
    log.close("fault")
    monkeypatch.undo()
    assert not being_written(tmp_path / "a.h5")
    kept = open_log(tmp_path / "a.h5")
    assert kept.outcome is None
    assert sum(len(b) for b in kept.blocks()) == 500


def test_full_disk_at_the_start_of_a_stage_is_reported(
    tmp_path: Path, meta: LogMeta, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    log = RawLogWriter(tmp_path / "a.h5", meta)
    monkeypatch.setattr(h5py.Dataset, "resize", full)
    with raises_code(ConfigurationError, "log.not_written"):
        log.append(make_block("rate", 0, 10))
    log.close("fault")


@pytest.mark.parametrize("calls", [0, 1, 2])
def test_log_that_cannot_be_created_leaves_no_file(
    tmp_path: Path, meta: LogMeta, monkeypatch: pytest.MonkeyPatch, calls: int
) -> None:
    remaining, allocate = iter(range(calls)), raw_log.allocate

    def full(handle: int, size: int) -> None:
        if next(remaining, None) is None:
            raise OSError(errno.ENOSPC, "No space left on device")
        allocate(handle, size)

    monkeypatch.setattr(raw_log, "allocate", full)
    with raises_code(ConfigurationError, "log.not_created"):
        RawLogWriter(tmp_path / "a.h5", meta)
    assert not list(tmp_path.iterdir())


def test_slow_disk_does_not_block_and_its_errors_are_reported(
    tmp_path: Path, meta: LogMeta, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = RawLogWriter(tmp_path / "a.h5", meta)
    reached, begun = threading.Event(), threading.Event()

    def slow(handle: int) -> None:
        begun.set()
        assert reached.wait(60.0)
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(os, "fsync", slow)
    monkeypatch.setattr(raw_log, "SYNC_INTERVAL", 0.0)
    log.append(make_block("rate", 0, 500))
    assert begun.wait(60.0)
    log.append(make_block("rate", 500, 500))  # would block if it waited for the disk
    reached.set()
    with raises_code(ConfigurationError, "log.not_written") as caught:
        log.sync()
    assert caught.value.values["reason"] == Text("os.io_error")
    log.close("fault")
    monkeypatch.undo()
    assert sum(len(b) for b in open_log(tmp_path / "a.h5").blocks()) >= 500


@pytest.mark.skipif(sys.platform == "win32", reason="an open file cannot be moved there")
def test_removed_folder_is_reported(tmp_path: Path, meta: LogMeta) -> None:
    folder = tmp_path / "runs"
    folder.mkdir()
    log = RawLogWriter(folder / "a.h5", meta)
    log.append(make_block("rate", 0, 100))
    log.sync()
    folder.rename(tmp_path / "elsewhere")
    with raises_code(ConfigurationError, "log.not_written"):
        log.sync()
    log.close("fault")
    assert sum(len(b) for b in open_log(tmp_path / "elsewhere" / "a.h5").blocks()) == 100


@pytest.fixture
def tiny_disk(tmp_path: Path) -> Iterator[Path]:
    """Mount a file system of 5 MB, or skip the test if not permitted."""
    place = tmp_path / "tiny"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=5m", "tmpfs", str(place)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("may not mount a file system")
    yield place
    subprocess.run(["umount", str(place)], check=True)


_FILLS_ITS_DISK = """
import os, sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from records_samples import make_block
from calstation.errors import ConfigurationError
from calstation.records.raw import raw_log
from calstation.records.meta import meta_from_json
raw_log.RESERVED_SPACE = 0
path, limit = Path(sys.argv[1]), int(sys.argv[3])
log = raw_log.RawLogWriter(path, meta_from_json(sys.stdin.read(), path))
if limit:
    import resource
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
if sys.argv[4] == "HDF5":
    raw_log.allocate = lambda handle, size: None
kept = 0
try:
    while True:
        log.append(make_block("rate", kept, 200))
        log.flush()
        kept += 200
except ConfigurationError as error:
    print(error)
log.event({"event": "Fault"})
log.add_result({"parameters": "x" * 100_000})
log.close("fault")
print(kept, flush=True)
"""


def fill(path: Path, meta: LogMeta, limit: int = 0, failing: str = "allocation") -> tuple[str, int]:
    """Write a log until the disk is full, and close it in a process that must end normally.

    Returns the error and the number of samples that were flushed.
    """
    command = [sys.executable, "-c", _FILLS_ITS_DISK, str(path), str(Path(__file__).parent), str(limit), failing]
    done = subprocess.run(command, input=meta.to_json(), capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    error, kept = done.stdout.strip().splitlines()
    return error, int(kept)


def check_complete(path: Path, kept: int) -> None:
    """Check that a log contains all samples and its last records although the disk was full."""
    log = open_log(path)
    assert (log.outcome, log.events[-1], len(log.results)) == ("fault", {"event": "Fault"}, 1)
    facts = log.facts()
    assert facts.samples >= kept
    assert facts.sha256 == log.stored_sha256


@pytest.mark.long
def test_log_is_completed_on_a_disk_that_other_files_have_filled(tiny_disk: Path, meta: LogMeta) -> None:
    error, kept = fill(tiny_disk / "a.h5", meta)
    assert "The log cannot be written any more (the disk is full)" in error
    check_complete(tiny_disk / "a.h5", kept)


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="there are no limits")
@pytest.mark.parametrize(
    "limit",
    [
        2_500_000,
        *(pytest.param(3_000_000 + 12_345 * k, marks=pytest.mark.exhaustive) for k in range(60)),
    ],
)
def test_log_is_completed_at_the_largest_permitted_size(tmp_path: Path, meta: LogMeta, limit: int) -> None:
    error, kept = fill(tmp_path / "a.h5", meta, limit)
    assert "the largest permitted size of a file is reached" in error
    check_complete(tmp_path / "a.h5", kept)


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="there are no limits")
@pytest.mark.parametrize(
    "limit",
    [
        1_500_000,
        *(pytest.param(1_500_000 + 12_345 * k, marks=pytest.mark.exhaustive) for k in range(1, 40)),
    ],
)
def test_failed_write_of_hdf5_does_not_crash_the_process(tmp_path: Path, meta: LogMeta, limit: int) -> None:
    error, kept = fill(tmp_path / "a.h5", meta, limit, "HDF5")
    assert "The log cannot be written any more" in error
    log = open_log(tmp_path / "a.h5")
    assert log.outcome is None
    assert sum(len(block) for block in log.blocks()) >= kept - 200


def test_nearly_full_disk_is_reported_while_the_log_can_still_be_closed(
    tmp_path: Path, meta: LogMeta, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = RawLogWriter(tmp_path / "a.h5", meta)
    log.append(make_block("rate", 0, 100))
    log.free_space = lambda path: raw_log.RESERVED_SPACE - 1
    with raises_code(ConfigurationError, "log.disk_nearly_full"):
        log.sync()
    log.event({"event": "Fault"})
    log.close("fault")
    found = open_log(tmp_path / "a.h5")
    assert (found.outcome, found.events) == ("fault", [{"event": "Fault"}])


@pytest.mark.parametrize(
    ("reason", "schedule", "by_hand"),
    [
        ("operator", {"rounds": 4}, True),
        ("operator", {"rounds": 0, "targets": {"gyro_bias": 1e-6}}, True),
        ("operator", {"rounds": 0, "duration_s": 60.0}, True),
        ("operator", {"points_c": [10.0, 20.0]}, True),
        ("operator", {"rounds": 0, "targets": {}}, False),
        ("rounds", {"rounds": 4}, False),
        ("failing", {"rounds": 4}, False),
    ],
)
def test_stage_is_ended_by_hand_if_its_schedule_was_not_complete(
    reason: str, schedule: dict[str, Any], by_hand: bool
) -> None:
    events = [{"event": "StageEnded", "stage": "rate", "reason": reason, "rounds": 1}]
    assert stages_ended_by_hand(events, {"rate": schedule}) == (("rate",) if by_hand else ())
    assert completed_rounds(events) == ({} if reason == "plan" else {"rate": 1})
