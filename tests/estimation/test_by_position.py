"""Residuals per rest and move contain only noise without an effect; a rest or move with an effect is reported."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from simulated_stages import block_of, context_of, prior_of, simulate, solved

from calstation.bench import BenchConfig
from calstation.bench.truth import Simulator
from calstation.estimation import Solution, stage_residuals
from calstation.estimation.common import (
    PositionResidual,
    SampleBlock,
    StageResiduals,
    rest_residuals,
    stage_data,
)
from calstation.estimation.common.by_position import normal_deviate
from calstation.estimation.common.residuals import upward_axis
from calstation.judgement import Check
from calstation.messages import sentence
from calstation.physics import INDEX


class Stage:
    """An excitation of a navigation-grade unit to which effects are added."""

    def __init__(self) -> None:
        self.truth = BenchConfig(grade="nav", seed=3, sample_rate_hz=50.0).truth()
        self.context, self.prior = context_of(self.truth), prior_of(self.truth)
        self.block = block_of(simulate(Simulator(self.truth, 3), self.truth, "excitation"))
        self.sound = self.residuals(self.solved(self.block))

    def solved(self, block: SampleBlock) -> Solution:
        """Return the solution of the stage."""
        return solved(self.truth, self.prior, [block])

    def residuals(self, solution: Solution) -> StageResiduals:
        """Return its residuals per rest and move."""
        data = stage_data([self.block], self.context.imu)
        return stage_residuals(solution, data, rest_residuals(data, self.context, solution.posterior))

    def row(self, kind: str, number: int) -> PositionResidual:
        """Return a rest or move of the stage without an effect."""
        return next(row for row in self.sound.rows if (row.kind, row.number) == (kind, number))

    def with_effect(self, row: PositionResidual, added: np.ndarray) -> SampleBlock:
        """Return the samples with an added error, SI, shape (6,) or (n, 6), during a rest or move."""
        counts = self.block.counts.copy()
        during = (self.block.seq >= row.first_seq) & (self.block.seq <= row.last_seq)
        counts[during] += added[: during.sum()] / self.context.imu.count_size
        return replace(self.block, counts=counts)


@pytest.fixture(scope="module")
def stage() -> Stage:
    """The stage without an effect."""
    return Stage()


def cause(stage: Stage, solution: Solution) -> str:
    """Return the explanation of the failed innovation test."""
    c = solution.consistency
    check = Check("consistency", "excitation", c.nis_mean, c.nis_high, "1", c.passed, diagnosis=solution.diagnosis)
    text = Check.from_json(check.to_json()).cause_text
    assert text is not None
    assert sentence(text, "zh_CN")
    return sentence(text)


@pytest.mark.long
def test_residuals_of_every_rest_and_move_are_noise_without_an_effect(stage: Stage) -> None:
    rows = stage.sound.rows
    assert [row.kind for row in rows[:4]] == ["rest", "move", "rest", "move"]
    assert [row.axis for row in rows[:6]] == ["+z", "inner", "+z", "outer", "-x", "outer"]
    assert np.rad2deg(rows[3].turned) == pytest.approx(90.0, abs=0.3)
    assert {row.state for row in rows} == {"good"}
    assert len(stage.sound.rows) == 63
    errors = [row.error / row.error_sigma for row in rows]
    assert np.abs(errors).max() < 4.0


def test_force_error_in_one_rest_is_reported_with_its_size(stage: Stage) -> None:
    row = stage.row("rest", 4)
    solution = stage.solved(stage.with_effect(row, np.array([0.0, 0.0, 0.0, 3e-3, 0.0, 0.0])))
    assert solution.diagnosis is not None
    assert solution.diagnosis.cause == "excess_shift"
    assert solution.diagnosis.size == pytest.approx(3e-3, abs=4.0 * solution.diagnosis.sigma)
    change = (solution.posterior.mean - stage.solved(stage.block).posterior.mean) / solution.posterior.sigma
    shift = solution.diagnosis.parameter_shift
    assert [change[INDEX[name]] for name in shift] == pytest.approx(list(shift.values()), rel=0.2, abs=1.0)
    assert max(map(abs, shift.values())) > 3.0
    text = cause(stage, solution)
    assert "comes from rest 4 (-z up, outer 1" in text
    assert "the accelerometer x deviates by 3" in text
    worst = max(stage.residuals(solution).rows, key=lambda r: r.worst)
    assert (worst.kind, worst.number, worst.state) == ("rest", 4, "bad")


@pytest.mark.long
def test_vibration_burst_in_one_move_is_reported(stage: Stage) -> None:
    row = stage.row("move", 5)
    noise = np.random.default_rng(1).normal(size=(len(stage.block), 6)) * [0, 0, 0, 0.05, 0.05, 0.05]
    solution = stage.solved(stage.with_effect(row, noise))
    assert "scatter in move 5 (outer +90." in cause(stage, solution)


@pytest.mark.long
def test_shocks_throughout_the_stage_are_noise_of_the_table(stage: Stage) -> None:
    random, force = np.random.default_rng(1), np.zeros((len(stage.block), 6))
    for begin in range(0, len(force) - 50, 150):  # a knock, there and back, every 3 s
        knock = 0.1 * random.normal(size=3)
        force[begin : begin + 5, 3:] += knock
        force[begin + 10 : begin + 15, 3:] -= knock
    counts = stage.block.counts + force / stage.context.imu.count_size
    solution = stage.solved(replace(stage.block, counts=counts))
    assert solution.diagnosis is None
    assert next(test.value for test in solution.tests if test.kind == "table_noise") > 1.1


def test_normal_deviate_has_the_probability_of_its_chi_squared_sum() -> None:
    for freedom in (3, 30, 300):
        for deviate in (-2.0, 0.0, 3.0, 5.0):
            total = stats.chi2.isf(stats.norm.sf(deviate), freedom)
            assert normal_deviate(float(total), freedom) == pytest.approx(deviate, abs=0.25)


@pytest.mark.parametrize(
    ("up", "name"), [((0.0, 0.1, 0.99), "+z"), ((-1.0, 0.0, 0.0), "-x"), ((0.6, 0.6, -0.5), "+x+y-z")]
)
def test_rest_is_named_by_its_upward_axes(up: tuple[float, float, float], name: str) -> None:
    assert upward_axis(np.array(up)) == name
