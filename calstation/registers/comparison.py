"""Does a unit make of its registers what they mean? Its own output against the same rests and turns worked out here.

The reference is the raw output (or that behind other registers) of the same unit in the same poses, corrected by the
parameters that were written. How the unit is mounted, how the table stands and what its encoders are off are in both
and drop out; so is how well the parameters are known. What is left is noise and how well the table comes back.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calstation.estimation.common.context import ImuModel, SolveContext
from calstation.physics.arrays import FloatArray
from calstation.physics.earth import RATE
from calstation.physics.imu_model import compensate, compensation
from calstation.physics.parameters import NAMES, group_matrix, group_vector
from calstation.registers.verification_check import SIGMAS, WANDER, VerificationCheck, force_noise, rate_noise
from calstation.sequencer.capture import Turned, VerificationData

#: Names of these comparisons.
DIFFERENCES = ("force_difference", "rate_difference", "turn_difference")


@dataclass(frozen=True)
class Registers:
    """What the unit holds, and what was in force in the reference; None where that was the raw output. SI by name."""

    held: Mapping[str, float]
    before: Mapping[str, float] | None = None


def compare(
    fresh: VerificationData,
    reference: VerificationData,
    registers: Registers,
    context: SolveContext,
    repeatability: float,
) -> tuple[VerificationCheck, ...]:
    """Compare each rest and each turn of a unit's own output with its reference.

    Parameters
    ----------
    repeatability : of the table, rad: how far apart it stands after two moves to the same angle, one sigma
    """
    seen, meant = np.array(fresh.rests), _meant(np.array(reference.rests), registers)
    checks = []
    for own, here in zip(seen, meant, strict=True):
        force, rate = own[3:] - here[3:], own[:3] - here[:3]
        checks.append(
            _within(
                "force_difference",
                force,
                _force_scatter(here[3:], fresh.seconds, context, repeatability),
                "m/s²",
            )
        )
        checks.append(
            _within("rate_difference", rate, _rate_scatter(fresh.seconds, context.imu) * np.eye(3), "rad/s")
        )
    for own_turn, before in zip(fresh.turns, reference.turns, strict=True):
        there = _net(before, _meant_turn(before, registers), meant)
        apart = _net(own_turn, own_turn.angle, seen) - there
        scatter = _turn_scatter(there, before.seconds, fresh.seconds, context.imu, repeatability)
        # The earth turns on while one turn takes longer than the other.
        more = 2.0 * RATE * abs(own_turn.seconds - before.seconds)
        checks.append(_within("turn_difference", apart, scatter, "rad", more))
    return tuple(checks)


def _meant(rests: FloatArray, registers: Registers) -> FloatArray:
    """What the reference's rests are with the registers that are held now, shape (n, 6)."""
    raw = _undone(rests, registers.before)
    omega, force = compensate(compensation(_vector(registers.held)), raw[:, :3], raw[:, 3:])
    return np.hstack([omega, force])


def _meant_turn(turned: Turned, registers: Registers) -> FloatArray:
    """Integral of the reference's rate over a turn with the registers that are held now, rad, shape (3,)."""
    mean = np.hstack([turned.angle / turned.seconds, np.zeros(3)])[None]
    return _meant(mean, registers)[0, :3] * turned.seconds


def _undone(output: FloatArray, registers: Mapping[str, float] | None) -> FloatArray:
    """The raw output behind what a unit gave with registers, shape (n, 6); the size effect, 0 at rest, left aside."""
    if registers is None:
        return output
    p = _vector(registers)
    gyro, accel = (
        np.eye(3) + group_matrix(p, f"{sensor}_scale", f"{sensor}_misalign") for sensor in ("gyro", "accel")
    )
    force = output[:, 3:]
    return np.hstack(
        [
            output[:, :3] @ gyro.T + group_vector(p, "gyro_bias"),
            force @ accel.T + group_vector(p, "accel_quadratic") * force**2 + group_vector(p, "accel_bias"),
        ]
    )


def _net(turned: Turned, angle: FloatArray, rests: FloatArray) -> FloatArray:
    """A turn without what the gyro shows at rest, its bias and the earth's rate along the axis, rad, shape (3,)."""
    return np.asarray(angle - rests[turned.turn.still, :3] * turned.seconds)


def _force_scatter(
    force: FloatArray, seconds: float, context: SolveContext, repeatability: float
) -> FloatArray:
    """Covariance of a force's difference, (m/s²)², shape (3, 3): across it the table's tilt shows, along it not."""
    size = float(np.linalg.norm(force))
    up = force / size
    noise = (
        2.0 * force_noise(context, seconds) ** 2 + (WANDER * context.imu.accel_bias_instability) ** 2
    ) * np.eye(3)
    return np.asarray(noise + 2.0 * (repeatability * size) ** 2 * (np.eye(3) - np.outer(up, up)))


def _rate_scatter(seconds: float, imu: ImuModel) -> float:
    """Variance of a rate's difference, (rad/s)²."""
    return 2.0 * rate_noise(imu, seconds) ** 2 + (WANDER * imu.gyro_bias_instability) ** 2


def _turn_scatter(
    turn: FloatArray, seconds: float, rest: float, imu: ImuModel, repeatability: float
) -> FloatArray:
    """Covariance of a turn's difference, rad², shape (3, 3): along it the joint's angle, across it the other's."""
    size = float(np.linalg.norm(turn))
    along = np.outer(turn, turn) / size**2
    noise = 2.0 * (imu.gyro_arw**2 * seconds + (rate_noise(imu, rest) * seconds) ** 2)
    noise += 2.0 * (imu.gyro_bias_instability * seconds) ** 2
    joint, other = 4.0 * repeatability**2, 2.0 * (repeatability * size) ** 2
    return np.asarray(noise * np.eye(3) + joint * along + other * (np.eye(3) - along))


def _within(
    name: str, apart: FloatArray, scatter: FloatArray, unit: str, more: float = 0.0
) -> VerificationCheck:
    """How far a vector is off, and how far it may be in that direction."""
    size = float(np.linalg.norm(apart))
    way = apart / size if size > 0.0 else np.array([1.0, 0.0, 0.0])
    sigma = 1.0 / np.sqrt(way @ np.linalg.solve(scatter, way))
    return VerificationCheck(name, size, 0.0, SIGMAS * float(sigma) + more, unit)


def _vector(values: Mapping[str, float]) -> FloatArray:
    return np.array([values.get(name, 0.0) for name in NAMES])
