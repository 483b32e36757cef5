"""One run with every recoverable fault: invalid steps are repeated, and the unit passes."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calstation.records import open_log
from calstation.results import resolve
from calstation.sequencer import Event, StepStarted
from tests.faults.conftest import FaultRuns, Ran, fault

pytestmark = pytest.mark.long

_FAULTS = [
    {"kind": "jump_counter", "value": 62_500.0, "time_s": 0.0},
    fault("corrupt_frames", 2, step=1),
    fault("noise_bytes", 5, step=4, time_s=0.0),
    fault("duplicate_frames", 5, step=5, time_s=0.0),
    fault("reorder_frames", 3, step=6, time_s=0.0),
    fault("mute_table", 2, step=7, time_s=0.0),
    fault("slow_table", 0.35, step=8, time_s=0.0),
    fault("drop_frames", 3, step=9),
    fault("saturate_imu", 0.1, step=16),
    fault("reset_imu", step=22),
    fault("silence_imu", 0.3, step=28),
    fault("slow_imu", 1.1, step=30, time_s=0.0),  # the transfer's first answer, its repetition late as well
    fault("slow_imu", 0.1, step=30, time_s=0.0),
]


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ran]:
    """The run; its wall clock is set back by one hour during the run."""
    stepped: list[bool] = []
    now = time.time

    def on_event(event: Event) -> None:
        if isinstance(event, StepStarted) and event.stage and not stepped:
            stepped.append(True)
            patch.setattr(time, "time", lambda: now() - 3600.0)

    with pytest.MonkeyPatch.context() as patch:
        fault_runs = FaultRuns(tmp_path_factory.mktemp("fault_runs"))
        yield fault_runs.run(*_FAULTS, stages=("rate", "six_position"), on_event=on_event)
    assert stepped


def test_every_planned_fault_occurred(ran: Ran) -> None:
    assert ran.bench["executed"] == [planned["kind"] for planned in _FAULTS]


def test_verdict_is_correct_despite_the_faults(ran: Ran) -> None:
    result = ran.ended.result
    assert ran.ended.verdict.passed, [c for c in result["checks"] if not c["passed"]]
    assert result["registers"]["verified"] is True
    assert resolve(Path(ran.ended.log)).result.to_json()["parameters"] == result["parameters"]


@pytest.mark.parametrize("reason", ["gap", "saturated"])
def test_steps_with_invalid_samples_are_repeated(ran: Ran, reason: str) -> None:
    assert reason in ran.repeated


def test_each_disturbance_is_counted_once(ran: Ran) -> None:
    """Corrupt, dropped, reset and silent faults cause one gap each; the other faults cause none."""
    assert sorted(ran.repeated) == ["gap"] * 4 + ["saturated"]
    assert ran.ended.result["log"]["gaps"] == 4


def test_samples_of_an_interrupted_step_are_invalid_until_it_is_repeated(ran: Ran) -> None:
    blocks = [block for block in open_log(Path(ran.ended.log)).blocks() if block.stage == "rate"]
    valid = np.concatenate([block.valid for block in blocks])
    steps = np.concatenate([block.step for block in blocks])
    assert not valid.all()
    begins = np.flatnonzero(np.diff(valid.astype(int)) == 1) + 1
    assert len(begins) >= 4
    assert (steps[begins] > steps[begins - 1]).all(), "valid again only as a step of its own"


def test_counter_wrap_loses_no_samples(ran: Ran) -> None:
    first, last = (ran.ended.result["log"][name] for name in ("first_seq", "last_seq"))
    assert first < 65_536 < last
    seq = np.concatenate([block.seq for block in open_log(Path(ran.ended.log)).blocks()])
    assert (np.diff(seq) > 0).all()
    assert int((np.diff(seq) - 1).sum()) < 200


def test_wall_clock_step_affects_only_labels(ran: Ran) -> None:
    assert 0.0 < ran.ended.result["duration_s"] < 600.0
    times: list[Any] = [block.time for block in open_log(Path(ran.ended.log)).blocks()]
    assert (np.diff(np.concatenate(times)) > 0.0).all()
