"""The closed loop of the method and a stabilised gimbal: demand a turn, look at the joints, correct, go back."""

from collections.abc import Callable
from typing import Protocol

from calstation.errors import InputError
from calstation.estimation.common.context import ImuModel
from calstation.estimation.common.samples import SampleBlock
from calstation.estimation.common.stage_data import stage_data
from calstation.estimation.gimbal.iteration import GimbalIteration
from calstation.estimation.gimbal.motions import Motion, find_motions
from calstation.physics.arrays import FloatArray


class Gimbal(Protocol):
    """A gimbal that stabilises on the unit's corrected rates. Every call returns the samples that passed meanwhile."""

    def lock(self, seconds: float) -> SampleBlock:
        """Hold the joints; what the gyros show then is taken for their bias."""

    def hold(self, seconds: float, correction: FloatArray) -> SampleBlock:
        """Stabilise at rest with the correction K, shape (3, 3)."""

    def turn(self, axis: int, angle: float, rate: float, correction: FloatArray) -> SampleBlock:
        """Turn about one body axis by `angle`, rad, at `rate`, rad/s, the others stabilised."""

    def home(self, rate: float) -> SampleBlock:
        """Bring all joints to zero."""


def run_loop(
    gimbal: Gimbal,
    iteration: GimbalIteration,
    imu: ImuModel,
    order: str,
    dwell: float,
    rate: float,
    keep: Callable[[SampleBlock], None],
) -> None:
    """Run the iteration to its end; `keep` gets every block. A log of them replays to the same corrections.

    Raises InputError where a turn does not show in the joints.
    """
    blocks: list[SampleBlock] = []

    def take(block: SampleBlock) -> None:
        blocks.append(block)
        keep(block)

    take(gimbal.lock(dwell + 2.0))
    while (demand := iteration.demand()) is not None:
        take(gimbal.hold(dwell, demand.correction))
        take(gimbal.turn(demand.axis, demand.angle, rate, demand.correction))
        take(gimbal.hold(dwell, demand.correction))
        turns = [m for m in find_motions(stage_data(blocks, imu), imu) if m.axis is not None]
        iteration.answer(demand.angle, _newest(turns, iteration, demand.axis).lean(order))
        take(gimbal.home(rate))
    take(gimbal.hold(dwell, iteration.correction))


def _newest(turns: list[Motion], iteration: GimbalIteration, axis: int) -> Motion:
    answered = sum(len(course.drifts) for course in iteration.courses)
    if len(turns) != answered + 1 or turns[-1].axis != axis:
        raise InputError(
            f"turn {answered + 1} about {'xyz'[axis]} does not show in the joints; check that they are at zero before "
            "it, and their columns"
        )
    return turns[-1]
