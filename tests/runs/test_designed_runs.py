"""Runs of the method `designed` on the bench end at the limits and re-solve bit-identically."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from calstation.config import RunRequest, library, load_configuration
from calstation.records import LogMeta, open_log
from calstation.results import resolve
from calstation.runs.resume import stage_schedule
from calstation.sequencer import Command, Message, StageEnded, StageProgress, StateChanged, StepStarted
from tests.site_folder import PRODUCT, SiteFolder

MOVES = [
    [0.0, 0.0, 6.0],
    [90.0, -180.0, 1.0],
    [-90.0, -90.0, 1.0],
    [-270.0, 0.0, 1.0],
    [-90.0, 90.0, 2.0],
    [-180.0, 90.0, 1.0],
    [-270.0, 0.0, 3.0],
    [-270.0, 90.0, 1.0],
    [-270.0, 0.0, 1.0],
    [-180.0, 0.0, 2.0],
    [-90.0, -90.0, 2.0],
    [-90.0, 0.0, 2.0],
]
SCHEDULE = {"moves": MOVES, "rate_dps": 100.0, "acceleration_dps2": 150.0}
LIMITS = {"gyro_scale": {"within": 0.02, "sigma_below": 3e-4}, "gyro_misalign": {"within": 0.02, "sigma_below": 3e-4}}


@pytest.fixture
def designed(site_folder: SiteFolder) -> SiteFolder:
    """A MEMS product with a designed stage."""
    write(site_folder)
    return site_folder


def write(folder: SiteFolder, schedule: dict[str, Any] | None = None, **bench: Any) -> None:
    product = {"imu": "bench_mems", "bench_grade": "mems", "stages": ["designed"], "limits": LIMITS}
    folder.write({**product, "schedule": {"designed": SCHEDULE | (schedule or {})}}, **bench)


@pytest.mark.long
def test_stage_ends_when_the_limits_are_met_and_re_solves_bit_identically(designed: SiteFolder) -> None:
    ended = designed.run()
    assert ended.verdict.passed, [c for c in ended.result["checks"] if not c["passed"]]
    (stage,) = designed.events_of(StageEnded)
    assert (stage.reason, len(MOVES) > stage.rounds) == ("targets", True)
    progress = designed.events_of(StageProgress)
    assert len(progress) > 20
    assert sum(event.remaining == 0.0 for event in progress) <= 2, "moves after the planned ones are not the end"
    log = open_log(Path(ended.log))
    for first in (None, log.facts().first_seq + 100):
        again = resolve(Path(ended.log), first_seq=first).result.to_json()
        assert set(again["parameters"]) == set(ended.result["parameters"])
        if first is None:
            assert again["parameters"] == ended.result["parameters"]


@pytest.mark.parametrize("units", [None, 2])
@pytest.mark.parametrize(("changes", "expected"), [({}, []), ({"margin": 0.5}, ["designed"])])
def test_schedule_of_a_log_differs_from_the_product_only_if_it_was_changed(
    site_folder: SiteFolder, units: int | None, changes: dict[str, Any], expected: list[str]
) -> None:
    """A resumed run is given the schedule of its log, whose targets contain those at the limits."""
    write(site_folder, **({} if units is None else {"units": units}))
    request = replace(site_folder.request(), slot=None if units is None else "2", schedule={"designed": changes})
    setup = load_configuration(request)
    stored = LogMeta.model_validate_json(setup.log_meta().model_dump_json(exclude_none=True))
    assert stored.schedule["designed"]["targets"]
    resumed = load_configuration(replace(request, schedule={"designed": stage_schedule(stored, "designed")}))
    assert resumed.schedules == setup.schedules
    assert resumed.changed_schedules == expected


@pytest.mark.long
def test_mandatory_moves_are_not_omitted(designed: SiteFolder) -> None:
    write(designed, {"least_moves": len(MOVES) - 1})
    assert designed.run().verdict.passed
    (stage,) = designed.events_of(StageEnded)
    assert (stage.reason, stage.rounds) == ("targets", len(MOVES) - 1)


@pytest.mark.long
def test_every_move_is_made_without_the_stop_rule(designed: SiteFolder) -> None:
    write(designed, {"stop_at_limits": False})
    assert designed.run().verdict.passed
    (stage,) = designed.events_of(StageEnded)
    assert (stage.reason, stage.rounds) == ("rounds", len(MOVES))


@pytest.mark.long
def test_designed_stage_can_be_paused_and_resumed(designed: SiteFolder) -> None:
    pause = designed.once(StepStarted, Command.PAUSE, after=4)

    def watch(event: object) -> None:
        pause(event)  # type: ignore[arg-type]
        if isinstance(event, StateChanged) and event.state == "paused":
            designed.control.send(Command.RESUME)

    ended = designed.run(on_event=watch)
    assert [e.state for e in designed.events_of(StateChanged)].count("paused") == 1
    assert ended.verdict.passed, [c for c in ended.result["checks"] if not c["passed"]]
    assert resolve(Path(ended.log)).result.to_json()["parameters"] == ended.result["parameters"]


@pytest.mark.long
def test_invalid_step_is_repeated(designed: SiteFolder) -> None:
    write(designed, orders=[{"order": "drop_frames", "value": 3, "at": 32.0}])
    ended = designed.run()
    assert [m.values["reason"] for m in designed.events_of(Message) if m.id == "step_repeated"] == ["gap"]
    assert ended.verdict.passed, [c for c in ended.result["checks"] if not c["passed"]]
    assert resolve(Path(ended.log)).result.to_json()["parameters"] == ended.result["parameters"]


@pytest.mark.long
def test_more_noise_than_in_the_profile_requires_more_moves(designed: SiteFolder) -> None:
    assert designed.run().verdict.passed
    write(designed, effects={"gyro_noise": 2.5})
    designed.run()  # its verdict does not matter
    quiet, noisy = designed.events_of(StageEnded)
    assert noisy.rounds > quiet.rounds


@pytest.mark.long
@pytest.mark.parametrize(("name", "seconds"), [("mems_c", 55.0), ("tactical_b", 105.0), ("nav_a", 210.0)])
def test_fast_product_passes_within_its_time(tmp_path: Path, name: str, seconds: float) -> None:
    folder = SiteFolder(tmp_path)
    product = library.find("products", f"{name}_fast")
    folder.request = lambda *stages: RunRequest("F-1", None, product, None, tmp_path / "runs", "tester")  # type: ignore[method-assign, misc, assignment]
    ended = folder.run()
    assert ended.verdict.passed, [c for c in ended.result["checks"] if not c["passed"]]
    samples = sum(len(block) for block in open_log(Path(ended.log)).blocks(None, None) if block.stage)
    (stage,) = folder.events_of(StageEnded)
    assert stage.reason == "targets"
    assert samples / 200.0 <= seconds + 0.4 * stage.rounds  # a bench at full speed is polled every 0.4 s


@pytest.mark.long
def test_stage_that_meets_its_targets_from_the_start_ends_after_its_first_rest(designed: SiteFolder) -> None:
    moves = [[0.0, 0.0, 0.0], [90.0, 0.0, 3.0], *MOVES[1:]]
    write(designed, {"moves": moves, "stop_at_limits": False, "targets": {"gyro_bias": 1.0}})
    ended = designed.run()
    (stage,) = designed.events_of(StageEnded)
    assert (stage.reason, stage.rounds) == ("targets", 2), "nothing can be solved before the first rest"
    assert ended.result["stages"] == ["designed"]
    assert resolve(Path(ended.log)).result.to_json()["parameters"] == ended.result["parameters"]


@pytest.mark.long
def test_repeated_stages_that_meet_their_targets_from_the_start_end_after_a_round(site_folder: SiteFolder) -> None:
    schedule = {stage: {**values, "rounds": 0} for stage, values in PRODUCT["schedule"].items() if "rounds" in values}
    site_folder.write({"stages": ["excitation", "azimuth_flip"], "schedule": schedule, "targets": {"gyro_bias": 1.0}})
    ended = site_folder.run()
    assert [(s.reason, s.rounds) for s in site_folder.events_of(StageEnded)] == [("targets", 1)] * 2
    assert resolve(Path(ended.log)).result.to_json()["parameters"] == ended.result["parameters"]
