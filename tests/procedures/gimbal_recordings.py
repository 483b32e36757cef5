"""Recordings of the simulated gimbal in closed loop with the method, which are input for the solver."""

import numpy as np
from hand_recordings import prior_of

from calstation.bench.truth import GimbalBench, GimbalSamples, ImuTruth, draw_imu
from calstation.estimation import Solution
from calstation.estimation.common import SampleBlock, Site, SolveContext, TableModel, join_blocks
from calstation.estimation.gimbal import GimbalIteration
from calstation.physics import group_matrix
from calstation.simulation.bench_recordings import run_gimbal
from procedures import method
from tests.imu_models import imu_model

RATE = 100.0
ENCODER = np.deg2rad(0.002)


def unit(seed: int, grade: str = "mems") -> ImuTruth:
    """Return one unit."""
    return draw_imu(grade, np.random.default_rng(seed), sample_rate=RATE)


class Uncorrected(GimbalBench):
    """A gimbal that ignores the correction K."""

    def hold(self, seconds: float, correction: np.ndarray) -> GimbalSamples:
        return super().hold(seconds, np.zeros((3, 3)))

    def turn(self, axis: int, angle: float, rate: float, correction: np.ndarray) -> GimbalSamples:
        return super().turn(axis, angle, rate, np.zeros((3, 3)))


def recorded(
    imu: ImuTruth, seed: int, corrected: bool = True, **schedule: object
) -> tuple[GimbalIteration, SampleBlock]:
    """Run the method and the gimbal in closed loop, from locked joints to the last axis."""
    settings, blocks = method("gimbal").schedule(**schedule), []
    gimbal = (GimbalBench if corrected else Uncorrected)(imu, seed, order=settings.order, encoder_sigma=ENCODER)
    iteration = run_gimbal(gimbal, settings, context_of(imu).imu, blocks.append)
    return iteration, join_blocks(blocks)


def context_of(imu: ImuTruth) -> SolveContext:
    """Return the context with the profile of the unit and the encoders of the gimbal."""
    return SolveContext(Site(0.6, 0.0, 0.0, None, 9.8), imu_model(imu), TableModel(encoder_sigma=ENCODER))


def solved(block: SampleBlock, imu: ImuTruth, grade: str = "mems", **schedule: object) -> Solution:
    """Solve the block as a gimbal stage."""
    chosen = method("gimbal")
    solver = chosen.solver(context_of(imu), prior_of(grade), chosen.schedule(**schedule))
    solver.feed(block)
    return solver.finish()


def misalignment(imu: ImuTruth) -> np.ndarray:
    """Return the off-diagonal part of M_g, shape (3, 3)."""
    return group_matrix(imu.parameters, "gyro_misalign")
