"""Gimbal: gyro misalignment from the joints of a gimbal that stabilises on the corrected rates, turn by turn.

The correction starts at zero. From joints at zero one axis is turned by a preset angle; how far the other two joints
drift meanwhile corrects K; the joints go back to zero, and again until the drift is small. Then the next axis. A
recording is replayed: its joints give the same corrections as they gave online, and the same samples give the
least-squares answer beside it.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator

from calstation.errors import ConfigurationError, InputError
from calstation.estimation.batch_stage import BatchStage
from calstation.estimation.common.context import Belief, SolveContext
from calstation.estimation.common.least_squares import nis_consistency, restricted
from calstation.estimation.common.noise import filter_noise
from calstation.estimation.common.stage_data import StageData
from calstation.estimation.gimbal.fit import fit_gimbal
from calstation.estimation.gimbal.iteration import (
    AXES,
    AxisTurns,
    GimbalIteration,
    contraction,
    drift_matrix,
    largest_gain,
    others,
    sign_of,
)
from calstation.estimation.gimbal.motions import Motion, find_motions
from calstation.estimation.method import Method, Solution
from calstation.estimation.positions.recording_faults import frozen_columns
from calstation.physics.arrays import FloatArray
from calstation.physics.motion import Step
from calstation.physics.parameters import INDEX, NAMES
from calstation.physics.table import TableGeometry

ESTIMATED = tuple(f"gyro_misalign_{pair}" for pair in ("xy", "xz", "yx", "yz", "zx", "zy"))
#: Drifts that keep this share of their size through turns that should have halved it were not corrected.
STUCK = 0.7


class Schedule(BaseModel):
    """The iteration and the gimbal.

    angle_deg : of every turn; gain : α, rad of correction per rad of drift; iterations : per axis at most
    threshold_arcsec : drift below which an axis is done; alternate : every second turn goes the other way
    order : joints from the base to the unit; dwell_s : stabilised rest before and after a turn; rate_dps
    mount_sigma_deg : how far b, as the accelerometers define it, may be turned from the joints' axes; 0 where the
        joints define it
    """

    model_config = ConfigDict(extra="forbid")
    angle_deg: float = Field(30.0, ge=5.0, le=80.0)
    gain: float = Field(1.5, gt=0.0, le=50.0)
    iterations: int = Field(10, ge=1, le=200)
    threshold_arcsec: float = Field(20.0, ge=0.0)
    alternate: bool = True
    order: str = "zxy"
    dwell_s: float = Field(4.0, ge=2.0, le=600.0)
    rate_dps: float = Field(30.0, gt=0.0, le=360.0)
    mount_sigma_deg: float = Field(0.0, ge=0.0, le=10.0)

    @field_validator("order")
    @classmethod
    def _order(cls, order: str) -> str:
        if sorted(order) != ["x", "y", "z"]:
            raise ValueError(f"order = '{order}' must name x, y and z once each, from the base to the unit")
        return order

    def iteration(self) -> GimbalIteration:
        """A fresh iteration."""
        return GimbalIteration(
            self.gain,
            float(np.deg2rad(self.angle_deg)),
            self.iterations,
            float(np.deg2rad(self.threshold_arcsec / 3600.0)),
            self.alternate,
        )


def plan(geometry: TableGeometry, schedule: Schedule) -> Iterator[Step]:
    """None: a table does not stabilise on the unit's rates. Raises ConfigurationError."""
    raise ConfigurationError(
        "gimbal needs a gimbal that stabilises on the corrected rates, which a rate table is not; record there and "
        "solve the log"
    )


def estimates(context: SolveContext) -> tuple[str, ...]:
    """Gyro misalignments."""
    return ESTIMATED


def solver(context: SolveContext, prior: Belief, schedule: Schedule) -> BatchStage:
    """Collects the recording and replays it at its end."""
    return BatchStage(context, prior, lambda data, c, p: solve(data, c, p, schedule))


