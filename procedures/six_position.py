"""Six positions: scale factors and biases from the magnitude of gravity with each accelerometer axis up and down.

The axes need not be exactly vertical: the direction of gravity in b is an unknown at every rest. Six positions
determine three scale factors and three biases without redundancy. Four oblique positions, the corners of a tetrahedron,
provide a test: the sum of the measured magnitudes of gravity over them depends to first order neither on misalignments
nor on biases.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from calstation.errors import InsufficientDataError
from calstation.estimation import BatchStage, Innovations, Method, Solution
from calstation.estimation.common import (
    SHORTEST_REST,
    Posterior,
    SolveContext,
    StageData,
    consider_update,
    find_rests,
    find_stillness,
    map_estimate,
    mean_angles,
    rest_force,
    rest_noise,
    with_measured_noise,
)
from calstation.estimation.effects import StageEffects
from calstation.physics import (
    NAMES,
    Dwell,
    FloatArray,
    Motion,
    Move,
    Step,
    TableGeometry,
    compensation,
    group_matrix,
    group_vector,
)

ESTIMATED = tuple(f"{group}_{axis}" for group in ("accel_scale", "accel_bias") for axis in "xyz")
#: Groups of parameters on which the force at rest depends.
GROUPS = ("accel_bias", "accel_scale", "accel_misalign", "accel_quadratic")
#: Prior sigma of an unknown direction of gravity relative to the measured direction, rad.
FREE_DIRECTION_SIGMA = 1.0
#: Body directions that point up in the oblique positions, in order.
OBLIQUE = ((-1, 1, -1), (-1, -1, 1), (1, -1, -1), (1, 1, 1))
#: Largest angle between the vertical and a body axis at one of the six positions, rad; other rests are used only in the
#: fit.
MAX_FACE_ANGLE = np.deg2rad(30.0)


class Schedule(BaseModel):
    """Durations of rests (s), and rate and acceleration of moves (°/s, °/s²)."""

    model_config = ConfigDict(extra="forbid")
    dwell_s: float = Field(30.0, ge=2.0, le=600.0, description="rest in every position")
    oblique_dwell_s: float = Field(10.0, ge=2.0, le=600.0, description="rest in every oblique position")
    rate_dps: float = Field(20.0, gt=0.0, le=360.0, description="rate of every move")
    acceleration_dps2: float = Field(20.0, gt=0.0, le=1000.0, description="acceleration of every move")


@dataclass(frozen=True)
class Position:
    """A rest of a stage."""

    start: int  #: Index of the first sample.
    stop: int  #: Index after the last sample.
    force: FloatArray  #: Mean raw specific force, m/s², shape (3,).
    variance: float  #: Variance of each component of `force`, (m/s²)².
    angles: FloatArray | None  #: Encoder angles, rad, shape (2,); None if they were not polled.


def plan(geometry: TableGeometry, schedule: Schedule) -> Iterator[Step]:
    """Plan z up, z down, y up, y down, x up, x down, the oblique positions, and z up again.

    The joints move to the nearest angles of each position. A difference between the first and the last rest indicates
    drift.
    """
    rate, acceleration = np.deg2rad(schedule.rate_dps), np.deg2rad(schedule.acceleration_dps2)
    pose = (0.0, 0.0)
    for axis in (2, 1, 0):
        for sign in (1.0, -1.0):
            direction = np.zeros(3)
            direction[axis] = sign
            pose = geometry.pose_up(direction, pose)
            face = f"{'+' if sign > 0 else '-'}{'xyz'[axis]}"
            yield Move(*pose, rate, acceleration, ("face_up", face))
            yield Dwell(schedule.dwell_s)
    for up in OBLIQUE:
        pose = geometry.pose_up(np.array(up, dtype=np.float64), pose)
        signs = "".join(f"{'+' if part > 0 else '-'}{axis}" for part, axis in zip(up, "xyz", strict=True))
        yield Move(*pose, rate, acceleration, ("oblique", signs))
        yield Dwell(schedule.oblique_dwell_s)
    pose = geometry.pose_up(np.eye(3)[2], pose)
    yield Move(*pose, rate, acceleration, ("face_up", "+z"))
    yield Dwell(schedule.oblique_dwell_s)


def solve(data: StageData, context: SolveContext, prior: Posterior, schedule: Schedule) -> Solution:
    """Solve the stage from its rests. Raises InsufficientDataError if one of the six positions is missing."""
    measured_noise = rest_noise(data, context, prior.gyro_bias)
    context = with_measured_noise(context, measured_noise)
    positions = find_positions(data, context, prior)
    _require_faces(positions, prior)
    gravity, geometry, tilt = context.site.local_gravity, context.table.geometry, context.table.tilt_sigma
    constants = compensation(prior.mean)
    directions, tangents, nuisance, sigma = [], [], [], []
    for p in positions:
        measured = constants.accel_inverse @ (p.force - constants.accel_bias)
        measured /= np.linalg.norm(measured)
        frame = _tangents(measured)
        offset, width = np.zeros(2), FREE_DIRECTION_SIGMA
        if p.angles is not None:
            nominal = geometry.body_to_home(*p.angles)[2]
            if nominal @ measured > np.cos(10.0 * tilt):
                offset, width = frame @ np.cross(measured, nominal), tilt
        directions.append(measured)
        tangents.append(frame)
        nuisance.append(offset)
        sigma.append([width, width])
    up, frames = np.array(directions), np.array(tangents)
    observed = np.concatenate([p.force for p in positions])
    noise = np.repeat([p.variance for p in positions], 3)

    def model(parameters: FloatArray, tilts: FloatArray) -> FloatArray:
        M = np.eye(3) + group_matrix(parameters, "accel_scale", "accel_misalign")
        K2, bias = group_vector(parameters, "accel_quadratic"), group_vector(parameters, "accel_bias")
        turn = np.einsum("ka,kai->ki", tilts.reshape(-1, 2), frames)  # perpendicular to up
        angle = np.linalg.norm(turn, axis=1, keepdims=True)
        force = gravity * (np.cos(angle) * up + np.sinc(angle / np.pi) * np.cross(turn, up))
        return np.asarray(force @ M.T + K2 * force**2 + bias).ravel()

    mask = np.array([name in ESTIMATED for name in NAMES])
    tilts, widths = np.concatenate(nuisance), np.concatenate(sigma)
    result = map_estimate("six_position", model, observed, noise, prior, tilts, widths, mask, groups=GROUPS)
    effects = StageEffects(float(data.time[0]), len(data) * data.dt, data.has_angles)
    time = np.array([data.seq[(p.start + p.stop) // 2] - data.seq[0] for p in positions]) * data.dt
    force = observed.reshape(-1, 3)
    motion = Motion.steady(np.zeros_like(force), force, time)
    added = effects.errors(motion, np.ones(len(force), dtype=np.int64))[:, 3:].reshape(len(observed), -1)
    sensitivity = effects.batch_sensitivity(result.gain, added, mask)
    residual, tested = result.residual.reshape(-1, 3), result.redundancy.normalised.reshape(-1, 3)
    return Solution(
        stage="six_position",
        noise=measured_noise,
        posterior=consider_update(prior, result.posterior, mask),
        estimated=ESTIMATED,
        consistency=result.redundancy.consistency,
        gaps=data.gaps,
        innovations=Innovations(np.array([data.seq[p.stop - 1] for p in positions]), tested, white=False),
        details={
            "positions": [
                {**data.seq_range(p.start, p.stop), "force": p.force.tolist(), "residual": r.tolist()}
                for p, r in zip(positions, residual, strict=True)
            ]
        },
        sensitivity=sensitivity,
        messages=result.messages,
    )


def find_positions(data: StageData, context: SolveContext, prior: Posterior) -> list[Position]:
    """Find the rests of a stage and compute their mean forces."""
    rests: Sequence[tuple[int, int]]
    if data.has_gyros:
        rests = find_rests(data, context.imu, prior.gyro_bias)
    else:
        rests = find_stillness(data, context.imu).rests
    return [
        Position(a, b, *rest_force(data, context, a, b), mean_angles(data, a, b))
        for a, b in rests
        if (b - a) * data.dt >= SHORTEST_REST
    ]


def _require_faces(positions: list[Position], prior: Posterior) -> None:
    inverse, bias = compensation(prior.mean).accel_inverse, group_vector(prior.mean, "accel_bias")
    faces = set()
    for p in positions:
        up = inverse @ (p.force - bias)
        axis = int(np.argmax(np.abs(up)))
        if abs(up[axis]) > np.cos(MAX_FACE_ANGLE) * np.linalg.norm(up):
            faces.add(("+" if up[axis] > 0 else "-") + "xyz"[axis])
    missing = [f for f in ("+x", "-x", "+y", "-y", "+z", "-z") if f not in faces]
    if missing:
        raise InsufficientDataError("solve.missing_faces", seconds=SHORTEST_REST, missing=missing, rests=len(positions))


def _tangents(direction: FloatArray) -> FloatArray:
    """Return two unit vectors perpendicular to `direction` and to each other, as rows, shape (2, 3)."""
    other = np.zeros(3)
    other[int(np.argmin(np.abs(direction)))] = 1.0
    first = np.cross(direction, other)
    first /= np.linalg.norm(first)
    return np.vstack([first, np.cross(direction, first)])


METHOD = Method(
    "six_position", Schedule, plan, partial(BatchStage, solve), estimates=lambda context: ESTIMATED, without_gyros=True
)
