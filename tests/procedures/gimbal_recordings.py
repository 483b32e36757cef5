"""Recordings of the bench's gimbal: the closed loop of method and gimbal, and its samples as the solver takes them."""

import numpy as np
from hand_recordings import prior_of

from calstation.bench.truth.gimbal import GimbalBench, GimbalSamples
from calstation.bench.truth.grades import draw_imu
from calstation.bench.truth.imu import ImuTruth
from calstation.estimation.common.context import ImuModel, Site, SolveContext, TableModel
from calstation.estimation.common.samples import SampleBlock, joined, snap_angles
from calstation.estimation.gimbal.iteration import GimbalIteration
from calstation.estimation.gimbal.loop import run_loop
from calstation.estimation.method import Solution
from calstation.physics.parameters import group_matrix
from procedures import method

RATE = 100.0
ENCODER = np.deg2rad(0.002)


def unit(seed: int, grade: str = "mems") -> ImuTruth:
    """One unit."""
    return draw_imu(grade, np.random.default_rng(seed), sample_rate=RATE)


class Bench:
    """Adapter of the bench's gimbal to the loop; `corrected`: whether it uses the correction K."""

    def __init__(self, imu: ImuTruth, seed: int, order: str, corrected: bool) -> None:
        self._bench = GimbalBench(imu, seed, order=order, encoder_sigma=ENCODER)
        self._corrected = corrected

    def _used(self, correction: np.ndarray) -> np.ndarray:
        return correction if self._corrected else np.zeros((3, 3))

    def lock(self, seconds: float) -> SampleBlock:
        samples = self._bench.lock(seconds)
        self._bench.zero_bias(samples)
        return block_of([samples])

    def hold(self, seconds: float, correction: np.ndarray) -> SampleBlock:
        return block_of([self._bench.hold(seconds, self._used(correction))])

    def turn(self, axis: int, angle: float, rate: float, correction: np.ndarray) -> SampleBlock:
        return block_of([self._bench.turn(axis, angle, rate, self._used(correction))])

    def home(self, rate: float) -> SampleBlock:
        return block_of([self._bench.home(rate)])


def recorded(
    imu: ImuTruth, seed: int, corrected: bool = True, **schedule: object
) -> tuple[GimbalIteration, SampleBlock]:
    """Method and gimbal in closed loop from locked joints to the last axis."""
    settings = method("gimbal").schedule(**schedule)
    iteration, blocks = settings.iteration(), []
    gimbal = Bench(imu, seed, settings.order, corrected)
    rate = np.deg2rad(settings.rate_dps)
    run_loop(gimbal, iteration, context_of(imu).imu, settings.order, settings.dwell_s, rate, blocks.append)
    return iteration, joined(blocks)


def block_of(parts: list[GimbalSamples]) -> SampleBlock:
    """The samples as one block."""
    seq, time, counts, joints, step = (
        np.concatenate([getattr(p, name) for p in parts]) for name in ("seq", "time", "counts", "joints", "step")
    )
    n = len(seq)
    return SampleBlock(
        "gimbal",
        seq,
        time,
        counts,
        np.full((n, 2), np.nan),
        step,
        np.ones(n, np.bool_),
        np.full(n, np.nan),
        joints=snap_angles(joints),
    )


def context_of(imu: ImuTruth) -> SolveContext:
    """Context with the unit's profile and the gimbal's encoders."""
    profile = ImuModel(
        "G",
        imu.sample_rate,
        imu.output,
        imu.gyro_lsb,
        imu.accel_lsb,
        imu.gyro_arw,
        imu.accel_vrw,
        imu.gyro_bias_instability,
        imu.accel_bias_instability,
    )
    return SolveContext(Site(0.6, 0.0, 0.0, None, 9.8), profile, TableModel(encoder_sigma=ENCODER))


def solved(block: SampleBlock, imu: ImuTruth, grade: str = "mems", **schedule: object) -> Solution:
    """The block as a gimbal stage."""
    chosen = method("gimbal")
    solver = chosen.solver(context_of(imu), prior_of(grade), chosen.schedule(**schedule))
    solver.feed(block)
    return solver.finish()


def misalignment(imu: ImuTruth) -> np.ndarray:
    """M_g off the diagonal, shape (3, 3)."""
    return group_matrix(imu.parameters, "gyro_misalign")
