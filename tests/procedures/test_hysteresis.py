"""Hysteresis after turns: its size and the errors that it causes are predicted from the turns of the whole run."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from simulated_stages import SCHEDULES, block_of, geometry_of, simulate
from simulated_stages import context_of as table_context
from simulated_stages import prior_of as table_prior

from calstation.bench import BenchConfig
from calstation.bench.truth import BenchTruth, Simulator
from calstation.estimation.common import Posterior
from calstation.estimation.effects import EffectTests
from calstation.physics import INDEX, Motion
from calstation.records import LogMeta
from calstation.results import StageChain
from procedures import method

STAGES = ("rate", "six_position", "excitation")
DPH = np.deg2rad(1.0) / 3600.0


def unit(**effects: Any) -> BenchTruth:
    """Return a navigation-grade unit with these effects."""
    return BenchConfig(grade="nav", seed=5, sample_rate_hz=50.0, instability=False, effects=effects).truth()


def solved_chain(truth: BenchTruth) -> StageChain:
    """Simulate and solve three stages of a unit, which a run would solve in this way."""
    table, imu = truth.table, truth.imu
    site = {"latitude_deg": float(np.rad2deg(table.latitude)), "longitude_deg": 0.0, "height_m": table.height}
    site |= {"azimuth_deg": 0.0, "gravity_mps2": table.gravity}
    sensors = {"serial": "SIM", "sample_rate_hz": imu.sample_rate, "output": imu.output}
    sensors |= {name: getattr(imu, name) for name in ("gyro_lsb", "accel_lsb", "gyro_arw", "accel_vrw")}
    prior = table_prior(truth)
    known = {name: {"value": 0.0, "sigma": float(prior.sigma[i])} for name, i in INDEX.items()}
    meta = {"site": site, "imu": sensors, "prior": known, "schedule": {stage: SCHEDULES[stage] for stage in STAGES}}
    chain, simulator = StageChain(LogMeta.model_validate(meta)), Simulator(truth, 5)
    for stage in STAGES:
        chain.start(stage)
        chain.feed(block_of(simulate(simulator, truth, stage)))
        chain.finish()
    return chain


@pytest.fixture(scope="module")
def sound() -> Posterior:
    return solved_chain(unit()).posterior


def assert_predicted(shifts: dict[str, float], output: Posterior, without: Posterior, smallest: float = 10.0) -> None:
    """Assert that the effect changes parameters by more than `smallest` sigma and as predicted.

    A shift is the error due to the effect, estimate minus truth.
    """
    actual = (output.mean - without.mean) / output.sigma
    names = [name for name in shifts if abs(shifts[name]) > smallest]
    assert names
    assert [shifts[name] for name in names] == pytest.approx([actual[INDEX[name]] for name in names], rel=0.1)


@pytest.mark.parametrize(
    ("setting", "sizes", "cause", "unit_size"),
    [
        ("gyro_hysteresis_dph", [1.0, 0.0, 0.0], "gyro_hysteresis", DPH),
        pytest.param(
            "gyro_scale_hysteresis_ppm", [40.0, -30.0, 20.0], "gyro_scale_hysteresis", 1e-6, marks=pytest.mark.long
        ),
    ],
)
def test_hysteresis_is_named_with_its_size_and_its_errors(
    sound: Posterior, setting: str, sizes: list[float], cause: str, unit_size: float
) -> None:
    chain = solved_chain(unit(**{setting: sizes}))
    diagnosis = next(test.diagnosis for test in chain.solutions[-1].tests if test.kind == "effects")
    assert diagnosis is not None
    assert (diagnosis.cause, diagnosis.values["component"]) == (cause, "x")
    assert diagnosis.size == pytest.approx(sizes[0] * unit_size, rel=0.1)
    assert_predicted(dict(diagnosis.parameter_shift), chain.posterior, sound)


def test_hysteresis_in_many_positions_is_found_with_its_size() -> None:
    chosen = method("multi_position")
    schedule = chosen.schedule(step_deg=90.0, rest_s=4.0, initial_rest_s=5.0, rate_dps=60.0, acceleration_dps2=60.0)
    posteriors, evidence = [], None
    for ppm in (0.0, 60.0):
        truth = unit(gyro_scale_hysteresis_ppm=[ppm, 0.0, 0.0])
        prior = table_prior(truth)
        solver = chosen.solver(table_context(truth), prior, schedule)
        solver.feed(block_of(Simulator(truth, 8).run(chosen.plan(geometry_of(truth), schedule), "multi_position")))
        solution = solver.finish()
        tests = EffectTests(prior.sigma)
        tests.add("multi_position", solution.sensitivity, solution.estimated)
        posteriors.append(solution.posterior)
        evidence = tests.evidence(solution.posterior)[0]
    assert (evidence.cause, evidence.component) == ("gyro_scale_hysteresis", "x")
    assert evidence.size == pytest.approx(6e-5, rel=0.1)
    assert_predicted(evidence.parameter_shift, posteriors[1], posteriors[0], 5.0)


def test_gyro_has_the_sense_of_its_own_sensed_turn() -> None:
    """A turn of 180° about z turns a gyro x that is misaligned by 10 mrad by 1.8°, and y by nothing."""
    rate = np.zeros((100, 3))
    rate[20:80, 2] = -np.pi / 6.0
    time, axes = 0.1 * np.arange(100), np.eye(3)
    axes[0, 2] = 0.01
    before = np.array([1.0, 1.0, 0.0])
    motion = replace(Motion.steady(rate, np.zeros_like(rate), time, before), axes=axes)
    assert motion.last_turns[0].tolist() == motion.last_turns[79].tolist() == [1.0, 1.0, 0.0]
    assert motion.last_turns[80].tolist() == [-1.0, 1.0, -1.0]
    assert replace(motion, axes=None).last_turns[80].tolist() == [1.0, 1.0, -1.0]