def solve(data: StageData, context: SolveContext, prior: Belief, schedule: Schedule) -> Solution:
    """Replay the turns. Raises InputError naming what makes a recording worthless."""
    _require_channels(data)
    motions = find_motions(data, context.imu)
    _require_joints(data, motions)
    iteration, turns = _replayed(motions, schedule)
    known = []
    for course, turned in zip(iteration.courses, turns, strict=True):
        known.append(_known(course, turned, context, prior, schedule))
        _require_corrected(course, known[-1])
    fit = fit_gimbal(data, motions, schedule.order, context, prior, context.table.encoder_sigma)
    mask = np.array([name in ESTIMATED for name in NAMES])
    return Solution(
        stage="gimbal",
        belief=restricted(prior, _measured(prior, known), mask),
        estimated=ESTIMATED,
        consistency=nis_consistency(fit.chi2, max(round(fit.freedom), 1), 1),
        gaps=data.gaps,
        details={
            "axes": [_axis(course, schedule) for course in iteration.courses],
            "least_squares": {
                name: {
                    "value": float(fit.belief.mean[INDEX[name]]),
                    "sigma": float(fit.belief.sigma[INDEX[name]]),
                }
                for name in ESTIMATED
            },
            "motions": [
                {
                    "first_seq": int(data.seq[m.start]),
                    "last_seq": int(data.seq[m.stop - 1]),
                    "residual": r.tolist(),
                }
                for m, r in zip(motions, fit.residual, strict=True)
            ],
        },
        messages=_messages(iteration, schedule),
    )


def _replayed(motions: list[Motion], schedule: Schedule) -> tuple[GimbalIteration, list[list[Motion]]]:
    """The iteration as it went online: which axis was turned the recording says, not the schedule."""
    iteration = schedule.iteration()
    iteration.courses = []
    turns: list[list[Motion]] = []
    for m in motions:
        if m.axis is None:
            continue
        if not iteration.courses or iteration.courses[-1].axis != m.axis:
            iteration.courses.append(AxisTurns(m.axis))
            turns.append([])
        iteration.answer(m.angle, m.lean(schedule.order))
        turns[-1].append(m)
    return iteration, turns


def _require_channels(data: StageData) -> None:
    names = ("gyro_x", "gyro_y", "gyro_z", "joint_x", "joint_y", "joint_z")
    polled = data.joints.shape[1] == 3
    joints = data.joints[~np.isnan(data.joints).any(axis=1)] if polled else np.empty((0, 3))
    if polled and len(joints) > 1:
        for k, still in enumerate(np.ptp(joints, axis=0) == 0.0):
            if still:
                raise InputError(f"{names[3 + k]} is frozen: one value all through; check its encoder")
    for name, first, last in frozen_columns(names[:3], data.gyro, data.dt):
        raise InputError(
            f"{name} is frozen from sample {data.seq[first]} to {data.seq[last]}; check the unit and its cable"
        )


def _require_joints(data: StageData, motions: list[Motion]) -> None:
    """The joint that was turned must be the axis the gyros saw turn, by the same angle."""
    for m in motions:
        if m.axis is None:
            continue
        turned = data.gyro[m.start : m.stop].sum(axis=0) * data.dt
        seen = int(np.argmax(np.abs(turned)))
        where = f"samples {data.seq[m.start]} to {data.seq[m.stop - 1]}"
        if seen != m.axis:
            raise InputError(
                f"joint_{AXES[m.axis]} was turned but gyro_{AXES[seen]} saw it ({where}); axes are swapped, correct "
                "the columns"
            )
        ratio = turned[seen] / m.angle
        if ratio < 0.0:
            raise InputError(
                f"gyro_{AXES[seen]} and joint_{AXES[seen]} turn opposite ways ({where}); correct a sign"
            )
        if not 0.8 < ratio < 1.25:
            raise InputError(
                f"gyro_{AXES[seen]} turned {ratio:.4g} times as far as joint_{AXES[seen]} ({where}): units wrong by a "
                "factor; correct imu.gyro_lsb or the joints' columns"
            )


@dataclass(frozen=True)
class Known:
    """How well one axis is known at its end.

    values : misalignments by name, rad; covariance : of them, shape (2, 2)
    remaining : share of the first error that all turns leave; drift_sigma : of the last drift by noise alone, rad
    """

    values: dict[str, float]
    covariance: FloatArray
    remaining: float
    drift_sigma: float


