"""Closed loop of method and stabilised gimbal: turn one axis, read the joints, correct K, and so on; then the next."""

from collections.abc import Callable
from typing import Protocol

from calstation.errors import InputError
from calstation.estimation.common import ImuModel, SampleBlock, stage_data
from calstation.estimation.gimbal.iteration import GimbalIteration
from calstation.estimation.gimbal.motions import Motion, find_motions
from calstation.physics import AXES, FloatArray


class Gimbal(Protocol):
    """A gimbal that stabilises on the corrected rates of the unit; every call returns the samples recorded."""

    def lock(self, seconds: float) -> SampleBlock:
        """Lock the joints; the gyro output during this time is taken as the gyro bias."""

    def hold(self, seconds: float, correction: FloatArray) -> SampleBlock:
        """Stabilise at rest with the correction K, shape (3, 3)."""

    def turn(self, axis: int, angle: float, rate: float, correction: FloatArray) -> SampleBlock:
        """Turn about one body axis by `angle`, rad, at `rate`, rad/s, with the other axes stabilised."""

    def home(self, rate: float) -> SampleBlock:
        """Return all joints to zero."""


def run_loop(
    gimbal: Gimbal,
    iteration: GimbalIteration,
    imu: ImuModel,
    order: str,
    dwell: float,
    rate: float,
    keep: Callable[[SampleBlock], None],
) -> None:
    """Run the iteration to its end; `keep` is called with every block, so that a log of them reproduces the run.

    `dwell` is the duration of a stabilised rest, s, `rate` the rate of the turns, rad/s. Raises InputError if a turn is
    not found in the joint angles.
    """
    blocks: list[SampleBlock] = []

    def take(block: SampleBlock) -> None:
        blocks.append(block)
        keep(block)

    take(gimbal.lock(dwell + 2.0))
    take(gimbal.hold(dwell, iteration.correction))
    while (turn := iteration.next_turn()) is not None:
        if turn.home:
            take(gimbal.home(rate))
            take(gimbal.hold(dwell, turn.correction))
            iteration.at_zero()
        begin = int(blocks[-1].seq[-1])
        take(gimbal.turn(turn.axis, turn.angle, rate, turn.correction))
        take(gimbal.hold(dwell, turn.correction))
        motion = turned_motion(blocks, imu, begin, turn.axis)
        iteration.add_drift(turn.axis, turn.angle, motion.joint_drift(order))
    take(gimbal.home(rate))
    take(gimbal.hold(dwell, iteration.correction))


def turned_motion(blocks: list[SampleBlock], imu: ImuModel, begin: int, axis: int) -> Motion:
    """Return the only motion after sequence number `begin`, which must be a turn about `axis`. Raises InputError."""
    data = stage_data(blocks, imu)
    motions = [m for m in find_motions(data, imu) if data.seq[m.stop - 1] > begin]
    if len(motions) != 1 or motions[0].axis != axis:
        raise InputError("recording.joint_turn_not_seen", axis=AXES[axis])
    return motions[0]
