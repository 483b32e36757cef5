"""Runs that end together, or are killed, hand over every result once to a folder that is sometimes unreachable."""

import csv
import json
import os
import threading
import time
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

from calstation.config import StationConfig
from calstation.records import SUFFIX, files
from calstation.results import HandOver, handover, register_pending
from calstation.results.handover import CSV_NAME, PENDING
from tests.interleaving.scheduler import Scheduler, failing_seed, run_seeds, with_seeds
from tests.site_folder import STATION

CONFIG = StationConfig.model_validate({**STATION, "bench": {}, "handover": {"folder": "share"}})
PROCESSES, RUNS = 3, 2


def result_of(name: str) -> dict[str, Any]:
    """Return a small result of a run."""
    return {
        "schema": "calstation.result/1",
        "parameters": {},
        "started_utc": "2026-11-21T10:00:00+00:00",
        "unit": {"serial": name.partition("_")[0]},
        "outcome": "stopped",
        "stages": [],
        "duration_s": 12.34,
        "log": {"sha256": "1f", "file": f"{name}{SUFFIX}"},
    }


def hand_over_runs(seed: int, parent: Path) -> None:
    """Hand over runs of three processes, and check that the last one delivers what is left, and nothing twice."""
    scheduler = Scheduler(seed, (handover, files))
    random, folder = scheduler.random, parent / str(seed)
    runs, share, away = folder / "runs", folder / "share", folder / "away"
    for each in (runs, share):
        each.mkdir(parents=True)

    def process(number: int) -> None:
        for index in range(RUNS):
            name = f"SN-{number}_{index}"
            (runs / f"{name}{SUFFIX}").touch()
            register_pending(runs, name)
            hand_over = HandOver(runs, folder / "station.toml", CONFIG, lambda event: None)
            hand_over.start()
            time.sleep(random.choice((0.0, 0.1, 20.0)))
            files.write_atomic(runs / f"{name}.json", json.dumps(result_of(name)))
            hand_over.finish()

    def main() -> None:
        processes = [threading.Thread(target=process, args=(number,)) for number in range(PROCESSES)]
        for each in processes:
            each.start()
        if random.random() < 0.4:
            victim = random.choice(processes)
            assert victim.task is not None
            victim.task.life = random.randrange(1, 400)
        if random.random() < 0.4:
            time.sleep(random.choice((0.0, 0.1, 20.0)))
            share.rename(away)
            time.sleep(random.choice((0.01, 10.0)))
            away.rename(share)
        for each in processes:
            each.join()
        while handover._deliver(runs, share, False).reason is not None:  # a process that gave up may still deliver
            time.sleep(1.0)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda handle: None)
        scheduler.run(main)
    finished = sorted(path.stem for path in runs.glob("*.json"))
    assert sorted(path.stem for path in share.glob("SN*.json")) == finished
    for name in finished:
        assert json.loads((share / f"{name}.json").read_text("utf-8")) == result_of(name)
    with (share / CSV_NAME).open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert sorted(row["result"].removesuffix(".json") for row in rows) == finished
    pending = {path.name for path in (runs / PENDING).iterdir()} - {".lock"}
    assert pending.isdisjoint(finished)


@pytest.mark.long
@with_seeds(40)
def test_every_result_is_handed_over_once(seeds: range, tmp_path: Path) -> None:
    run_seeds(seeds, lambda seed: hand_over_runs(seed, tmp_path))


def _remove_first(runs: Path, name: str, folder: Path) -> None:
    """Deliver a result that is no longer pending."""
    (runs / PENDING / name).unlink(missing_ok=True)
    HAND_OVER(runs, name, folder)


HAND_OVER = handover._hand_over
#: Faults in the hand-over, each of which some seed finds.
PLANTED = {
    "without a lock": ("locked", lambda path, timeout: nullcontext()),
    "a result is removed before it is delivered": ("_hand_over", _remove_first),
}


@pytest.mark.long
@pytest.mark.parametrize("name", PLANTED)
def test_seeds_find_a_fault_of_the_hand_over(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(handover, *PLANTED[name])
    assert failing_seed(range(200), lambda seed: hand_over_runs(seed, tmp_path)) is not None
