"""Runs over temperature on the virtual bench with its chamber: result, second solution, stop and resumption."""

import os
import signal
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calstation.config import RunRequest, check_station, library, load_configuration
from calstation.errors import ConfigurationError
from calstation.physics import TEMPERATURES
from calstation.records import open_log
from calstation.results import resolve
from calstation.runs import Engine, RunStart, execute, find_interrupted, find_resumable, finish_incomplete
from calstation.sequencer import Command, Control, Event, Finalized, Message, PointCompleted, StepStarted
from tests.helpers import error_code, ignore_progress, raises_code
from tests.runs.test_batch_runs import batch_of, run_batch
from tests.site_folder import SiteFolder

MOVES = [
    [0.0, 0.0, 4.0],
    [-225.0, 135.0, 0.5],
    [-90.0, 360.0, 0.5],
    [-315.0, 225.0, 0.5],
    [-225.0, 270.0, 0.5],
    [-135.0, 180.0, 0.5],
    [-45.0, 225.0, 0.5],
    [-90.0, 270.0, 3.0],
]
SOAK = {"unit_rate_below_c_per_min": 0.3, "hold_s": 20.0, "at_most_s": 3600.0}
PRODUCT: dict[str, Any] = {
    "name": "short thermal",
    "imu": "bench_mems_thermal",
    "bench_grade": "mems",
    "stages": ["temperature"],
    "temperature": {"range_c": [22.0, 38.0], "order": {"gyro_bias": 1, "accel_bias": 1}},
    "schedule": {
        "temperature": {
            "points_c": [26.0, 18.0, 34.0],
            "soak": SOAK,
            "moves": MOVES,
            "rate_dps": 100.0,
            "acceleration_dps2": 150.0,
        }
    },
    "limits": {"gyro_bias": {"within": 0.02, "sigma_below": 1e-3}, "accel_bias": {"within": 0.2}},
    "checks": {"offline_online": {"within_sigmas": 0.0}},
}
THERMAL = {"case_time_s": 30.0, "dependence": 0.1, "hysteresis": 0.0, "rate_term": 0.0}


@pytest.fixture
def thermal(site_folder: SiteFolder) -> SiteFolder:
    """A station with a chamber, and a product with three temperatures."""
    write(site_folder)
    return site_folder


def write(site_folder: SiteFolder, **schedule: Any) -> None:
    values = {**PRODUCT["schedule"]["temperature"], **schedule}
    product = {**PRODUCT, "schedule": {"temperature": values}}
    site_folder.write(product, {"chamber": {"profile": "virtual_chamber"}}, thermal=THERMAL)


def test_stage_without_a_chamber_or_with_other_stages_is_refused(site_folder: SiteFolder) -> None:
    site_folder.write(PRODUCT)
    with raises_code(ConfigurationError, "temperature.no_chamber"):
        site_folder.run()
    write(site_folder)
    with raises_code(ConfigurationError, "temperature.not_alone"):
        site_folder.run("designed", "temperature")


def test_states_of_the_imu_profile_are_refused(
    site_folder: SiteFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(site_folder)
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))
    profile = library.find("imus", "bench_mems_thermal").read_text(encoding="utf-8")
    folder = library.site_folder() / "imus"
    folder.mkdir(parents=True)
    (folder / "bench_mems_thermal.toml").write_text(f'states = ["g_sensitivity"]\n{profile}', encoding="utf-8")
    with pytest.raises(ConfigurationError) as caught:
        load_configuration(site_folder.request())
    assert error_code(caught.value) == "temperature temperature.states"


@pytest.mark.parametrize(("points", "ambient", "outside"), [([26.0, 90.0], 23.0, 90.0), ([60.0, 80.0], 23.0, 23.0)])
def test_temperatures_that_the_chamber_cannot_reach_are_refused_before_it_is_opened(
    site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch, points: list[float], ambient: float, outside: float
) -> None:
    """One that heats only could not return to ambient, and would stay hot."""
    write(site_folder, points_c=points)
    setup = load_configuration(site_folder.request())
    assert setup.chamber is not None
    chamber = setup.chamber.model_copy(update={"range_c": (ambient + 20.0 if outside == ambient else -70.0, 85.0)})
    with raises_code(ConfigurationError, "chamber.target_outside") as caught:
        check_station(replace(setup, chamber=chamber))
    assert (caught.value.values["device"], caught.value.values["temperature"]) == ("chamber", outside)


