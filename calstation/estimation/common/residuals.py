"""Residuals at every rest, and compensation of mean outputs.

At rest the magnitude of the specific force equals gravity, and the rate components along it and perpendicular to it
equal the vertical and the horizontal earth rate.
"""

from dataclasses import dataclass

import numpy as np

from calstation.estimation.common.context import ImuModel, Posterior, SolveContext
from calstation.estimation.common.noise import filter_noise, rest_force
from calstation.estimation.common.samples import SampleBlock
from calstation.estimation.common.stage import SHORTEST_REST, StageData, find_rests, mean_angles
from calstation.physics import FloatArray, IntArray, compensate, compensation, rotation_rate

#: Time omitted at the start of a rest, s, because the last microradians of table settling bias the mean rate.
CREEP = 0.5
#: Cosine of the largest angle between up and the one body axis that names a rest, 30°.
_UPWARD = np.cos(np.deg2rad(30.0))


@dataclass(frozen=True)
class RestResiduals:
    """Residuals of k rests, measured minus expected."""

    first_seq: IntArray  #: First sequence number of each rest, shape (k,).
    last_seq: IntArray  #: Last sequence number of each rest, shape (k,).
    up: FloatArray  #: Measured direction of up in b, unit vectors, shape (k, 3).
    angles: FloatArray  #: Mean outer and inner encoder angle, rad, NaN if not polled, shape (k, 2).
    force: FloatArray  #: Magnitude of the specific force minus gravity, m/s², shape (k,).
    vertical_rate: FloatArray  #: Residual of the rate along up, rad/s, shape (k,).
    horizontal_rate: FloatArray  #: Residual of the rate perpendicular to up, rad/s, shape (k,).
    force_sigma: FloatArray  #: Sigma of the force expected from the noise, m/s², shape (k,).
    rate_sigma: FloatArray  #: Sigma of the rate expected from the noise, rad/s, shape (k,).

    def __len__(self) -> int:
        return len(self.first_seq)

    def axis(self, rest: int) -> str:
        """Return the body axis that is up at a rest, see `upward_axis`."""
        return upward_axis(self.up[rest])

    def in_sigma(self, rest: int) -> tuple[float, float, float]:
        """Return the residuals of force, vertical and horizontal rate of a rest, in sigmas."""
        force, rate = self.force_sigma[rest], self.rate_sigma[rest]
        values = self.force[rest] / force, self.vertical_rate[rest] / rate, self.horizontal_rate[rest] / rate
        return float(values[0]), float(values[1]), float(values[2])


def upward_axis(up: FloatArray) -> str:
    """Return the signed body axis within 30° of `up`, such as "-z", or the axes on either side of it, such as "+x+y".

    `up` is a unit vector in b, shape (3,).
    """
    size = np.abs(up)
    named = [int(np.argmax(size))] if size.max() > _UPWARD else np.flatnonzero(size > 0.5 * size.max())
    return "".join(("+" if up[axis] > 0.0 else "-") + "xyz"[axis] for axis in named)


def rest_residuals(data: StageData, context: SolveContext, posterior: Posterior) -> RestResiduals:
    """Compute the residuals of every rest of a stage, compensated with the parameters `posterior`."""
    constants = compensation(posterior.mean)
    earth = rotation_rate(context.site.latitude)
    gravity, noise = context.site.local_gravity, filter_noise(context)
    rows: list[tuple[float, ...]] = []
    seqs: list[tuple[int, int]] = []
    for begin, b in find_rests(data, context.imu, posterior.gyro_bias):
        a = begin + round(CREEP / data.dt)
        duration = (b - a) * data.dt
        if duration < SHORTEST_REST:
            continue
        mean_force, variance = rest_force(data, context, a, b)
        omega, force = compensate(constants, data.gyro[a:b].mean(axis=0, keepdims=True), mean_force[None])
        length = float(np.linalg.norm(force))
        up = force[0] / length
        along = float(omega[0] @ up)
        across = float(np.linalg.norm(omega[0] - along * up))
        angles = mean_angles(data, a, b)
        seqs.append((int(data.seq[a]), int(data.seq[b - 1])))
        rows.append(
            (
                *up,
                *(angles if angles is not None else (np.nan, np.nan)),
                length - gravity,
                along - earth[2],
                across - float(np.hypot(earth[0], earth[1])),
                float(np.sqrt(variance)),
                float(np.sqrt(noise.rate / duration + noise.bias_drift[0] ** 2)),
            )
        )
    table = np.array(rows).reshape(-1, 10)
    seq = np.array(seqs, dtype=np.int64).reshape(-1, 2)
    return RestResiduals(seq[:, 0], seq[:, 1], table[:, :3], table[:, 3:5], *table[:, 5:].T)


def compensated_means(
    block: SampleBlock, imu: ImuModel, parameters: FloatArray, stride: int
) -> tuple[FloatArray, FloatArray]:
    """Return rate, rad/s, and specific force, m/s², of the means of groups of `stride` samples, shape (n, 3) each.

    `parameters` are the parameters of the compensation, SI, shape (30,); an incomplete last group is omitted.
    """
    count = len(block) // stride
    raw = (block.counts[: count * stride] * imu.count_size).reshape(count, stride, 6).mean(axis=1)
    return compensate(compensation(parameters), raw[:, :3], raw[:, 3:])
