"""Is a unit's corrected output right? What it makes of its registers against what they mean, and against the world.

Rests and turns are compared with the same ones taken without the registers (`comparison`). Then the output alone with
what is known to be there: its size at rest against gravity and earth rate, turns against encoders; and where nothing
measures a turn, gravity at its end with where the gyros carried it. A unit that shows only its raw output is corrected
here by the registers that it gave back: that says that it works, and nothing of what it makes of them.
"""

from collections.abc import Mapping

import numpy as np

from calstation.errors import DeviceFaultError
from calstation.estimation.common.context import Belief, SolveContext
from calstation.physics.arrays import FloatArray
from calstation.physics.earth import RATE, normal_gravity
from calstation.physics.imu_model import compensate, compensation
from calstation.physics.parameters import COUNT, NAMES, PARAMETERS, group_indices
from calstation.physics.rotation import rotation_matrix
from calstation.physics.table import OUTER
from calstation.registers.comparison import DIFFERENCES, Registers, compare
from calstation.registers.verification_check import SIGMAS, WANDER, VerificationCheck, force_noise, rate_noise
from calstation.sequencer.capture import Turned, VerificationData

#: By which a gyro's scale at the rate of the turns may differ from that at the rate it was calibrated at.
_LINEAR = 5e-4

#: Cosine between the forces of two rests that are upside down to each other.
_OPPOSITE = -0.9


def prove(
    fresh: VerificationData,
    registers: Registers,
    covariance: FloatArray,
    context: SolveContext,
    repeatability: float,
) -> tuple[VerificationCheck, ...]:
    """Compare a unit's corrected output with what it should be.

    Parameters
    ----------
    covariance : of the parameters that the registers hold, SI, shape (30, 30)
    context : site, noise and table
    repeatability : of the table, rad: how far apart it stands after two moves to the same angle, one sigma
    """
    checks: list[VerificationCheck] = []
    if fresh.reference is not None:
        checks += compare(fresh, fresh.reference, registers, context, repeatability)
    own = np.zeros(COUNT) if fresh.corrected else np.array([registers.held.get(n, 0.0) for n in NAMES])
    correction = compensation(own)
    rests = np.array(fresh.rests)
    omega, force = compensate(correction, rests[:, :3], rests[:, 3:])
    site, imu, seconds = context.site, context.imu, fresh.seconds
    gravity = site.gravity or normal_gravity(site.latitude, site.height)
    noises = force_noise(context, seconds), rate_noise(imu, seconds)
    for f, w in zip(force, omega, strict=True):
        tolerance = _tolerance(covariance, "accel", f, noises[0], imu.accel_bias_instability)
        checks.append(VerificationCheck("gravity", float(np.linalg.norm(f)), gravity, tolerance, "m/s²"))
        tolerance = _tolerance(covariance, "gyro", w, noises[1], imu.gyro_bias_instability)
        checks.append(VerificationCheck("earth_rate", float(np.linalg.norm(w)), RATE, tolerance, "rad/s"))
    pair = _opposite(force)
    if pair is not None:
        checks.append(_earth_rate_up(omega[pair], force[pair], covariance, context, noises[1]))
    for turned in fresh.turns:
        mean, _ = compensate(correction, (turned.angle / turned.seconds)[None], np.zeros((1, 3)))
        net = (mean[0] - omega[turned.turn.still]) * turned.seconds
        checks.append(_turn(turned, net, covariance, context, repeatability, noises[1]))
    if len(fresh.carried):
        turning, _ = compensate(correction, fresh.carried[:, :3], fresh.carried[:, 3:])
        checks.append(_carried_turn(turning * fresh.period, force, covariance, context))
    return tuple(checks)


def refuted(check: VerificationCheck, so: str) -> DeviceFaultError:
    """The fault of a unit whose corrected output is wrong; `so` : what became of its registers."""
    if check.name in DIFFERENCES:
        return DeviceFaultError(
            f"IMU: the unit makes of its new registers something else than they mean: {check.name}"
            f" {check.value:.6g} {check.unit}, at most {check.tolerance:.2g}; {so}; look whether the table was"
            " disturbed, and correct the IMU profile's convention, sign, order and places of the registers; then run"
            " again"
        )
    return DeviceFaultError(
        f"IMU: with its new registers {check.name} measures {check.value:.6g} {check.unit}, expected"
        f" {check.expected:.6g} within {check.tolerance:.2g}; {so}; look whether the table was disturbed,"
        " whether latitude and gravity in the station file are right, and whether the IMU profile's registers"
        " mean what the unit makes of them; then run again"
    )


