"""Is a unit's corrected output right? Its size at rest against gravity and earth rate, short turns against encoders.

Where nothing measures a turn, gravity at its end is seen where the gyros carried it.

The registers are those read from the restarted unit. Where its stream follows them it is the corrected output;
where it precedes them it is corrected here as the unit would.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from calstation.errors import DeviceFaultError
from calstation.estimation.context import SolveContext
from calstation.physics.arrays import FloatArray
from calstation.physics.earth import RATE, normal_gravity
from calstation.physics.imu_model import compensate, compensation
from calstation.physics.parameters import COUNT, NAMES, PARAMETERS, group_indices
from calstation.physics.rotation import rotation_matrix
from calstation.sequencer.fresh_data import FreshData, Turned

SIGMAS = 6.0
"""Off by more than this many standard deviations is wrong: noise reaches it once in 10^9 times."""

_WANDER = 3.0
"""Bias instabilities that a bias may have wandered since it was found."""

_DIRECTION = np.deg2rad(5.0)
"""Between a turn's declared and measured axis, rad: what mounting may be off."""


@dataclass(frozen=True)
class Proven:
    """One comparison: what was measured, what was expected, and how far they may be apart, SI."""

    name: str
    value: float
    expected: float
    tolerance: float
    unit: str

    @property
    def passed(self) -> bool:
        """Whether the two agree."""
        return abs(self.value - self.expected) <= self.tolerance

    def to_json(self) -> dict[str, Any]:
        """As a result holds it."""
        return {**asdict(self), "passed": self.passed}


def prove(
    fresh: FreshData,
    registers: Mapping[str, float] | None,
    covariance: FloatArray,
    context: SolveContext,
) -> tuple[Proven, ...]:
    """Compare a unit's corrected output with what is known to be there.

    Parameters
    ----------
    registers : read from the unit, by parameter, SI; None where its stream follows them
    covariance : of the parameters that the registers hold, SI, shape (30, 30)
    context : site, noise and table
    """
    values = np.array([(registers or {}).get(name, 0.0) for name in NAMES])
    correction = compensation(values)
    rests = np.array(fresh.rests)
    omega, force = compensate(correction, rests[:, :3], rests[:, 3:])
    site, seconds = context.site, fresh.seconds
    gravity = site.gravity or normal_gravity(site.latitude, site.height)
    imu, table = context.imu, context.table
    force_noise = np.hypot(imu.accel_vrw / np.sqrt(seconds), np.sqrt(2.0) * table.velocity_sigma / seconds)
    rate_noise = imu.gyro_arw / np.sqrt(seconds)
    checks = [
        Proven(name, float(np.linalg.norm(vector)), expected, tolerance, unit)
        for f, w in zip(force, omega, strict=True)
        for name, vector, expected, tolerance, unit in (
            (
                "gravity",
                f,
                gravity,
                _tolerance(covariance, "accel", f, force_noise, imu.accel_bias_instability),
                "m/s²",
            ),
            (
                "earth_rate",
                w,
                RATE,
                _tolerance(covariance, "gyro", w, rate_noise, imu.gyro_bias_instability),
                "rad/s",
            ),
        )
    ]
    scale_sigma = float(np.sqrt(np.diag(covariance)[group_indices("gyro_scale")].max()))
    if len(rests) > 1:
        checks.append(_earth_rate_up(omega, force, covariance, context, rate_noise, scale_sigma))
    for name, turn in zip(("outer", "inner"), fresh.turns, strict=False):
        rate, _ = compensate(correction, turn.rate[None], np.zeros((1, 3)))
        checks += _turn(name, turn, rate[0], scale_sigma, context)
    if len(fresh.carried):
        turning, _ = compensate(correction, fresh.carried[:, :3], fresh.carried[:, 3:])
        checks.append(_carried_turn(turning * fresh.period, force, covariance, context))
    return tuple(checks)


def _earth_rate_up(
    omega: FloatArray,
    force: FloatArray,
    covariance: FloatArray,
    context: SolveContext,
    noise: float,
    scale_sigma: float,
) -> Proven:
    """The earth's rate about the vertical, of two rests upside down to each other: a gyro's bias is not in it.

    It shows a wrong latitude, and with it a wrong normal gravity.
    """
    up = force / np.linalg.norm(force, axis=1, keepdims=True)
    left = up.mean(axis=0)  # what of the biases the turn does not cancel
    biases = group_indices("gyro_bias")
    bias = float(np.sqrt(max(left @ covariance[np.ix_(biases, biases)] @ left, 0.0)))
    wander = _WANDER * context.imu.gyro_bias_instability
    sigma = np.sqrt(bias**2 + noise**2 / 2.0 + wander**2 + (scale_sigma * RATE) ** 2)
    value = float((omega * up).sum(axis=1).mean())
    return Proven(
        "earth_rate_up", value, RATE * float(np.sin(context.site.latitude)), SIGMAS * float(sigma), "rad/s"
    )


