"""A disk that becomes full at any moment of a run neither ends the engine nor loses what was written to a unit."""

import json
import random
import shutil
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from calstation.errors import CalstationError
from calstation.records import open_log
from calstation.records.raw import raw_log
from calstation.runs import finish_incomplete
from calstation.sequencer import Event, Fault, Finalized, Message, StageSolved
from tests.helpers import sampled
from tests.site_folder import SiteFolder


@dataclass
class Disk:
    """A small file system with a runs folder."""

    folder: Path

    def fill(self) -> None:
        """Fill the disk."""
        with (self.folder / "filler").open("ab", buffering=0) as filler:
            for size in (1_000_000, 4096):
                try:
                    while True:
                        filler.write(bytes(size))
                except OSError:
                    continue

    def free(self) -> None:
        """Free the disk again."""
        (self.folder / "filler").unlink(missing_ok=True)


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Disk]:
    """Mount a file system of 64 MB, or skip the test if not permitted."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=64m", "tmpfs", str(folder)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("may not mount a file system")
    yield Disk(folder)
    subprocess.run(["umount", str(folder)], check=True)


def run_until_full(disk: Disk, is_moment: Callable[[Event], bool]) -> SiteFolder:
    """Run a calibration and fill the disk at the first event that is the moment; check what is left."""
    site = SiteFolder(disk.folder)
    filled: list[Event] = []

    def emit(event: Event) -> None:
        site.events.append(event)
        if not filled and is_moment(event):
            filled.append(event)
            disk.fill()

    error: CalstationError | None = None
    try:
        site.execute(emit)
    except CalstationError as exc:
        error = exc
    check(site, disk, error)
    return site


def check(site: SiteFolder, disk: Disk, error: CalstationError | None) -> None:
    """Check that the run and its files state what is known."""
    verified = any(e.id == "registers_written" for e in site.events_of(Message))
    (finalized,) = site.events_of(Finalized)
    assert error is None
    registers = finalized.result["registers"]
    if verified:
        assert finalized.verdict.passed
    elif finalized.result["error"] is not None:
        assert "disk" in finalized.result["error"]
        for fault in site.events_of(Fault):
            assert "disk" in fault.text
    log, result = Path(finalized.log), Path(finalized.result_file)
    if not result.exists():
        assert any(e.id == "not_stored" for e in site.events_of(Message))
    disk.free()
    finish_incomplete(site.runs)
    stored = json.loads(result.read_text(encoding="utf-8"))
    assert stored["registers"] == registers
    assert stored["outcome"] == finalized.result["outcome"] == open_log(log).outcome
    assert open_log(log).facts().sha256 == stored["log"]["sha256"]


MOMENTS: dict[str, Callable[[Event], bool]] = {
    "stage": lambda event: isinstance(event, StageSolved) and event.stage == "six_position",
    "transfer": lambda event: isinstance(event, Message) and event.id == "registers_transfer",
    "verification": lambda event: isinstance(event, Message) and event.id == "verifying",
    "written": lambda event: isinstance(event, Message) and event.id == "registers_written",
}


@pytest.mark.long
@pytest.mark.parametrize(("moment", "reserved"), sampled(2, MOMENTS, [0, raw_log.RESERVED_SPACE]))
def test_full_disk_loses_nothing(disk: Disk, monkeypatch: pytest.MonkeyPatch, moment: str, reserved: int) -> None:
    monkeypatch.setattr(raw_log, "RESERVED_SPACE", reserved)
    run_until_full(disk, MOMENTS[moment])


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(100))
def test_disk_that_becomes_full_at_a_random_moment_loses_nothing(
    disk: Disk, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    rng = random.Random(seed)
    monkeypatch.setattr(raw_log, "RESERVED_SPACE", rng.choice((0, raw_log.RESERVED_SPACE)))
    number = iter(range(1_000_000))
    moment = rng.choice((rng.randrange(850), rng.randrange(850, 933)))  # before, and from the transfer to the end
    run_until_full(disk, lambda event: next(number) >= moment)
