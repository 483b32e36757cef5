"""Rate: gyro scale factors from whole turns about each gyro axis in both directions, measured by the table encoders.

The mounting, the table axes, the misalignments and the encoder errors at rest are unknowns with a prior. Without
encoder angles, equal directions of gravity in b before and after a turn verify that it is whole; for a turn about the
vertical, the prior of the scale factor does.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from calstation.errors import ConfigurationError, InsufficientDataError
from calstation.estimation import BatchStage, Innovations, Method, Solution
from calstation.estimation.common import (
    BIAS_DRIFT_TIME,
    FREE_AZIMUTH_SIGMA,
    Posterior,
    SolveContext,
    StageData,
    consider_update,
    filter_noise,
    find_rests,
    map_estimate,
    mean_angles,
    rest_mean_variance,
    rest_noise,
    with_measured_noise,
)
from calstation.estimation.effects import StageEffects
from calstation.messages import Text
from calstation.physics import (
    INNER,
    JOINTS,
    NAMES,
    Dwell,
    FloatArray,
    Motion,
    Move,
    Step,
    TableGeometry,
    axis_rotation,
    axis_rotations,
    group_indices,
    group_matrix,
    group_vector,
    rotation_matrix,
    rotation_rate,
)

ESTIMATED = tuple(f"gyro_scale_{axis}" for axis in "xyz")
#: Groups of parameters on which a turn depends.
GROUPS = ("gyro_bias", "gyro_scale", "gyro_misalign")
#: Smallest rotation of a turn, rad; a smaller rotation between two rests is a positioning move.
SMALLEST_TURN = np.deg2rad(300.0)
#: Largest deviation of a rotation from a whole number of turns, rad.
MAX_TURN_DEVIATION = np.deg2rad(5.0)
#: Smallest sine of the angle between the axis of a turn and the vertical for which gravity verifies the turn.
MIN_SINE = 0.5
#: Largest deviation from a whole number at which the number of turns is unambiguous, in turns.
MAX_UNCERTAIN_TURNS = 0.25
#: Largest deviation of a turn from a whole turn, in standard deviations.
MAX_SIGMAS = 3.0
#: Sigma of the table axes relative to the profile, rad: non-orthogonality and wobble.
AXIS_SIGMA = np.deg2rad(0.1)
#: Interval over which rate and force are averaged to compute effects outside the model, s.
EFFECT_INTERVAL = 0.1


class Schedule(BaseModel):
    """Number of turns, rate and acceleration of moves (°/s, °/s²), and duration of rests (s)."""

    model_config = ConfigDict(extra="forbid")
    turns: int = Field(2, ge=1, le=50, description="whole turns each way about every axis")
    rate_dps: float = Field(20.0, gt=0.0, le=360.0, description="rate of every move")
    acceleration_dps2: float = Field(20.0, gt=0.0, le=1000.0, description="acceleration of every move")
    dwell_s: float = Field(5.0, ge=2.0, le=600.0, description="rest before and after every turn")


@dataclass(frozen=True)
class Turn:
    """A rotation by whole turns between two rests."""

    start: int  #: Index of the sample in the middle of the rest before the rotation.
    stop: int  #: Index of the sample in the middle of the rest after the rotation.
    end: int  #: Index of the first sample after the rotation.
    total: FloatArray  #: Integral of the raw rate, rad, shape (3,).
    rest_rate: FloatArray  #: Mean raw rate at the two rests, rad/s, shape (3,).
    joint: int  #: Index of the joint: 0 outer, 1 inner.
    angles: FloatArray  #: Encoder angles before and after, rad, shape (2, 2).
    rest: tuple[int, int]  #: Indices of the two rests.
    duration: float  #: s


def plan(geometry: TableGeometry, schedule: Schedule) -> Iterator[Step]:
    """Plan, for x, y and z: positioning move, rest, whole turns, rest, whole turns back, rest."""
    rate, acceleration = np.deg2rad(schedule.rate_dps), np.deg2rad(schedule.acceleration_dps2)
    joints = [0.0, 0.0]
    for axis in range(3):
        turn = geometry.body_turn(np.eye(3)[axis], joints[INNER])
        joints[INNER] = joints[INNER] if turn.inner is None else turn.inner
        joints[turn.joint], whole = _first_rotation(geometry, turn.joint, turn.sign, joints[turn.joint], schedule.turns)
        yield Move(joints[0], joints[1], rate, acceleration, ("into_place", "xyz"[axis]))
        yield Dwell(schedule.dwell_s)
        for way in (whole, -whole):
            joints[turn.joint] += way
            label = ("whole_turns", "xyz"[axis], float(np.rad2deg(way * turn.sign)))
            yield Move(joints[0], joints[1], rate, acceleration, label)
            yield Dwell(schedule.dwell_s)


def _first_rotation(geometry: TableGeometry, joint: int, sign: int, at: float, turns: int) -> tuple[float, float]:
    """Return the start angle nearest `at` and the first rotation, which is positive if the travel permits it, rad.

    Raises ConfigurationError if the travel is too short for the turns.
    """
    limits, rotation = geometry.limits, 2.0 * np.pi * turns * sign
    low, high = limits.low[joint], limits.high[joint]
    for first in (rotation, -rotation):
        if limits.within(joint, at + first):
            return at, first
    if high - low < abs(rotation):
        raise ConfigurationError(
            "plan.turns_exceed_travel",
            turns=turns,
            needed_deg=360 * turns,
            axis=JOINTS[joint],
            travel_deg=float(np.rad2deg(high - low)),
        )
    return float(np.clip(at, low - min(rotation, 0.0), high - max(rotation, 0.0))), rotation


def solve(data: StageData, context: SolveContext, prior: Posterior, schedule: Schedule) -> Solution:
    """Solve the stage from its whole turns. Raises InsufficientDataError if turns are missing."""
    measured_noise = rest_noise(data, context, prior.gyro_bias)
    context = with_measured_noise(context, measured_noise)
    turns, assumed = find_turns(data, context, prior)
    _require_turns(turns, data.gaps)
    table, site = context.table, context.site
    geometry, orientation = table.geometry, np.array(table.orientation)
    noise = filter_noise(context)
    rests = sorted({r for t in turns for r in t.rest})
    earth = rotation_rate(site.latitude)
    integrals = [_earth_integral(data, t, geometry, earth, site.azimuth or 0.0) for t in turns]
    level, north, east = np.array(integrals).transpose(1, 0, 2)
    angles, duration = np.array([t.angles for t in turns]), np.array([[t.duration] for t in turns])
    first, second = np.searchsorted(rests, [t.rest for t in turns]).T
    joint = np.array([[t.joint] for t in turns])

    # nuisances: mounting (3), azimuth (1), directions of outer and inner axis (3 + 3), encoders at each rest (2)
    azimuth_sigma = table.azimuth_sigma if site.azimuth is not None and not assumed else FREE_AZIMUTH_SIGMA
    sigma = np.concatenate(
        [[table.mount_sigma] * 3, [azimuth_sigma], [AXIS_SIGMA] * 6, [table.encoder_sigma] * (2 * len(rests))]
    )

    def model(parameters: FloatArray, nuisance: FloatArray) -> FloatArray:
        M = np.eye(3) + group_matrix(parameters, "gyro_scale", "gyro_misalign")
        bias = group_vector(parameters, "gyro_bias")
        mount = (rotation_matrix(nuisance[:3]) @ orientation).T
        outer_axis = rotation_matrix(nuisance[4:7]) @ np.array(table.outer_axis)
        inner_axis = rotation_matrix(nuisance[7:10]) @ np.array(table.inner_axis)
        encoder = nuisance[10:].reshape(-1, 2)
        before, after = angles[:, 0] + encoder[first], angles[:, 1] + encoder[second]
        angle = np.take_along_axis(after - before, joint, axis=1)
        bent = axis_rotations(table.inner_axis, -0.5 * (before + after)[:, INNER]) @ outer_axis
        rotation = angle * np.where(joint == INNER, inner_axis, bent)
        earth_b = level + np.cos(nuisance[3]) * north + np.sin(nuisance[3]) * east
        return np.asarray((rotation + earth_b) @ (M @ mount).T + bias * duration).ravel()

    observed = np.concatenate([t.total for t in turns])
    bias_drift = 2.0 * noise.bias_drift[0] ** 2 / BIAS_DRIFT_TIME
    variance = np.repeat([noise.rate * t.duration + bias_drift * t.duration**3 / 3.0 for t in turns], 3)
    mask = np.array([name in ESTIMATED for name in NAMES])
    zero, encoders = np.zeros(len(sigma)), slice(len(sigma) - 2 * len(rests), None)
    result = map_estimate("rate", model, observed, variance, prior, zero, sigma, mask, encoders, GROUPS)
    effects = StageEffects(float(data.time[0]), len(data) * data.dt, data.has_angles)
    added = _effects(data, turns, effects, np.array(context.initial_turn_senses))
    sensitivity = effects.batch_sensitivity(result.gain, added, mask)
    residual, tested = result.residual.reshape(-1, 3), result.redundancy.normalised.reshape(-1, 3)
    return Solution(
        stage="rate",
        noise=measured_noise,
        posterior=consider_update(prior, result.posterior, mask),
        estimated=ESTIMATED,
        consistency=result.redundancy.consistency,
        gaps=data.gaps,
        innovations=Innovations(np.array([data.seq[t.end - 1] for t in turns]), tested, white=False),
        details={
            "turns": [
                {
                    **data.seq_range(t.start, t.stop),
                    "joint": JOINTS[t.joint],
                    "angle": float(t.angles[1, t.joint] - t.angles[0, t.joint]),
                    "residual": r.tolist(),
                }
                for t, r in zip(turns, residual, strict=True)
            ]
        },
        sensitivity=sensitivity,
        messages=result.messages + ((("turns_assumed_whole", {"stage": "rate"}),) if assumed else ()),
    )


def find_turns(data: StageData, context: SolveContext, prior: Posterior) -> tuple[list[Turn], bool]:
    """Find the whole turns between rests; also return whether encoder angles were missing."""
    geometry = context.table.geometry
    turns, assumed, rest_count = [], False, 0
    for segment in data.segments:
        still = find_rests(data, context.imu, prior.gyro_bias, [segment])
        for number, ((a0, a1), (b0, b1)) in enumerate(itertools.pairwise(still)):
            start, stop = (a0 + a1) // 2, (b0 + b1) // 2
            duration = (stop - start) * data.dt
            total = data.gyro[start:stop].sum(axis=0) * data.dt
            rest_rate = 0.5 * (data.gyro[a0:a1].mean(axis=0) + data.gyro[b0:b1].mean(axis=0))
            rotation = total - duration * rest_rate
            if np.linalg.norm(rotation) < SMALLEST_TURN:
                continue
            before, after = mean_angles(data, a0, a1), mean_angles(data, b0, b1)
            if before is None or after is None:
                assumed = True
                _require_whole(data, (a0, a1), (b0, b1), rotation, context, prior)
                before, after, joint = _whole_turn(geometry, rotation)
            else:
                joint = int(np.argmax(np.abs(after - before)))
            way = after[joint] - before[joint]
            if abs(way - 2.0 * np.pi * np.round(way / (2.0 * np.pi))) < MAX_TURN_DEVIATION and abs(way) > SMALLEST_TURN:
                rest = (rest_count + number, rest_count + number + 1)
                ends = np.vstack([before, after])
                turns.append(Turn(start, stop, b0, total, rest_rate, joint, ends, rest, duration))
        rest_count += len(still)
    return turns, assumed


def _require_whole(
    data: StageData,
    before: tuple[int, int],
    after: tuple[int, int],
    rotation: FloatArray,
    context: SolveContext,
    prior: Posterior,
) -> None:
    """Raise InsufficientDataError unless a rotation by whole turns is verified by gravity or the scale factor prior.

    `before` and `after` are the rests, `rotation` is the measured rotation between them, rad.
    """
    size, gravity = float(np.linalg.norm(rotation)), context.site.local_gravity
    scale = group_indices("gyro_scale")[int(np.argmax(np.abs(rotation)))]
    turns = size / (2.0 * np.pi)
    whole = round(turns / (1.0 + prior.mean[scale]))
    deviation_from_whole = 2.0 * np.pi * abs(turns - whole * (1.0 + prior.mean[scale]))
    first, second = (data.accel[a:b].mean(axis=0) for a, b in (before, after))
    sine = float(np.linalg.norm(np.cross(rotation / size, first / np.linalg.norm(first))))
    noise = sum(rest_mean_variance(context, (b - a) * data.dt) for a, b in (before, after)) / gravity**2
    stops = 2.0 * context.table.encoder_sigma**2
    if sine > MIN_SINE:
        deviation = float(np.linalg.norm(second - first)) / gravity / sine
        tolerance = MAX_SIGMAS * float(np.sqrt(stops + 3.0 * noise / sine**2))
        verified = deviation < tolerance and deviation_from_whole < 2.0 * np.pi * MAX_UNCERTAIN_TURNS
    else:
        deviation = deviation_from_whole
        tolerance = MAX_SIGMAS * float(np.hypot(2.0 * np.pi * whole * prior.sigma[scale], np.sqrt(stops)))
        verified = deviation < tolerance < np.pi
    if verified:
        return
    values = {"turns": turns, "away_deg": float(np.rad2deg(deviation)), "tolerance_deg": float(np.rad2deg(tolerance))}
    where = data.seq_range(before[1], after[0])
    if sine > MIN_SINE:
        raise InsufficientDataError("solve.turn_against_gravity", **where, **values)
    raise InsufficientDataError("solve.turn_unproven", whole=whole, **where, **values)


def _whole_turn(geometry: TableGeometry, rotation: FloatArray) -> tuple[FloatArray, FloatArray, int]:
    """Return joint angles before and after, rad, and joint index of the whole turns nearest to a measured rotation."""
    axis = np.eye(3)[int(np.argmax(np.abs(rotation)))]
    body_turn = geometry.body_turn(axis, 0.0)
    before = np.array([0.0, body_turn.inner or 0.0])
    after = before.copy()
    angle = float(rotation @ axis) * body_turn.sign
    after[body_turn.joint] += 2.0 * np.pi * np.round(angle / (2.0 * np.pi))
    return before, after, body_turn.joint


def _require_turns(turns: list[Turn], gaps: int) -> None:
    missing = []
    for axis in range(3):
        for sign, way in ((1.0, "+"), (-1.0, "-")):
            if not any(np.argmax(np.abs(t.total)) == axis and sign * t.total[axis] > 0.0 for t in turns):
                missing.append(f"{way}{'xyz'[axis]}")
    if missing:
        note = Text.of("solve.gaps_cost_turns", gaps=gaps) if gaps else ""
        raise InsufficientDataError("solve.no_whole_turn", missing=missing, turns=len(turns), gaps_note=note)


def _effects(data: StageData, turns: list[Turn], effects: StageEffects, senses: FloatArray) -> FloatArray:
    """Return the contribution of every effect to the integral of the raw rate over each rotation, rad, shape (3 n, k).

    The errors are computed for the whole stage, because they may depend on the motion before a rotation; `senses` are
    the senses of the last turns before the stage.
    """
    stride = max(round(EFFECT_INTERVAL / data.dt), 1)
    edges = np.unique([0, len(data), *(k for t in turns for k in (t.start, t.stop))])
    counts = np.maximum(np.diff(edges) // stride, 1)
    sizes = np.concatenate([n // k + (np.arange(k) < n % k) for n, k in zip(np.diff(edges), counts, strict=True)])
    starts = np.cumsum(sizes) - sizes
    rate, force = (np.add.reduceat(x, starts) / sizes[:, None] for x in (data.gyro, data.accel))
    rate -= np.mean([t.rest_rate for t in turns], axis=0)
    time = (data.seq[starts] - data.seq[0] + 0.5 * sizes) * data.dt
    errors = effects.errors(Motion.steady(rate, force, time, senses), counts)
    during = np.searchsorted(edges, [t.start for t in turns])
    durations = np.array([t.duration for t in turns])
    return np.asarray((errors[during, :3] * durations[:, None, None]).reshape(3 * len(turns), -1))


def _earth_integral(
    data: StageData, turn: Turn, geometry: TableGeometry, earth: FloatArray, azimuth: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Integrate earth rate in b over a rotation, rad: vertical part, and cosine and sine parts of a heading error.

    The joint angle is interpolated between encoder readings by the integrated gyro rate. Each part has shape (3,).
    """
    progress = np.cumsum(np.linalg.norm(data.gyro[turn.start : turn.stop], axis=1))
    progress = progress / progress[-1]
    stride = max(len(progress) // 2000, 1)
    shares = progress[stride // 2 :: stride, None]
    outer, inner = (turn.angles[0] + (turn.angles[1] - turn.angles[0]) * shares).T
    turned = axis_rotations(geometry.outer_axis, outer) @ axis_rotations(geometry.inner_axis, inner)
    mean = axis_rotation((0.0, 0.0, 1.0), -azimuth) @ turned.mean(axis=0)  # mean of C_bn
    vertical, north, east = mean[2] * earth[2], mean[1] * earth[1], mean[0] * earth[1]
    return vertical * turn.duration, north * turn.duration, east * turn.duration


METHOD = Method("rate", Schedule, plan, partial(BatchStage, solve), estimates=lambda context: ESTIMATED)