def refuted(check: Proven, so: str) -> DeviceFaultError:
    """The fault of a unit whose corrected output is wrong; `so` : what became of its registers."""
    return DeviceFaultError(
        f"IMU: with its new registers {check.name} measures {check.value:.6g} {check.unit}, expected"
        f" {check.expected:.6g} within {check.tolerance:.2g}; {so}; look whether the table was disturbed,"
        " whether latitude and gravity in the station file are right, and whether the IMU profile's registers"
        " mean what the unit makes of them; then run again"
    )


def _turn(
    name: str, turn: Turned, rate: FloatArray, scale_sigma: float, context: SolveContext
) -> tuple[Proven, Proven]:
    measured = rate * turn.seconds
    size = float(np.linalg.norm(turn.expected))
    along = float(measured @ turn.expected) / size
    off = float(np.arctan2(np.linalg.norm(np.cross(measured, turn.expected)) / size, along))
    known = np.sqrt(2.0) * context.table.encoder_sigma + scale_sigma * size
    noise = context.imu.gyro_arw * np.sqrt(turn.seconds)
    tolerance = SIGMAS * float(known + noise) + RATE * turn.seconds + size * (1.0 - np.cos(_DIRECTION))
    return (
        Proven(f"{name}_turn", along, size, float(tolerance), "rad"),
        Proven(f"{name}_turn_axis", off, 0.0, _DIRECTION, "rad"),
    )


def _carried_turn(
    angles: FloatArray, force: FloatArray, covariance: FloatArray, context: SolveContext
) -> Proven:
    """Between gravity at the second rest and where the gyros carried it from the first, rad: no encoder is needed.

    Parameters
    ----------
    angles : corrected output of every sample on the way, rad, shape (n, 3)
    force : corrected mean at both rests, m/s², shape (2, 3)
    """
    sigma = np.sqrt(np.diag(covariance))
    seconds = len(angles) / context.imu.sample_rate
    path = float(np.linalg.norm(angles, axis=1).sum())
    before, after = force / np.linalg.norm(force, axis=1, keepdims=True)
    for angle in angles:
        before = rotation_matrix(angle).T @ before
    value = float(np.arctan2(np.linalg.norm(np.cross(before, after)), before @ after))
    matrix = max(sigma[group_indices(group)].max() for group in ("gyro_scale", "gyro_misalign"))
    bias = sigma[group_indices("gyro_bias")].max() + _WANDER * context.imu.gyro_bias_instability
    tilt = max(sigma[group_indices(group)].max() for group in ("accel_scale", "accel_misalign"))
    size = float(np.linalg.norm(force[0]))
    level = np.sqrt(2.0) * (tilt + sigma[group_indices("accel_bias")].max() / size)
    noise = context.imu.gyro_arw * np.sqrt(seconds)
    known = np.sqrt((matrix * path) ** 2 + (bias * seconds) ** 2 + level**2 + noise**2)
    return Proven("carried_turn", value, 0.0, SIGMAS * float(known) + RATE * seconds, "rad")


def _tolerance(
    covariance: FloatArray, sensor: str, seen: FloatArray, noise: float, instability: float
) -> float:
    """How far the size of a corrected vector `seen` may be off, whatever its direction."""
    jacobian = np.zeros((3, COUNT))
    for i, p in enumerate(PARAMETERS):
        if p.group == f"{sensor}_bias":
            jacobian[p.row, i] = 1.0
        elif p.group in (f"{sensor}_scale", f"{sensor}_misalign"):
            jacobian[p.row, i] = seen[p.column]
        elif p.group == f"{sensor}_quadratic":
            jacobian[p.row, i] = seen[p.row] ** 2
    variance = float(np.linalg.eigvalsh(jacobian @ covariance @ jacobian.T)[-1])
    return SIGMAS * float(np.sqrt(max(variance, 0.0) + noise**2 + (_WANDER * instability) ** 2))
