"""Gimbal: gyro misalignment from the joint angles of a gimbal that stabilises the unit by its corrected rates.

The misalignment is updated after each turn. A recording is solved by replaying its joint angles, which gives the same
corrections as the run; a least-squares fit must agree with them.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator

from calstation.errors import ConfigurationError, InputError
from calstation.estimation import BatchStage, Method, Solution
from calstation.estimation.common import (
    Posterior,
    SolveContext,
    StageData,
    consider_update,
    filter_noise,
    nis_consistency,
)
from calstation.estimation.gimbal import (
    BIAS_TIME,
    MIN_JOINT_TURN,
    AxisTurns,
    GimbalFit,
    GimbalIteration,
    Motion,
    contraction,
    correction_sign,
    drift_matrix,
    find_motions,
    fit_gimbal,
    largest_gain,
    other_axes,
)
from calstation.estimation.positions import require_changing
from calstation.physics import AXES, CHANNELS, INDEX, NAMES, FloatArray, GimbalTurn, GimbalZero, Step, TableGeometry
from calstation.schema import EntryError

ESTIMATED = tuple(f"gyro_misalign_{pair}" for pair in ("xy", "xz", "yx", "yz", "zx", "zy"))
#: Largest ratio of the last to the first drift with corrected rates; tested if the gain predicts less than half of it.
MAX_DRIFT_RATIO = 0.7
#: Largest difference between the iteration and least squares, in sigmas of the iteration. Both use the same samples, so
#: their difference has a smaller variance than the iteration.
MAX_DIFFERENCE = 4.0
#: Largest rotation about the other axes in a turn that ends at zero, relative to its rms in other turns.
MAX_ROTATION_RATIO = 3.0


class Schedule(BaseModel):
    """Settings of the iteration and the gimbal."""

    model_config = ConfigDict(extra="forbid")
    angle_deg: float = Field(30.0, ge=5.0, le=80.0)  #: Angle of every turn.
    gain: float = Field(1.5, gt=0.0, le=50.0)  #: Gain α, rad of correction per rad of drift.
    iterations: int = Field(10, ge=1, le=200)  #: Largest number of turns per axis.
    threshold_arcsec: float = Field(20.0, ge=0.0)  #: Drift below which an axis is complete.
    alternate: bool = True  #: Whether every second turn is in the opposite direction.
    order: str = "zxy"  #: Order of the joints from the base to the unit.
    dwell_s: float = Field(4.0, ge=2.0, le=600.0)  #: Stabilised rest before and after a turn.
    rate_dps: float = Field(30.0, gt=0.0, le=360.0)  #: Rate of every turn.
    #: Sigma of the body frame, as defined by the accelerometers, relative to the joint axes; 0 if these define it.
    mount_sigma_deg: float = Field(0.0, ge=0.0, le=10.0)

    @field_validator("order")
    @classmethod
    def _check_order(cls, order: str) -> str:
        if sorted(order) != ["x", "y", "z"]:
            raise EntryError("plan.gimbal_order", order=order)
        return order

    def iteration(self) -> GimbalIteration:
        """Create an iteration with these settings."""
        return GimbalIteration(
            self.gain,
            float(np.deg2rad(self.angle_deg)),
            self.iterations,
            float(np.deg2rad(self.threshold_arcsec / 3600.0)),
            self.alternate,
        )


def plan(geometry: TableGeometry, schedule: Schedule) -> Iterator[Step]:
    """Plan the turns of each axis, each followed by a return to zero; the turns of a complete axis are omitted.

    Raises ConfigurationError for a table, which cannot stabilise the unit by its rates, or for a schedule that the
    gimbal cannot execute.
    """
    gimbal = geometry.gimbal
    if gimbal is None:
        raise ConfigurationError("plan.needs_gimbal")
    if schedule.order != gimbal.order:
        raise ConfigurationError("plan.gimbal_order_differs", order=schedule.order, profile=gimbal.order)
    angle, rate = float(np.deg2rad(schedule.angle_deg)), float(np.deg2rad(schedule.rate_dps))
    for name, (low, high) in zip(AXES, gimbal.travel, strict=True):
        if angle > min(-low, high):
            values = {"angle_deg": schedule.angle_deg, "most_deg": float(np.rad2deg(min(-low, high)))}
            raise ConfigurationError("plan.gimbal_turn_exceeds_travel", axis=name, **values)
    if rate > gimbal.rate:
        limit = float(np.rad2deg(gimbal.rate))
        raise ConfigurationError("plan.gimbal_rate_exceeds_limit", rate_dps=schedule.rate_dps, most_dps=limit)
    threshold = float(np.deg2rad(schedule.threshold_arcsec / 3600.0))
    settings = (angle, rate, schedule.dwell_s, schedule.gain, threshold, schedule.alternate)
    yield GimbalZero(schedule.dwell_s + BIAS_TIME, 0)
    for axis in range(3):
        for index in range(schedule.iterations):
            yield GimbalTurn(axis, index + 1, schedule.iterations, *settings)
        yield GimbalZero(schedule.dwell_s + BIAS_TIME, axis + 1)


def solve(data: StageData, context: SolveContext, prior: Posterior, schedule: Schedule) -> Solution:
    """Replay and fit the turns. Raises InputError if the recording cannot be used."""
    _require_channels(data)
    motions = find_motions(data, context.imu)
    _require_joints(data, motions)
    _require_all_turns(data, motions)
    iteration, turns = _replayed(motions, schedule, context.table.encoder_sigma)
    fit = fit_gimbal(data, motions, schedule.order, context, prior, context.table.encoder_sigma)
    solved = []
    for axis_turns in iteration.courses:
        solved.append(_axis_solution(axis_turns, turns[axis_turns.axis], context, prior, schedule, fit))
        _require_corrected(axis_turns, solved[-1])
        _require_agreement(solved[-1], fit)
    mask = np.array([name in ESTIMATED for name in NAMES])
    return Solution(
        stage="gimbal",
        posterior=consider_update(prior, _with_observations(prior, solved), mask),
        estimated=ESTIMATED,
        consistency=nis_consistency(fit.chi2, max(round(fit.freedom), 1), 1),
        gaps=data.gaps,
        details={
            "axes": [_axis(axis_turns, schedule) for axis_turns in iteration.courses],
            "least_squares": {
                name: {"value": float(fit.posterior.mean[i]), "sigma": float(fit.posterior.sigma[i])}
                for name, i in ((name, INDEX[name]) for name in ESTIMATED)
            },
            "motions": [
                {**data.seq_range(m.start, m.stop), "residual": r.tolist()}
                for m, r in zip(motions, fit.residual, strict=True)
            ],
        },
        messages=_messages(iteration, schedule),
    )


def _replayed(
    motions: list[Motion], schedule: Schedule, encoder_sigma: float
) -> tuple[GimbalIteration, dict[int, list[Motion]]]:
    """Reproduce the iteration of the run; return the iteration and the turns of each axis.

    A motion to zero is a turn if the corrected rates contain no rotation about the other axes, and a return if it moves
    the other joints to zero; the smaller deviation, in sigmas, decides.
    """
    iteration = schedule.iteration()
    turns: dict[int, list[Motion]] = {}
    stabilised: list[float] = []
    for m in motions:
        if m.axis is None:
            continue
        cross = m.cross_rotation(m.axis, iteration.correction)
        if m.to_zero:
            expected = float(np.sqrt(np.mean(np.square(stabilised)))) if stabilised else 0.0
            fits_return = np.linalg.norm(m.after[other_axes(m.axis)]) * expected < cross * encoder_sigma
            if fits_return and cross > MAX_ROTATION_RATIO * expected:
                continue
        else:
            stabilised.append(cross)
        iteration.add_drift(m.axis, m.angle, m.joint_drift(m.axis, schedule.order))
        turns.setdefault(m.axis, []).append(m)
    return iteration, turns


def _require_all_turns(data: StageData, motions: list[Motion]) -> None:
    """Check that no turn is missing between two motions, for example because the following rest is too short."""
    for m, following in itertools.pairwise(motions):
        jump = float(np.abs(following.before - m.after).max())
        if jump > MIN_JOINT_TURN and np.abs(following.before).max() > MIN_JOINT_TURN:
            span = {"first": int(data.seq[m.stop - 1]), "last": int(data.seq[following.start])}
            raise InputError("recording.joint_turn_lost", angle_deg=float(np.rad2deg(jump)), **span)


def _require_channels(data: StageData) -> None:
    polled = data.joints.shape[1] == 3
    joints = data.joints[~np.isnan(data.joints).any(axis=1)] if polled else np.empty((0, 3))
    if polled and len(joints) > 1:
        for k, still in enumerate(np.ptp(joints, axis=0) == 0.0):
            if still:
                raise InputError("recording.frozen_joint", channel=f"joint_{AXES[k]}")
    require_changing(data, CHANNELS[:3], data.gyro)


def _require_joints(data: StageData, motions: list[Motion]) -> None:
    """Check that the gyros measure the same axes and angles of the turns as the joints."""
    for m in motions:
        if m.axis is None:
            continue
        rotation = data.gyro[m.start : m.stop].sum(axis=0) * data.dt
        gyro_axis = int(np.argmax(np.abs(rotation)))
        span = {"first": int(data.seq[m.start]), "last": int(data.seq[m.stop - 1])}
        if gyro_axis != m.axis:
            raise InputError("recording.joint_axes_swapped", joint=AXES[m.axis], gyro=AXES[gyro_axis], **span)
        ratio = float(rotation[gyro_axis] / m.angle)
        if ratio < 0.0:
            raise InputError("recording.joint_sign", axis=AXES[gyro_axis], **span)
        if not 0.8 < ratio < 1.25:
            raise InputError("recording.joint_unit", axis=AXES[gyro_axis], ratio=ratio, **span)


@dataclass(frozen=True)
class _AxisSolution:
    """Solution of one axis."""

    values: dict[str, float]  #: Misalignments by name, rad.
    covariance: FloatArray  #: Covariance of `values`, rad², shape (2, 2).
    sigma: FloatArray  #: Sigma of `values` with respect to the joint axes, without the mounting, rad, shape (2,).
    remaining: float  #: Fraction of the initial error that remains after all turns.
    drift_sigma: float  #: Sigma of the last drift due to noise alone, rad.


def _axis_solution(
    axis_turns: AxisTurns,
    motions: list[Motion],
    context: SolveContext,
    prior: Posterior,
    schedule: Schedule,
    fit: GimbalFit,
) -> _AxisSolution:
    """Determine the misalignments of an axis and propagate the noise of every drift through the recursion.

    After convergence, the column of N is parallel to the axis, so the off-diagonal elements are K = M / (1 + scale).
    The part of the initial error (from least squares) that remains after the last turn is added to the uncertainty.
    """
    noise, name = filter_noise(context), AXES[axis_turns.axis]
    encoder = context.table.encoder_sigma**2
    # covariance of the error of K and of the joint errors at the last rest, which two successive turns share
    P, shared, remaining, drift = np.zeros((2, 2)), np.zeros((2, 2)), np.eye(2), np.zeros((2, 2))
    before = None
    for m in motions:
        if before != m.between[0]:
            shared = np.zeros((2, 2))
        before = m.between[1]
        J = drift_matrix(schedule.order, axis_turns.axis, m.angle)
        convert = J @ np.linalg.inv(drift_matrix(schedule.order, axis_turns.axis, m.angle, m.before))
        random = noise.rate * (m.duration + 1.2 * m.duration**2 / m.rest) * np.eye(2)
        random += 2.0 * encoder * convert @ convert.T
        drift = J @ P @ J.T + random
        correct = correction_sign(m.angle) * schedule.gain
        step = np.eye(2) + correct * J
        mixed = correct * step @ shared @ convert.T
        P = step @ P @ step.T - mixed - mixed.T + correct**2 * random
        shared = encoder * correct * convert
        remaining = step @ remaining
    mount = np.deg2rad(schedule.mount_sigma_deg)
    scale = float(prior.mean[INDEX[f"gyro_scale_{name}"]])
    names = [f"gyro_misalign_{AXES[row]}{name}" for row in other_axes(axis_turns.axis)]
    initial = fit.posterior.mean[[INDEX[name] for name in names]]
    covariance = P + np.diag((remaining @ initial) ** 2)
    return _AxisSolution(
        {name: float(k) * (1.0 + scale) for name, k in zip(names, axis_turns.corrections[-1], strict=True)},
        covariance + mount**2 * np.eye(2),
        np.sqrt(np.diag(covariance)),
        float(np.linalg.norm(remaining, 2)),
        float(np.sqrt(np.linalg.eigvalsh(drift)[-1])),
    )


def _require_corrected(axis_turns: AxisTurns, solved: _AxisSolution) -> None:
    """Check that the drifts decreased as the gain predicts; otherwise the rates were not corrected with K."""
    first, last = (float(np.linalg.norm(axis_turns.drifts[k])) for k in (0, -1))
    if solved.remaining < 0.5 * MAX_DRIFT_RATIO and last > MAX_DRIFT_RATIO * first and last > 6.0 * solved.drift_sigma:
        raise InputError(
            "recording.rates_not_corrected",
            axis=AXES[axis_turns.axis],
            first_arcsec=float(np.rad2deg(first) * 3600),
            last_arcsec=float(np.rad2deg(last) * 3600),
            turns=len(axis_turns.drifts),
        )


def _require_agreement(solved: _AxisSolution, fit: GimbalFit) -> None:
    """Check that the misalignments from the iteration and from least squares agree within their sigmas."""
    for (name, value), sigma in zip(solved.values.items(), solved.sigma, strict=True):
        least_squares = float(fit.posterior.mean[INDEX[name]])
        if abs(value - least_squares) > MAX_DIFFERENCE * sigma:
            compared = {"iteration": value, "sigma": sigma, "least_squares": least_squares}
            in_arcsec = {f"{key}_arcsec": float(np.rad2deg(v) * 3600) for key, v in compared.items()}
            raise InputError("recording.gimbal_disagrees", name=name, **in_arcsec)


def _with_observations(prior: Posterior, solved: list[_AxisSolution]) -> Posterior:
    """Update the prior with the observed misalignments (Kalman update)."""
    posterior = prior
    for axis in solved:
        rows, z = [INDEX[name] for name in axis.values], np.array(list(axis.values.values()))
        P, R = posterior.covariance, axis.covariance
        gain = np.linalg.solve(P[np.ix_(rows, rows)] + R, P[rows]).T
        I_KH = np.eye(len(posterior.mean))
        I_KH[:, rows] -= gain
        posterior = Posterior(posterior.mean + gain @ (z - posterior.mean[rows]), I_KH @ P @ I_KH.T + gain @ R @ gain.T)
    return posterior


def _axis(axis_turns: AxisTurns, schedule: Schedule) -> dict[str, Any]:
    """Return the convergence of an axis as JSON data."""
    angle = float(np.mean(np.abs(axis_turns.angles)))
    return {
        "axis": AXES[axis_turns.axis],
        "rows": [AXES[k] for k in other_axes(axis_turns.axis)],
        "angles": axis_turns.angles,
        "drifts": [d.tolist() for d in axis_turns.drifts],
        "corrections": [k.tolist() for k in axis_turns.corrections],
        "gain": schedule.gain,
        "largest_gain": largest_gain(schedule.order, axis_turns.axis, angle),
        "contraction": contraction(schedule.order, axis_turns.axis, angle, schedule.gain),
        "turns": len(axis_turns.angles),
    }


def _messages(iteration: GimbalIteration, schedule: Schedule) -> tuple[tuple[str, dict[str, Any]], ...]:
    messages: list[tuple[str, dict[str, Any]]] = []
    for axis_turns in iteration.courses:
        angle = float(np.mean(np.abs(axis_turns.angles)))
        limit = largest_gain(schedule.order, axis_turns.axis, angle)
        if schedule.gain >= limit:
            values = {"stage": "gimbal", "axis": AXES[axis_turns.axis], "gain": schedule.gain, "limit": limit}
            messages.append(("gimbal_unstable", values))
    missing = [a for k, a in enumerate(AXES) if k not in {c.axis for c in iteration.courses}]
    if missing:
        messages.append(("gimbal_axes_missing", {"stage": "gimbal", "axes": ", ".join(missing)}))
    return tuple(messages)


METHOD = Method(
    "gimbal",
    Schedule,
    plan,
    partial(BatchStage, solve),
    estimates=lambda context: ESTIMATED,
    needs_no_table=True,
    on_gimbal=True,
)