def proved_on(fresh: VerificationData) -> str:
    """What a proof was made on: the unit's "corrected_output", or "read_back" where it shows none."""
    return "corrected_output" if fresh.corrected else "read_back"


def without_register(belief: Belief, held: Mapping[str, float]) -> FloatArray:
    """Covariance of a belief, shape (30, 30), widened by what the unit has no register for and so cannot take off.

    held : registers that it has, by parameter
    """
    left = np.array([0.0 if name in held else value for name, value in zip(NAMES, belief.mean, strict=True)])
    return np.asarray(belief.covariance + np.diag(left**2))


def _opposite(force: FloatArray) -> list[int] | None:
    """Two rests upside down to each other."""
    up = force / np.linalg.norm(force, axis=1, keepdims=True)
    cosines = up @ up.T
    first, second = np.unravel_index(int(np.argmin(cosines)), cosines.shape)
    return [int(first), int(second)] if cosines[first, second] < _OPPOSITE else None


def _earth_rate_up(
    omega: FloatArray, force: FloatArray, covariance: FloatArray, context: SolveContext, noise: float
) -> VerificationCheck:
    """The earth's rate about the vertical, of two rests upside down to each other: a gyro's bias is not in it.

    It shows a wrong latitude, and with it a wrong normal gravity.
    """
    up = force / np.linalg.norm(force, axis=1, keepdims=True)
    left = up.mean(axis=0)  # what of the biases the turn does not cancel
    biases = group_indices("gyro_bias")
    bias = float(np.sqrt(max(left @ covariance[np.ix_(biases, biases)] @ left, 0.0)))
    wander = WANDER * context.imu.gyro_bias_instability
    scale = float(np.sqrt(np.diag(covariance)[group_indices("gyro_scale")].max()))
    sigma = np.sqrt(bias**2 + noise**2 / 2.0 + wander**2 + (scale * RATE) ** 2)
    value = float((omega * up).sum(axis=1).mean())
    return VerificationCheck(
        "earth_rate_up", value, RATE * float(np.sin(context.site.latitude)), SIGMAS * float(sigma), "rad/s"
    )


def _turn(
    turned: Turned,
    net: FloatArray,
    covariance: FloatArray,
    context: SolveContext,
    repeatability: float,
    noise: float,
) -> VerificationCheck:
    """The size of a turn against the encoder, whatever its axis in the body; `net` : without bias and earth, rad."""
    size, measured = abs(turned.turn.amount), float(np.linalg.norm(net))
    jacobian = np.zeros(COUNT)
    for i, p in enumerate(PARAMETERS):
        if p.group in ("gyro_scale", "gyro_misalign"):
            jacobian[i] = net[p.row] * net[p.column] / max(measured, 1e-9)
    encoder = repeatability if turned.turn.whole else context.table.encoder_sigma
    variance = max(float(jacobian @ covariance @ jacobian), 0.0) + 2.0 * encoder**2
    variance += context.imu.gyro_arw**2 * turned.seconds + (noise * turned.seconds) ** 2
    name = "outer_turn" if turned.turn.joint == OUTER else "inner_turn"
    return VerificationCheck(name, measured, size, SIGMAS * float(np.sqrt(variance)) + _LINEAR * size, "rad")


def _carried_turn(
    angles: FloatArray, force: FloatArray, covariance: FloatArray, context: SolveContext
) -> VerificationCheck:
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
    bias = sigma[group_indices("gyro_bias")].max() + WANDER * context.imu.gyro_bias_instability
    tilt = max(sigma[group_indices(group)].max() for group in ("accel_scale", "accel_misalign"))
    size = float(np.linalg.norm(force[0]))
    level = np.sqrt(2.0) * (tilt + sigma[group_indices("accel_bias")].max() / size)
    noise = context.imu.gyro_arw * np.sqrt(seconds)
    known = np.sqrt((matrix * path) ** 2 + (bias * seconds) ** 2 + level**2 + noise**2)
    return VerificationCheck("carried_turn", value, 0.0, SIGMAS * float(known) + RATE * seconds, "rad")


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
    return SIGMAS * float(np.sqrt(max(variance, 0.0) + noise**2 + (WANDER * instability) ** 2))
