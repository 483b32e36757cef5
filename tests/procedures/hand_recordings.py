"""Recordings of the simulated manual rig, with context and prior of the unit."""

import numpy as np

from calstation.bench.truth import GRADES, ImuTruth, ManualRig, Simulated, around, draw_imu, record
from calstation.estimation import Solution
from calstation.estimation.common import Posterior, SampleBlock, Site, SolveContext, TableModel
from calstation.physics import COUNT, PARAMETERS
from procedures import method
from tests.imu_models import imu_model

QUICK = ManualRig(initial_rest=10.0, rest=3.0)
STEP = np.deg2rad(60.0)


def unit(grade: str, seed: int, **options: object) -> ImuTruth:
    """Return one unit at 100 Hz."""
    return draw_imu(grade, np.random.default_rng(seed), sample_rate=100.0, **options)


def context_of(imu: ImuTruth, rig: ManualRig = QUICK) -> SolveContext:
    """Return the context with site and profile of the unit, without a table."""
    return SolveContext(
        Site(rig.latitude, 0.0, rig.height, None, rig.gravity),
        imu_model(imu),
        TableModel(),
    )


def prior_of(grade: str, factor: float = 2.0) -> Posterior:
    """Return a prior with zero mean and `factor` times the sigmas of the grade."""
    sigma = factor * np.array([GRADES[grade].sigma[p.group] for p in PARAMETERS])
    return Posterior(np.zeros(COUNT), np.diag(sigma**2))


def block_of(samples: Simulated) -> SampleBlock:
    """Return the samples as one block without table angles."""
    valid = np.ones(len(samples.seq), dtype=bool)
    return SampleBlock(
        samples.stage,
        samples.seq,
        samples.time,
        samples.counts,
        samples.angles,
        samples.step,
        valid,
        samples.temperature,
    )


def recording(imu: ImuTruth, seed: int, rig: ManualRig = QUICK, step: float = STEP) -> SampleBlock:
    """Return the recording of a unit moved once through all positions."""
    return block_of(record(imu, rig, around(step), seed)[0])


def solved(block: SampleBlock, context: SolveContext, prior: Posterior, **schedule: object) -> Solution:
    """Solve the block as a multi_position stage."""
    chosen = method("multi_position")
    solver = chosen.solver(context, prior, chosen.schedule(**schedule))
    solver.feed(block)
    return solver.finish()