@pytest.mark.long
def test_run_over_temperature_passes_and_is_solved_again_bit_for_bit(thermal: SiteFolder) -> None:
    ended = thermal.run()
    result = ended.result
    assert ended.verdict.passed, [c for c in result["checks"] if not c["passed"]] or thermal.events[-5:]
    section = result["temperature"]
    assert len(section["coefficients"]["gyro_bias_x"]["values"]) == 2
    assert [p["way"] for p in section["points"]] == ["soak", "down", "up"]
    assert [p["at_c"] for p in section["points"]] == pytest.approx([30.0, 22.0, 38.0], abs=0.5)
    again = resolve(Path(ended.log)).result.to_json()
    assert again["temperature"] == result["temperature"]
    assert again["parameters"] == result["parameters"]

    new, registers = section["coefficients"], result["registers"]
    assert registers["verified"] is True
    assert registers["new"]["gyro_bias_x[1]"] == pytest.approx(new["gyro_bias_x"]["values"][1], rel=1e-6)
    assert registers["new"]["gyro_bias_x[2]"] == 0.0
    assert [registers["new"][name] for name in TEMPERATURES] == [25.0, 22.0, 38.0]
    soaks = [step.label for step in thermal.events_of(StepStarted) if step.kind.startswith("soak")]
    assert soaks[-1] == ("soak_to_verify", 23.0)
    log = open_log(Path(ended.log))
    air = np.concatenate([block.chamber[:, 0] for block in log.blocks() if block.stage])
    assert np.nanmin(air) == pytest.approx(18.0, abs=1.0)
    assert [m.id for m in thermal.events_of(Message)][-1] == "chamber_may_be_opened"


def begins_last_soak(event: Event) -> bool:
    """Return whether the event is the start of the third soak."""
    return isinstance(event, StepStarted) and event.kind == "soak" and event.label[2] == 3.0


@pytest.mark.exhaustive
def test_run_stopped_in_a_soak_resumes_after_its_last_temperature(thermal: SiteFolder) -> None:
    def stop(event: Event) -> None:
        if begins_last_soak(event):
            thermal.control.send(Command.STOP)

    stopped = thermal.run(on_event=stop)
    assert (stopped.verdict, stopped.result["advice"], stopped.result["stages"]) == ("stopped", "resume", [])
    messages = [m.id for m in thermal.events_of(Message)]
    assert messages[-2:] == ["chamber_to_ambient", "chamber_may_be_opened"]
    _resume(thermal, stopped.log)


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL exists only on POSIX systems")
def test_run_killed_in_a_soak_resumes_after_its_last_temperature(thermal: SiteFolder) -> None:
    with Engine.start(thermal.request()) as engine:
        for event in engine.events():
            if begins_last_soak(event) and engine.process.pid is not None:
                os.kill(engine.process.pid, signal.SIGKILL)
                break
    (log,) = thermal.runs.glob("*.h5")
    _resume(thermal, str(log))


def _resume(thermal: SiteFolder, log: str) -> None:
    (offer,) = find_resumable(ignore_progress, thermal.runs)
    assert (offer.log, offer.finished) == (Path(log), ())

    thermal.events, thermal.control = [], Control()
    request = RunRequest("SN-000042", thermal.station, thermal.product, resume=offer.log)
    execute(request, thermal.events.append, thermal.control)
    (ended,) = thermal.events_of(Finalized)
    assert ended.verdict.passed, [c for c in ended.result["checks"] if not c["passed"]]
    assert [point.index for point in thermal.events_of(PointCompleted)] == [1, 2, 3]
    assert len(ended.result["temperature"]["points"]) == 3
    again = resolve(Path(ended.log)).result.to_json()
    assert again["temperature"] == ended.result["temperature"]
    assert find_resumable(ignore_progress, thermal.runs) == []


@pytest.mark.exhaustive  # the batch during ramps is rehearsed
def test_units_of_a_batch_are_calibrated_over_temperature_at_once(thermal: SiteFolder) -> None:
    """The clock of each unit changes with its temperature by 20 ppm within the short range."""
    station = {"chamber": {"profile": "virtual_chamber"}}
    thermal.write(PRODUCT, station, thermal={**THERMAL, "clock_ppm": 400.0}, units=4)
    serials = tuple(f"SN-{number:06d}" for number in range(1, 5))
    verdicts = run_batch(thermal, batch_of(thermal, serials=serials))
    assert list(verdicts) == ["1", "2", "3", "4"]
    for ended in verdicts.values():
        assert ended.verdict.passed, [c for c in ended.result["checks"] if not c["passed"]]
        assert ended.result["registers"]["verified"] is True
        assert len(ended.result["temperature"]["points"]) == 3
    biases = {
        tuple(ended.result["temperature"]["coefficients"]["gyro_bias_x"]["values"]) for ended in verdicts.values()
    }
    assert len(biases) == 4
    chamber = [m.id for m in thermal.events_of(Message) if m.id.startswith("chamber_")]
    assert chamber[-1] == "chamber_may_be_opened"