def _known(
    course: AxisTurns, motions: list[Motion], context: SolveContext, prior: Belief, schedule: Schedule
) -> Known:
    """Noise of every drift taken through the recursion.

    A demand of pure turning makes N's column parallel to the axis, so off the diagonal K = M / (1 + scale). What of the
    first error the last turn has not yet taken out stays a doubt.
    """
    noise, name = filter_noise(context), AXES[course.axis]
    P, left, drift = np.zeros((2, 2)), np.eye(2), np.zeros((2, 2))
    for m in motions:
        J = drift_matrix(schedule.order, course.axis, m.angle)
        random = (
            noise.rate * (m.duration + 1.2 * m.duration**2 / m.rest) + 2.0 * context.table.encoder_sigma**2
        )
        drift = J @ P @ J.T + random * np.eye(2)
        step = np.eye(2) + sign_of(m.angle) * schedule.gain * J
        P = step @ P @ step.T + schedule.gain**2 * random * np.eye(2)
        left = step @ left
    last = course.corrections[-1]
    mount = np.deg2rad(schedule.mount_sigma_deg)
    scale = float(prior.mean[INDEX[f"gyro_scale_{name}"]])
    values = {
        f"gyro_misalign_{AXES[row]}{name}": float(k) * (1.0 + scale)
        for row, k in zip(others(course.axis), last, strict=True)
    }
    return Known(
        values,
        P + np.diag((left @ last) ** 2) + mount**2 * np.eye(2),
        float(np.linalg.norm(left, 2)),
        float(np.sqrt(np.linalg.eigvalsh(drift)[-1])),
    )


def _require_corrected(course: AxisTurns, known: Known) -> None:
    """Drifts must have shrunk as far as the gain promises; if not, the rates were not corrected by K."""
    first, last = (float(np.linalg.norm(course.drifts[k])) for k in (0, -1))
    if known.remaining < 0.5 * STUCK and last > STUCK * first and last > 6.0 * known.drift_sigma:
        raise InputError(
            f"turned about {AXES[course.axis]} the joints drift by {np.rad2deg(last) * 3600:.0f}″ after "
            f"{len(course.drifts)} turns and drifted by {np.rad2deg(first) * 3600:.0f}″ at first: the rates were not "
            "corrected by K; correct them, or the schedule's gain and order"
        )


def _measured(prior: Belief, known: list[Known]) -> Belief:
    """The prior with the misalignments observed (Kalman update)."""
    belief = prior
    for axis in known:
        places, z = [INDEX[name] for name in axis.values], np.array(list(axis.values.values()))
        P, R = belief.covariance, axis.covariance
        gain = np.linalg.solve(P[np.ix_(places, places)] + R, P[places]).T
        left = np.eye(len(belief.mean))
        left[:, places] -= gain
        belief = Belief(belief.mean + gain @ (z - belief.mean[places]), left @ P @ left.T + gain @ R @ gain.T)
    return belief


def _axis(course: AxisTurns, schedule: Schedule) -> dict[str, Any]:
    """Convergence of one axis, JSON-ready."""
    angle = float(np.mean(np.abs(course.angles)))
    return {
        "axis": AXES[course.axis],
        "rows": [AXES[k] for k in others(course.axis)],
        "angles": course.angles,
        "drifts": [d.tolist() for d in course.drifts],
        "corrections": [k.tolist() for k in course.corrections],
        "gain": schedule.gain,
        "largest_gain": largest_gain(schedule.order, course.axis, angle),
        "contraction": contraction(schedule.order, course.axis, angle, schedule.gain),
        "turns": len(course.angles),
    }


def _messages(iteration: GimbalIteration, schedule: Schedule) -> tuple[tuple[str, dict[str, Any]], ...]:
    messages: list[tuple[str, dict[str, Any]]] = []
    for course in iteration.courses:
        angle = float(np.mean(np.abs(course.angles)))
        most = largest_gain(schedule.order, course.axis, angle)
        if schedule.gain >= most:
            messages.append(
                (
                    "gimbal_unstable",
                    {"stage": "gimbal", "axis": AXES[course.axis], "gain": schedule.gain, "limit": most},
                )
            )
    missing = [a for k, a in enumerate(AXES) if k not in {c.axis for c in iteration.courses}]
    if missing:
        messages.append(("gimbal_axes_missing", {"stage": "gimbal", "axes": ", ".join(missing)}))
    return tuple(messages)


METHOD = Method("gimbal", Schedule, plan, solver, estimates, needs_no_table=True)
