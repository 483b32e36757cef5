"""A result applied to data as they come: what the unit says before it and after."""

from dataclasses import dataclass

import numpy as np

from calstation.estimation.common.context import ImuModel
from calstation.estimation.common.samples import SampleBlock
from calstation.physics.arrays import FloatArray
from calstation.physics.imu_model import compensate, compensation


@dataclass(frozen=True)
class BeforeAfter:
    """The same samples with the parameters before and with those found, each shape (n, 3).

    rate_before, rate_after : rad/s; force_before, force_after : m/s²
    length_before, length_after : of the force less gravity, m/s², shape (n,): at rest nothing else is left
    """

    time: FloatArray
    rate_before: FloatArray
    rate_after: FloatArray
    force_before: FloatArray
    force_after: FloatArray
    length_before: FloatArray
    length_after: FloatArray


def before_after(
    block: SampleBlock, imu: ImuModel, before: FloatArray, found: FloatArray, gravity: float, stride: int = 1
) -> BeforeAfter:
    """Apply parameters (SI, shape (30,)) to a block, averaged over `stride` samples first.

    gravity : m/s²
    """
    per_count = imu.sample_rate if imu.output == "increment" else 1.0
    scale = np.repeat([imu.gyro_lsb, imu.accel_lsb], 3) * per_count
    count = len(block) // stride
    raw = (block.counts[: count * stride] * scale).reshape(count, stride, 6).mean(axis=1)
    rates, forces, lengths = [], [], []
    for parameters in (before, found):
        omega, force = compensate(compensation(parameters), raw[:, :3], raw[:, 3:])
        rates.append(omega)
        forces.append(force)
        lengths.append(np.linalg.norm(force, axis=1) - gravity)
    time = block.time[: count * stride].reshape(count, stride).mean(axis=1)
    return BeforeAfter(time, *rates, *forces, *lengths)