@pytest.mark.exhaustive
@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL exists only on POSIX systems")
def test_batch_killed_in_a_soak_is_resumed_together_after_its_last_temperature(thermal: SiteFolder) -> None:
    thermal.write(PRODUCT, {"chamber": {"profile": "virtual_chamber"}}, thermal=THERMAL, units=3)
    serials = ("SN-000001", "", "SN-000003")
    with Engine.start(batch_of(thermal, serials=serials)) as engine:
        for event in engine.events():
            if begins_last_soak(event) and engine.process.pid is not None:
                os.kill(engine.process.pid, signal.SIGKILL)
                break
    finish_incomplete(thermal.runs)
    (interrupted,) = find_interrupted(ignore_progress, thermal.runs, "test bench")
    assert [(run.serial, run.slot, run.completed.amount) for run in interrupted.runs] == [
        ("SN-000001", "1", (0, 2)),
        ("SN-000003", "3", (0, 2)),
    ]
    assert interrupted.others == ()

    verdicts = run_batch(thermal, resumed_batch(thermal, serials))
    assert list(verdicts) == ["1", "3"]
    for ended in verdicts.values():
        assert ended.verdict.passed, [c for c in ended.result["checks"] if not c["passed"]]
        assert ended.result["batch"] == interrupted.runs[0].batch
        assert len(ended.result["temperature"]["points"]) == 3
        again = resolve(Path(ended.log)).result.to_json()
        assert again["temperature"] == ended.result["temperature"]
        assert again["parameters"] == ended.result["parameters"]
    soaks = [step.label[2] for step in thermal.events_of(StepStarted) if step.kind == "soak"]
    assert soaks == [3.0]
    assert find_interrupted(ignore_progress, thermal.runs) == []


def resumed_batch(folder: SiteFolder, serials: tuple[str, ...]) -> RunRequest:
    """Return the request after the question whether to resume the units that are in the slots."""
    start = RunStart(batch_of(folder, serials=serials), "operator")
    question = start.next_question()
    assert question is not None
    assert question.text.code == "question.units_resume"
    assert "Temperatures that need not be repeated: 2." in str(question.text)
    start.answer(question, "resume")
    assert start.next_question() is None
    return start.request


@pytest.mark.exhaustive
def test_units_of_a_batch_are_calibrated_during_ramps(thermal: SiteFolder) -> None:
    """The clocks and lags of two units differ, and the registers are verified between the ends of the ramps."""
    schedule = {**PRODUCT["schedule"]["temperature"], "points_c": [18.0, 46.0, 18.0], "ramp_c_per_min": 3.0}
    temperature = {"range_c": [22.0, 50.0], "order": "auto", "rate_term": ["gyro_bias", "accel_bias"]}
    product = {**PRODUCT, "temperature": temperature, "schedule": {"temperature": schedule}}
    thermal.write(product, {"chamber": {"profile": "virtual_chamber"}}, thermal=THERMAL, units=2)
    verdicts = run_batch(thermal, batch_of(thermal, serials=("SN-000001", "SN-000002")))
    assert list(verdicts) == ["1", "2"]
    for ended in verdicts.values():
        assert ended.verdict.passed, [c for c in ended.result["checks"] if not c["passed"]]
        assert ended.result["registers"]["verified"] is True
        ways = [point["way"] for point in ended.result["temperature"]["points"]]
        assert ways.count("up") > 5
        assert ways.count("down") > 5
        assert ended.result["temperature"]["coefficients"]["gyro_bias_x"]["rate"] is not None
    ramps = [step.label for step in thermal.events_of(StepStarted) if step.kind == "ramp"]
    assert ramps == [("ramp", 46.0, 3.0), ("ramp", 18.0, 3.0)]
    soaks = [step.label for step in thermal.events_of(StepStarted) if step.kind.startswith("soak")]
    assert soaks[-1] == ("soak_to_verify", 38.0)
