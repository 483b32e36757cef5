"""A stage with targets ends only when the sigmas of its solution, with the effects in the model, are within them."""

from pathlib import Path

import numpy as np
import pytest

from calstation.bench import BenchConfig
from calstation.bench.truth import Simulator
from calstation.config import RunRequest, load_configuration
from calstation.estimation.common import SampleBlock
from calstation.physics import INDEX, FloatArray, targets_reached
from calstation.records import LogMeta
from calstation.results import StageChain
from calstation.simulation import bench_config
from calstation.simulation.study import block_of, feed_until_targets
from procedures import method
from tests.outside.sweep import Case, bench_settings

STAGE, LEVER = "designed", INDEX["outer_lever_x"]


@pytest.fixture(scope="module")
def recorded() -> tuple[LogMeta, SampleBlock]:
    """A designed stage of a MEMS unit on a table whose axes may be 20 mm apart."""
    resolved = load_configuration(RunRequest("SN-000001", product=Path("data/products/mems_c_fast.toml")))
    meta = resolved.log_meta()
    meta = meta.model_copy(update={"table": meta.table.model_copy(update={"axis_offset_sigma_mm": 20.0})})
    config = BenchConfig.model_validate(bench_settings(Case(seed=2), bench_config(resolved) or {}))
    plan = method(STAGE).plan(resolved.table.geometry(), resolved.schedules[STAGE])
    return meta, block_of(Simulator(config.truth(), 2).run(plan, STAGE))


def started(meta: LogMeta, target: float) -> StageChain:
    """Return a chain with the started stage, which ends when the sigma of a lever arm reaches its target, m."""
    settings = meta.schedule[STAGE] | {"targets": {"outer_lever_x": target}, "least_moves": 1}
    chain = StageChain(meta.model_copy(update={"schedule": {STAGE: settings}}))
    chain.start(STAGE)
    return chain


def solved_after(recorded: tuple[LogMeta, SampleBlock], move: int, target: float) -> tuple[FloatArray, FloatArray]:
    """Return the sigmas during the stage and of its solution after a move, shape (30,) each."""
    meta, block = recorded
    chain = started(meta, target)
    chain.feed(block.part(0, int(np.flatnonzero(np.diff(block.step))[move - 1]) + 1))
    return chain.sigma(), chain.finish().posterior.sigma


@pytest.mark.parametrize("move", [3, 7])
def test_sigmas_within_the_targets_are_those_of_the_solution(recorded: tuple[LogMeta, SampleBlock], move: int) -> None:
    near, final = solved_after(recorded, move, 1.0)
    assert near == pytest.approx(final, rel=0.01)


def test_stage_ends_with_sigmas_within_its_targets(recorded: tuple[LogMeta, SampleBlock]) -> None:
    far, final = solved_after(recorded, 7, 1e-9)
    target = 0.995 * float(final[LEVER])
    assert far[LEVER] < target
    meta, block = recorded
    chain = started(meta, target)
    schedule = method(STAGE).schedule(targets={"outer_lever_x": target}, least_moves=1)
    fed = feed_until_targets(chain, block, schedule)
    assert fed.step[-1] == 8
    assert targets_reached(chain.finish().posterior.sigma, schedule.targets)


def test_stage_does_not_end_before_its_first_rest(recorded: tuple[LogMeta, SampleBlock]) -> None:
    meta, block = recorded
    chain = started(meta, 1.0)
    assert np.isinf(chain.sigma()).all()
    chain.feed(block.part(0, 50))
    assert np.isinf(chain.sigma()).all(), "no solution is possible yet"
    chain.feed(block.part(50, int(np.flatnonzero(np.diff(block.step))[0]) + 1))
    assert targets_reached(chain.sigma(), {"outer_lever_x": 1.0})
    assert np.isfinite(chain.finish().posterior.sigma).all()
