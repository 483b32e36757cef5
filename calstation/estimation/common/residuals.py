"""A result applied to data: output compensated before and after, and residuals at every rest.

At rest the specific force is as long as gravity, the rate along it is the earth's vertical and that across it the
earth's horizontal rate.
"""

from dataclasses import dataclass

import numpy as np

from calstation.estimation.common.context import Belief, ImuModel, SolveContext
from calstation.estimation.common.noise import filter_noise, rest_mean_variance
from calstation.estimation.common.samples import SampleBlock
from calstation.estimation.common.stage import StageData, find_rests, mean_angles, slope_weights
from calstation.physics import FloatArray, IntArray, compensate, compensation, group_indices, rotation_rate

#: A shorter rest, s, is a pause in a turn and not a position.
SHORTEST_REST = 1.0
#: Left out at the start of a rest, s: the last microradians of a settling table distort a mean rate.
CREEP = 0.5


@dataclass(frozen=True)
class RestResiduals:
    """Residuals of k rests, measured less expected."""

    first_seq: IntArray  #: Of each rest, shape (k,).
    last_seq: IntArray  #: Of each rest, shape (k,).
    up: FloatArray  #: Measured direction of up in b, unit vectors, shape (k, 3).
    angles: FloatArray  #: Mean encoder angles outer, inner, rad, NaN without polls, shape (k, 2).
    force: FloatArray  #: Length of the specific force less gravity, m/s², shape (k,).
    vertical_rate: FloatArray  #: Rate along up, rad/s, shape (k,).
    horizontal_rate: FloatArray  #: Rate across up, rad/s, shape (k,).
    force_sigma: FloatArray  #: Expected from the noise of the rest, m/s², shape (k,).
    rate_sigma: FloatArray  #: Expected from the noise of the rest, rad/s, shape (k,).

    def __len__(self) -> int:
        return len(self.first_seq)


def rest_residuals(data: StageData, context: SolveContext, found: Belief) -> RestResiduals:
    """Residuals of every rest of a stage, compensated with the parameters `found`."""
    constants = compensation(found.mean)
    bias = group_indices("gyro_bias")
    earth = rotation_rate(context.site.latitude)
    gravity, noise = context.site.local_gravity, filter_noise(context)
    stride = max(round(noise.interval / data.dt), 1)
    rows: list[tuple[float, ...]] = []
    seqs: list[tuple[int, int]] = []
    for segment in data.segments:
        found_rests = find_rests(data, segment, context.imu, found.mean[bias], float(found.sigma[bias].max()))
        for begin, b in found_rests:
            a = begin + round(CREEP / data.dt)
            duration = (b - a) * data.dt
            if duration < SHORTEST_REST:
                continue
            omega, force = compensate(
                constants,
                data.gyro[a:b].mean(axis=0, keepdims=True),
                (slope_weights(b - a, stride) @ data.accel[a:b])[None],
            )
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
                    float(np.sqrt(rest_mean_variance(context, duration))),
                    float(np.sqrt(noise.rate / duration + noise.bias_drift[0] ** 2)),
                )
            )
    table = np.array(rows).reshape(-1, 10)
    seq = np.array(seqs, dtype=np.int64).reshape(-1, 2)
    return RestResiduals(seq[:, 0], seq[:, 1], table[:, :3], table[:, 3:5], *table[:, 5:].T)


@dataclass(frozen=True)
class BeforeAfter:
    """The same n samples compensated with the parameters before and with those found."""

    time: FloatArray  #: s, shape (n,)
    rate_before: FloatArray  #: rad/s, shape (n, 3)
    rate_after: FloatArray  #: rad/s, shape (n, 3)
    force_before: FloatArray  #: m/s², shape (n, 3)
    force_after: FloatArray  #: m/s², shape (n, 3)
    length_before: FloatArray  #: Length of the force less gravity, m/s², shape (n,); at rest only the error is left.
    length_after: FloatArray  #: The same with the parameters found.


def before_after(
    block: SampleBlock, imu: ImuModel, before: FloatArray, found: FloatArray, gravity: float, stride: int = 1
) -> BeforeAfter:
    """Compensate a block with two sets of parameters, SI, shape (30,), after averaging `stride` samples at a time."""
    count = len(block) // stride
    raw = (block.counts[: count * stride] * imu.count_size).reshape(count, stride, 6).mean(axis=1)
    rates, forces, lengths = [], [], []
    for parameters in (before, found):
        omega, force = compensate(compensation(parameters), raw[:, :3], raw[:, 3:])
        rates.append(omega)
        forces.append(force)
        lengths.append(np.linalg.norm(force, axis=1) - gravity)
    time = block.time[: count * stride].reshape(count, stride).mean(axis=1)
    return BeforeAfter(time, *rates, *forces, *lengths)
