"""Output compensated with the parameters before and after calibration, and the residuals at every rest and move.

At rest the magnitude of the specific force equals gravity; the rate components along it and perpendicular to it are
the vertical and horizontal earth rate.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from calstation.estimation.common.context import Belief, ImuModel, SolveContext
from calstation.estimation.common.noise import filter_noise, rest_mean_variance
from calstation.estimation.common.samples import SampleBlock
from calstation.estimation.common.stage import StageData, find_rests, mean_angles, slope_weights
from calstation.messages import Text
from calstation.physics import FloatArray, IntArray, compensate, compensation, group_indices, rotation_rate

#: A rest shorter than this, s, is a pause during a rotation and not a position.
SHORTEST_REST = 1.0
#: Time omitted at the start of a rest, s, because the last microradians of table settling bias the mean rate.
CREEP = 0.5
#: A smaller rotation, rad, is no move; earth rate is 0.25° per minute.
SMALLEST_MOVE = np.deg2rad(1.0)
#: Cosine of 30°; a rest is named after the body axis within this angle of up.
_UPWARD = np.cos(np.deg2rad(30.0))
#: Names of the joints in a residual.
_JOINTS = ("outer", "inner")
#: Names of the channels.
CHANNELS = tuple(f"{sensor}_{axis}" for sensor in ("gyro", "accel") for axis in "xyz")


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

    def in_sigma(self, rest: int) -> tuple[float, float, float]:
        """Return the residuals of force, vertical and horizontal rate of a rest, in sigmas."""
        force, rate = self.force_sigma[rest], self.rate_sigma[rest]
        values = self.force[rest] / force, self.vertical_rate[rest] / rate, self.horizontal_rate[rest] / rate
        return float(values[0]), float(values[1]), float(values[2])


def rest_residuals(data: StageData, context: SolveContext, found: Belief) -> RestResiduals:
    """Compute the residuals of every rest of a stage, compensated with the parameters `found`."""
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


def upward_axis(up: FloatArray) -> str:
    """Return the signed body axis within 30° of `up`, such as "-z", or else those it lies between, such as "+x+y".

    `up` is a unit vector in b, shape (3,).
    """
    size = np.abs(up)
    named = [int(np.argmax(size))] if size.max() > _UPWARD else np.flatnonzero(size > 0.5 * size.max())
    return "".join(("+" if up[axis] > 0.0 else "-") + "xyz"[axis] for axis in named)


@dataclass(frozen=True)
class LocalScores:
    """Score tests of constant errors of the channels, gyro x y z and accel x y z, each during one of k spans.

    With an error θ the sum of the squares of the innovations decreases by 2 θᵀ score − θᵀ information θ.
    """

    score: FloatArray  #: SI, shape (6 k,).
    information: FloatArray  #: SI, shape (6 k, 6 k).
    shift: FloatArray  #: Shift of the 30 parameters per unit of each error, SI, shape (30, 6 k).

    def explained(self, spans: Sequence[int]) -> float:
        """Return by how much free errors during these spans decrease the sum of squares."""
        i = np.add.outer(6 * np.asarray(spans), np.arange(6)).ravel()
        return float(self.score[i] @ np.linalg.pinv(self.information[np.ix_(i, i)], hermitian=True) @ self.score[i])

    def single(self, spans: Sequence[int], signs: FloatArray) -> tuple[int, FloatArray, FloatArray]:
        """Return the most significant channel with one common error during some spans; errors and sigmas of all, SI.

        The error changes its sign with `signs` of the spans, shape (n,). Errors and sigmas have shape (6,).
        """
        step = np.zeros((len(self.score), 6))
        for span, sign in zip(spans, signs, strict=True):
            step[6 * span : 6 * span + 6] += sign * np.eye(6)
        information = np.einsum("ki,kl,li->i", step, self.information, step)
        sigma = 1.0 / np.sqrt(np.maximum(information, np.finfo(float).tiny))
        error = (self.score @ step) * sigma**2
        return int(np.argmax(np.abs(error) / sigma)), error, sigma


#: Function that makes the score tests for spans (start, stop) of a stage's samples, in their order.
ScoreFunction = Callable[[StageData, Sequence[tuple[int, int]]], LocalScores]


@dataclass(frozen=True)
class PositionResidual:
    """Residuals of one rest or one move of a stage, in sigmas; NaN where there is nothing to test."""

    kind: Literal["rest", "move"]
    number: int  #: Number of the rest, or of the move, within the stage, from 1.
    step: int  #: As in `SampleBlock`, at its end.
    first_seq: int
    last_seq: int
    duration: float  #: s
    #: At rest the axis that is up, see `upward_axis`; of a move ``outer``, ``inner`` or ``outer+inner``, or the body
    #: axis (``x``) without encoders.
    axis: str
    turned: float  #: Rotation of a move about its axis, rad; 0 at rest.
    angles: tuple[float, float]  #: Outer and inner encoder angle at the end, rad, NaN without encoders.
    freedom: int  #: Number of innovation components.
    total: float  #: Sum of their squares.
    #: `total` against its distribution: the standard normal deviate that is exceeded with the same probability.
    excess: float
    component: int  #: Component with the largest mean: 0, 1 or 2.
    mean: float  #: Mean of that component, in sigmas of the mean.
    channel: int | None  #: Channel with the most significant error here, 0 to 5 (gyro x y z, accel x y z).
    error: float  #: Constant error of that channel that fits all innovations best, rad/s or m/s².
    error_sigma: float  #: Sigma of `error`.
    force: float  #: Magnitude of the specific force minus gravity.
    vertical_rate: float  #: Rate along up minus the vertical earth rate.
    horizontal_rate: float  #: Rate perpendicular to up minus the horizontal earth rate.

    @property
    def worst(self) -> float:
        """Largest test of this rest or move by the innovations, sigmas: of an error that belongs to it, if possible."""
        local = self.mean if self.channel is None else self.error / self.error_sigma
        return float(np.fmax(self.excess, abs(local)))

    @property
    def text(self) -> Text:
        """Name of the rest or move: its number, axis and angles."""
        outer, inner, turned = np.rad2deg([*self.angles, self.turned]).tolist()
        code = f"residual.{self.kind}" if np.isnan(outer) else f"residual.{self.kind}_at"
        return Text(code, {"number": self.number, **self.axis_values, "outer": outer, "inner": inner, "turned": turned})

    @property
    def axis_values(self) -> dict[str, Any]:
        """Value `axis` of messages."""
        return {"axis": self.axis if self.kind == "rest" else self.axis.split("+")}

    def to_json(self) -> dict[str, Any]:
        """Return the row as JSON values; null for NaN."""
        row = {key: None if value != value else value for key, value in vars(self).items()}
        angles = [None if value != value else value for value in self.angles]
        return {**row, "angles": angles, "channel": None if self.channel is None else CHANNELS[self.channel]}


@dataclass(frozen=True)
class StageResiduals:
    """Residuals of a stage per rest and move, in the order of the data."""

    rows: tuple[PositionResidual, ...] = ()
    scores: LocalScores | None = None  #: Score tests of the rows; None for a stage without the 39-state filter.


def position_residuals(
    data: StageData,
    rests: RestResiduals,
    found: Belief,
    seq: IntArray,
    normalised: FloatArray,
    *,
    white: bool,
    score: ScoreFunction | None,
) -> StageResiduals:
    """Aggregate the innovations of a stage per rest and move.

    Parameters
    ----------
    rests : residuals of the stage's rests, with the parameters `found`
    seq, normalised : as in `Innovations`
    white : whether the components are independent; if not, `excess` is the largest component instead of their sum
    score : makes the score tests; None for a stage without the 39-state filter
    """
    spans = _spans(data, rests, found)
    scores = None if score is None else score(data, [(start, stop) for start, stop, _ in spans])
    stops = np.array([data.seq[stop - 1] for _, stop, _ in spans], dtype=np.int64)
    owner = np.searchsorted(stops, seq)
    rows: list[PositionResidual] = []
    for index, (start, stop, rest) in enumerate(spans):
        z = normalised[owner == index]
        count = np.sum(np.isfinite(z), axis=0)
        means = np.nansum(z, axis=0) / np.sqrt(np.maximum(count, 1))
        freedom, total = int(count.sum()), float(np.nansum(z**2))
        component = int(np.argmax(np.abs(means)))
        channel, errors, sigmas = (None, *np.full((2, 1), np.nan)) if scores is None else scores.single([index], np.ones(1))
        kind: Literal["rest", "move"] = "move" if rest is None else "rest"
        axis, turned = _rotation(data, start, stop, found) if rest is None else (upward_axis(rests.up[rest]), 0.0)
        residuals = (np.nan, np.nan, np.nan) if rest is None else rests.in_sigma(rest)
        if not freedom:
            excess = np.nan
        else:
            excess = normal_deviate(total, freedom) if white else float(np.abs(means).max())
        rows.append(
            PositionResidual(
                kind,
                1 + sum(row.kind == kind for row in rows),
                int(data.step[stop - 1]),
                int(data.seq[start]),
                int(data.seq[stop - 1]),
                (stop - start) * data.dt,
                axis,
                turned,
                _last_angles(data, start, stop),
                freedom,
                total,
                excess,
                component,
                float(means[component]) if freedom else np.nan,
                channel,
                float(errors[channel or 0]),
                float(sigmas[channel or 0]),
                *residuals,
            )
        )
    return StageResiduals(tuple(rows), scores)


def normal_deviate(total: float, freedom: int) -> float:
    """Return the standard normal deviate that is as improbable as a χ² of `total`.

    E. B. Wilson, M. M. Hilferty, *The distribution of chi-square*, PNAS 17(12), 1931.
    """
    variance = 2.0 / (9.0 * freedom)
    return float((np.cbrt(total / freedom) - (1.0 - variance)) / np.sqrt(variance))


def _spans(data: StageData, rests: RestResiduals, found: Belief) -> list[tuple[int, int, int | None]]:
    """Divide the samples into rests and moves: (start, stop, index of the rest or None), without the gaps.

    Samples between two rests without a rotation, such as those in which the table creeps, belong to what is before.
    """
    begin = np.searchsorted(data.seq, rests.first_seq)
    end = np.searchsorted(data.seq, rests.last_seq) + 1
    changed = np.flatnonzero(np.diff(data.step)) + 1
    spans: list[tuple[int, int, int | None]] = []
    for first, last in data.segments:
        inside = np.flatnonzero((begin >= first) & (end <= last))
        cuts = np.unique([first, last, *begin[inside], *end[inside], *changed[(changed > first) & (changed < last)]])
        found_here: list[tuple[int, int, int | None]] = []
        for start, stop in pairwise(cuts.tolist()):
            rest = next((int(k) for k in inside if begin[k] <= start and stop <= end[k]), None)
            if rest is None and found_here and abs(_rotation(data, start, stop, found)[1]) < SMALLEST_MOVE:
                found_here[-1] = (found_here[-1][0], stop, found_here[-1][2])
            elif rest is not None and found_here and (found_here[-1][2] == rest or _idle(data, found_here[-1], found)):
                found_here[-1] = (found_here[-1][0], stop, rest)
            else:
                found_here.append((start, stop, rest))
        spans += found_here
    return spans


def _idle(data: StageData, span: tuple[int, int, int | None], found: Belief) -> bool:
    """Whether a span is not a rest, and nothing rotates in it."""
    start, stop, rest = span
    return rest is None and abs(_rotation(data, start, stop, found)[1]) < SMALLEST_MOVE


def _rotation(data: StageData, start: int, stop: int, found: Belief) -> tuple[str, float]:
    """Return the axis of a rotation, see `PositionResidual.axis`, and its angle, rad."""
    polled = np.flatnonzero(np.isfinite(data.angles[start:stop]).all(axis=1))
    if len(polled) > 1:
        turned = data.angles[start + polled[-1]] - data.angles[start + polled[0]]
        names = [name for name, angle in zip(_JOINTS, turned, strict=True) if abs(angle) >= SMALLEST_MOVE]
        if names:
            return "+".join(names), float(turned[np.argmax(np.abs(turned))])
    body = (data.gyro[start:stop] - found.mean[group_indices("gyro_bias")]).sum(axis=0) * data.dt
    axis = int(np.argmax(np.abs(body)))
    return "xyz"[axis], float(body[axis])


def _last_angles(data: StageData, start: int, stop: int) -> tuple[float, float]:
    """Return the last encoder angles, rad, NaN if none were polled."""
    polled = np.flatnonzero(np.isfinite(data.angles[start:stop]).all(axis=1))
    outer, inner = data.angles[start + polled[-1]] if len(polled) else (np.nan, np.nan)
    return float(outer), float(inner)


@dataclass(frozen=True)
class BeforeAfter:
    """The same n samples compensated with the parameters before calibration and with those found."""

    time: FloatArray  #: s, shape (n,)
    rate_before: FloatArray  #: rad/s, shape (n, 3)
    rate_after: FloatArray  #: rad/s, shape (n, 3)
    force_before: FloatArray  #: m/s², shape (n, 3)
    force_after: FloatArray  #: m/s², shape (n, 3)
    length_before: FloatArray  #: Magnitude of the force minus gravity, m/s², shape (n,); at rest this is the error.
    length_after: FloatArray  #: The same with the parameters found, m/s², shape (n,).


def before_after(
    block: SampleBlock, imu: ImuModel, before: FloatArray, found: FloatArray, gravity: float, stride: int = 1
) -> BeforeAfter:
    """Compensate a block with two parameter vectors, SI, shape (30,), after averaging groups of `stride` samples."""
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
