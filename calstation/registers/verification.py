"""Verification of a unit's output after its registers were written.

Rests and turns are compared with the same rests and turns captured without the registers (`compare`). The reference is
the raw output (or the output with other registers) of the same unit in the same orientations, corrected by the written
parameters. Mounting, table orientation and encoder errors are common to both and cancel, as does the uncertainty of the
parameters. Only noise and the repeatability of the table remain.

Then the output alone is compared with known values: its magnitude at rest with gravity and earth rate, and its turns
with the encoders. If no encoder measures a turn, gravity at its end is compared with the gravity propagated by the
gyros. If a unit provides only raw output, the output is corrected here by the registers that were read back; this
verifies the unit's function, but not how it applies the registers.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from calstation.config import RunConfiguration
from calstation.devices import Imu
from calstation.devices.imu import JournalEntry, RegisterMap, TransferOutcome, TransferResult, TransferStep, restore
from calstation.errors import DeviceFaultError
from calstation.estimation.common import ImuModel, Posterior, SolveContext, filter_noise
from calstation.estimation.effects import effect_errors
from calstation.physics import (
    AXES,
    COUNT,
    INDEX,
    NAMES,
    OUTER,
    PARAMETERS,
    RATE,
    FloatArray,
    compensate,
    compensation,
    group_indices,
    group_matrix,
    group_vector,
    parameter_vector,
    rotation_matrix,
    values_at,
)
from calstation.records import context_from_meta, prior_from_meta
from calstation.sequencer import JointDrift, RunInBackground, TurnData, VerificationData

#: Maximum deviation in standard deviations; noise exceeds it with a probability below 1e-7 per check.
SIGMA_LIMIT = 6.0

#: Maximum drift of a gimbal in standard deviations; noise exceeds it with a probability of 3e-4 per axis.
DRIFT_SIGMA_LIMIT = 4.0

#: Maximum drift of a bias since it was estimated, in bias instabilities.
DRIFT_LIMIT = 3.0

#: Maximum change of a gyro's scale factor from the rate of its calibration to the rate of the turns.
_MAX_NONLINEARITY = 5e-4

#: Maximum cosine of the angle between the specific forces of two opposite rests.
_MAX_OPPOSITE_COSINE = -0.9

#: Checks that compare the output with the reference.
_DIFFERENCES = frozenset({"force_difference", "rate_difference", "turn_difference"})


@dataclass(frozen=True)
class VerificationCheck:
    """One comparison: measured value, expected value and tolerance, SI."""

    name: str
    value: float
    expected: float
    tolerance: float
    unit: str

    @property
    def passed(self) -> bool:
        """Whether the two values agree; False for NaN."""
        return abs(self.value - self.expected) <= self.tolerance

    def to_json(self) -> dict[str, Any]:
        """Return the data for JSON, with the outcome."""
        return {**asdict(self), "passed": self.passed}


@dataclass(frozen=True)
class AppliedRegisters:
    """Current registers of the unit, and those applied to the reference (None for raw output), by parameter, SI."""

    current: Mapping[str, float]
    reference: Mapping[str, float] | None = None

    def at(self, temperature: float | None) -> "AppliedRegisters":
        """Return the parameters that the unit applies at a temperature of its own sensor, °C."""
        reference = None if self.reference is None else values_at(self.reference, temperature)
        return AppliedRegisters(values_at(self.current, temperature), reference)


def finish_verification(
    setup: RunConfiguration,
    imu: Imu,
    transferred: TransferResult,
    data: VerificationData,
    run_in_background: RunInBackground | None = None,
) -> None:
    """Close the transfer of new registers, or restore the old ones and raise DeviceFaultError if the output is wrong.

    `run_in_background` runs a function while the table's watchdog is fed; None if no table moves.
    """
    run: RunInBackground = run_in_background or (lambda work: work())
    checks = _prior_checks(setup, transferred, data, restored=False)
    run(lambda: close_checked(imu, setup.register_map, transferred.entry, checks, data))


def finish_restored(setup: RunConfiguration, transferred: TransferResult, data: VerificationData) -> None:
    """Close the transfer of restored registers. Raises DeviceFaultError afterwards if the output is wrong."""
    entry = transferred.entry
    failed = [check for check in _prior_checks(setup, transferred, data, restored=True) if not check.passed]
    entry.note(TransferStep.VERIFICATION_FAILED if failed else verification_step(data))
    entry.close(TransferOutcome.RESTORED)
    if failed:
        raise _check_error("verification.old_wrong", failed[0])


def close_checked(
    imu: Imu,
    registers: RegisterMap,
    entry: JournalEntry,
    checks: Sequence[VerificationCheck],
    data: VerificationData,
    on_restored: Callable[[Mapping[str, float]], None] = lambda values: None,
) -> None:
    """Close the transfer if all checks passed; otherwise restore the old registers and raise DeviceFaultError.

    Parameters
    ----------
    imu : the unit
    registers : register map of the unit
    entry : open transfer in the journal
    checks : checks of the unit's output
    data : data that were checked
    on_restored : function that is called with the restored registers that were read back, SI by parameter
    """
    failed = next((check for check in checks if not check.passed), None)
    entry.note(verification_step(data) if failed is None else TransferStep.VERIFICATION_FAILED)
    if failed is None:
        entry.close(TransferOutcome.DONE)
        return
    on_restored(restore(imu, registers, entry))
    raise _check_error("verification.differs" if failed.name in _DIFFERENCES else "verification.wrong", failed)


def verification_step(data: VerificationData) -> TransferStep:
    """Return the journal step that records the verification of these data."""
    if not data.corrected:
        return TransferStep.READ_BACK
    return (
        TransferStep.VERIFIED_ROTATING
        if data.turns or data.drifts or len(data.carried)
        else TransferStep.VERIFIED_AT_REST
    )


def verified_on(data: VerificationData) -> str:
    """Return the kind of verified data: "corrected_output", or "read_back" if the unit has no corrected output."""
    return "corrected_output" if data.corrected else "read_back"


def _check_error(code: str, check: VerificationCheck) -> DeviceFaultError:
    return DeviceFaultError(
        code, check=check.name, value=check.value, unit=check.unit, expected=check.expected, tolerance=check.tolerance
    )


def _prior_checks(
    setup: RunConfiguration, transferred: TransferResult, data: VerificationData, *, restored: bool
) -> tuple[VerificationCheck, ...]:
    """Check the output without an estimate of a run, with the tolerances for any unit of the type."""
    meta = setup.log_meta()
    entry = transferred.entry
    registers = AppliedRegisters(entry.old if restored else entry.new, entry.old if setup.after_registers else None)
    prior = prior_from_meta(meta).covariance
    return verify_output(data, registers, prior, context_from_meta(meta), setup.repeatability)


def verify_output(
    data: VerificationData,
    registers: AppliedRegisters,
    covariance: FloatArray,
    context: SolveContext,
    repeatability: float,
    joints: Mapping[str, Mapping[str, float]] | None = None,
    effects: Mapping[str, float] = MappingProxyType({}),
) -> tuple[VerificationCheck, ...]:
    """Compare a unit's corrected output with its expected values.

    Parameters
    ----------
    data : captured rests and turns of the unit
    registers : registers of the unit and of the reference
    covariance : covariance of the parameters in the registers, SI, shape (30, 30)
    context : site, IMU and table
    repeatability : repeatability of the table's positions, rad, one sigma
    joints : `value` and `sigma` of each gyro misalignment relative to a gimbal's joint axes, if a run has measured them
    effects : sizes of known effects without a register, SI by parameter
    """
    polynomials, registers = registers, registers.at(data.temperature)
    if data.drifts:
        return tuple(_check_drift(drift, registers, covariance, context, joints) for drift in data.drifts)
    checks: list[VerificationCheck] = []
    if data.reference is not None:
        checks += compare(data, data.reference, polynomials.at(data.reference.temperature), context, repeatability)
    applied = {} if data.corrected else registers.current
    correction = compensation(parameter_vector(applied))
    omega, force = _compensated(np.array(data.rests), {**applied, **effects})
    site, imu, seconds = context.site, context.imu, data.seconds
    gravity = site.local_gravity
    noises = _force_noise(context, seconds), _rate_noise(imu, seconds)
    for f, w in zip(force, omega, strict=True):
        tolerance = _tolerance(covariance, "accel", f, noises[0], imu.accel_bias_instability)
        checks.append(VerificationCheck("gravity", float(np.linalg.norm(f)), gravity, tolerance, "m/s²"))
        tolerance = _tolerance(covariance, "gyro", w, noises[1], imu.gyro_bias_instability)
        checks.append(VerificationCheck("earth_rate", float(np.linalg.norm(w)), RATE, tolerance, "rad/s"))
    pair = _opposite_rests(force)
    if pair is not None:
        checks.append(_check_earth_rate_up(omega[pair], force[pair], covariance, context, noises[1]))
    for turned in data.turns:
        mean, _ = compensate(correction, (turned.angle / turned.seconds)[None], np.zeros((1, 3)))
        net = (mean[0] - omega[turned.turn.rest]) * turned.seconds
        checks.append(_check_turn(turned, net, covariance, context, repeatability, noises[1]))
    if len(data.carried):
        turning, _ = compensate(correction, data.carried[:, :3], data.carried[:, 3:])
        checks.append(_check_carried_turn(turning * data.period, force, covariance, context))
    return tuple(checks)


def _check_drift(
    turn_drift: JointDrift,
    registers: AppliedRegisters,
    covariance: FloatArray,
    context: SolveContext,
    joints: Mapping[str, Mapping[str, float]] | None,
) -> VerificationCheck:
    """Compare the drift of a gimbal's other joints in a turn with the drift expected from `joints`, or 0 if it is None.

    The mounting of the unit affects the registers and their covariance, but not the drift.
    """
    noise, J, axis = filter_noise(context), turn_drift.matrix, AXES[turn_drift.axis]
    names = [f"gyro_misalign_{a}{axis}" for a in AXES if a != axis]
    rows = [INDEX[name] for name in names]
    misalignment, expected = covariance[np.ix_(rows, rows)], np.zeros(2)
    if joints is not None:
        misalignment = np.diag([joints[name]["sigma"] ** 2 for name in names])
        expected = -J @ [joints[name]["value"] - registers.current[name] for name in names]
    random = noise.rate * (turn_drift.seconds + 1.2 * turn_drift.seconds**2 / turn_drift.rest)
    random += 2.0 * context.table.encoder_sigma**2
    scatter = J @ misalignment @ J.T + random * np.eye(2)
    tolerance = DRIFT_SIGMA_LIMIT * float(np.sqrt(np.linalg.eigvalsh(scatter)[-1]))
    difference = float(np.linalg.norm(turn_drift.drift - expected))
    return VerificationCheck(f"gimbal_drift_{axis}", difference, 0.0, tolerance, "rad")


def compare(
    data: VerificationData,
    reference: VerificationData,
    registers: AppliedRegisters,
    context: SolveContext,
    repeatability: float,
) -> tuple[VerificationCheck, ...]:
    """Compare each rest and turn of a unit's output with a reference.

    Parameters
    ----------
    data, reference : rests and turns with the current registers, and the same rests and turns without them
    registers : current registers, and those applied to the reference, at the temperature of the reference
    context : site, IMU and table
    repeatability : repeatability of the table's positions, rad, one sigma
    """
    expected = _expected_rests(np.array(reference.rests), registers)
    imu, count = context.imu, len(expected)
    measured = np.array(data.rests[:count])
    difference = measured - expected
    rate_noise = 2.0 * _rate_noise(imu, data.seconds) ** 2 * np.eye(3)
    force_noise = [_force_scatter(here[3:], data.seconds, context, repeatability) for here in expected]
    rate_drift, force_drift = (
        (DRIFT_LIMIT * instability) ** 2 * np.eye(3)
        for instability in (imu.gyro_bias_instability, imu.accel_bias_instability)
    )
    checks = []
    # The mean of all rests, which comes last, resolves smaller biases.
    for deviation, rate, force in (
        *((deviation, rate_noise, noise) for deviation, noise in zip(difference, force_noise, strict=True)),
        (difference.mean(axis=0), rate_noise / count, np.sum(force_noise, axis=0) / count**2),
    ):
        checks.append(_check_difference("force_difference", deviation[3:], force + force_drift, "m/s²"))
        checks.append(_check_difference("rate_difference", deviation[:3], rate + rate_drift, "rad/s"))
    for turn, reference_turn in zip(data.turns, reference.turns, strict=True):
        mean = _expected_rests((reference_turn.integral / reference_turn.seconds)[None], registers)[0]
        expected_turn = _net_turn(reference_turn, mean[:3] * reference_turn.seconds, expected)
        difference = _net_turn(turn, turn.angle, measured) - expected_turn
        scatter = _turn_scatter(expected_turn, (reference_turn.seconds, data.seconds), imu, repeatability)
        # Earth rate accumulates if one turn takes longer than the other.
        margin = 2.0 * RATE * abs(turn.seconds - reference_turn.seconds)
        checks.append(_check_difference("turn_difference", difference, scatter, "rad", margin))
    return tuple(checks)


def without_register(posterior: Posterior, registers: Mapping[str, float]) -> FloatArray:
    """Return the covariance of a posterior, shape (30, 30), increased for parameters that are not in `registers`."""
    unregistered = np.array(
        [0.0 if name in registers else value for name, value in zip(NAMES, posterior.mean, strict=True)]
    )
    return np.asarray(posterior.covariance + np.diag(unregistered**2))


def _opposite_rests(force: FloatArray) -> list[int] | None:
    up = force / np.linalg.norm(force, axis=1, keepdims=True)
    cosines = up @ up.T
    first, second = np.unravel_index(int(np.argmin(cosines)), cosines.shape)
    return [int(first), int(second)] if cosines[first, second] < _MAX_OPPOSITE_COSINE else None


def _check_earth_rate_up(
    omega: FloatArray, force: FloatArray, covariance: FloatArray, context: SolveContext, noise: float
) -> VerificationCheck:
    """Check the vertical earth rate from two opposite rests, without gyro bias, to detect a wrong latitude."""
    up = force / np.linalg.norm(force, axis=1, keepdims=True)
    residual = up.mean(axis=0)  # bias along this direction does not cancel
    biases = group_indices("gyro_bias")
    bias = float(np.sqrt(max(residual @ covariance[np.ix_(biases, biases)] @ residual, 0.0)))
    drift = DRIFT_LIMIT * context.imu.gyro_bias_instability
    scale = float(np.sqrt(np.diag(covariance)[group_indices("gyro_scale")].max()))
    sigma = np.sqrt(bias**2 + noise**2 / 2.0 + drift**2 + (scale * RATE) ** 2)
    value = float((omega * up).sum(axis=1).mean())
    expected = RATE * float(np.sin(context.site.latitude))
    return VerificationCheck("earth_rate_up", value, expected, SIGMA_LIMIT * float(sigma), "rad/s")


def _check_turn(
    turned: TurnData, net: FloatArray, covariance: FloatArray, context: SolveContext, repeatability: float, noise: float
) -> VerificationCheck:
    """Check the angle of a turn about any body axis against the encoder; `net` is free of bias and earth rate, rad."""
    angle, measured = abs(turned.turn.amount), float(np.linalg.norm(net))
    jacobian = np.zeros(COUNT)
    for i, p in enumerate(PARAMETERS):
        if p.group in ("gyro_scale", "gyro_misalign"):
            jacobian[i] = net[p.row] * net[p.column] / max(measured, 1e-9)
    encoder = repeatability if turned.turn.is_full else context.table.encoder_sigma
    variance = max(float(jacobian @ covariance @ jacobian), 0.0) + 2.0 * encoder**2
    variance += context.imu.gyro_arw**2 * turned.seconds + (noise * turned.seconds) ** 2
    name = "outer_turn" if turned.turn.joint == OUTER else "inner_turn"
    tolerance = SIGMA_LIMIT * float(np.sqrt(variance)) + _MAX_NONLINEARITY * angle
    return VerificationCheck(name, measured, angle, tolerance, "rad")


def _check_carried_turn(
    angles: FloatArray, force: FloatArray, covariance: FloatArray, context: SolveContext
) -> VerificationCheck:
    """Check, without encoders, the angle between gravity at the second rest and gravity propagated by the gyros, rad.

    `angles` are the rotations in every sample between the rests, rad; `force` is the mean at both rests, m/s².
    """
    sigma = np.sqrt(np.diag(covariance))
    seconds = len(angles) / context.imu.sample_rate
    path = float(np.linalg.norm(angles, axis=1).sum())
    before, after = force / np.linalg.norm(force, axis=1, keepdims=True)
    for angle in angles:
        before = rotation_matrix(angle).T @ before
    value = float(np.arctan2(np.linalg.norm(np.cross(before, after)), before @ after))
    matrix = max(sigma[group_indices(group)].max() for group in ("gyro_scale", "gyro_misalign"))
    bias = sigma[group_indices("gyro_bias")].max() + DRIFT_LIMIT * context.imu.gyro_bias_instability
    tilt = max(sigma[group_indices(group)].max() for group in ("accel_scale", "accel_misalign"))
    gravity = float(np.linalg.norm(force[0]))
    level = np.sqrt(2.0) * (tilt + sigma[group_indices("accel_bias")].max() / gravity)
    noise = context.imu.gyro_arw * np.sqrt(seconds)
    known = np.sqrt((matrix * path) ** 2 + (bias * seconds) ** 2 + level**2 + noise**2)
    return VerificationCheck("carried_turn", value, 0.0, SIGMA_LIMIT * float(known) + RATE * seconds, "rad")


def _tolerance(covariance: FloatArray, sensor: str, vector: FloatArray, noise: float, instability: float) -> float:
    """Return the tolerance of the magnitude of a corrected `vector` in any direction."""
    jacobian = np.zeros((3, COUNT))
    for i, p in enumerate(PARAMETERS):
        if p.group == f"{sensor}_bias":
            jacobian[p.row, i] = 1.0
        elif p.group in (f"{sensor}_scale", f"{sensor}_misalign"):
            jacobian[p.row, i] = vector[p.column]
        elif p.group == f"{sensor}_quadratic":
            jacobian[p.row, i] = vector[p.row] ** 2
    variance = float(np.linalg.eigvalsh(jacobian @ covariance @ jacobian.T)[-1])
    return SIGMA_LIMIT * float(np.sqrt(max(variance, 0.0) + noise**2 + (DRIFT_LIMIT * instability) ** 2))


def _expected_rests(rests: FloatArray, registers: AppliedRegisters) -> FloatArray:
    """Return the rests of the reference, corrected by the unit's current registers, shape (n, 6)."""
    raw = _raw_output(rests, registers.reference)
    return np.hstack(_compensated(raw, registers.current))


def _compensated(raw: FloatArray, parameters: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
    """Correct raw output at rest by parameters and effects; return rate and specific force, shape (n, 3)."""
    constants = compensation(parameter_vector(parameters))
    omega, force = compensate(constants, raw[:, :3], raw[:, 3:])
    reduced = raw - effect_errors(parameters, omega, force)
    return compensate(constants, reduced[:, :3], reduced[:, 3:])


def _raw_output(output: FloatArray, registers: Mapping[str, float] | None) -> FloatArray:
    """Return the raw output, shape (n, 6), of output corrected by `registers`; the size effect is 0 at rest."""
    if registers is None:
        return output
    p = parameter_vector(registers)
    gyro, accel = (np.eye(3) + group_matrix(p, f"{sensor}_scale", f"{sensor}_misalign") for sensor in ("gyro", "accel"))
    force = output[:, 3:]
    raw = np.hstack(
        [
            output[:, :3] @ gyro.T + group_vector(p, "gyro_bias"),
            force @ accel.T + group_vector(p, "accel_quadratic") * force**2 + group_vector(p, "accel_bias"),
        ]
    )
    return np.asarray(raw + effect_errors(registers, output[:, :3], force))


def _net_turn(turned: TurnData, angle: FloatArray, rests: FloatArray) -> FloatArray:
    """Return a turn minus the gyro output at rest (bias and earth rate along the axis), rad, shape (3,)."""
    return np.asarray(angle - rests[turned.turn.rest, :3] * turned.seconds)


def _force_scatter(force: FloatArray, seconds: float, context: SolveContext, repeatability: float) -> FloatArray:
    """Return the covariance of a force difference without bias drift, (m/s²)², shape (3, 3).

    Position errors of the table act only perpendicular to the force.
    """
    magnitude = float(np.linalg.norm(force))
    up = force / magnitude
    noise = 2.0 * _force_noise(context, seconds) ** 2 * np.eye(3)
    return np.asarray(noise + 2.0 * (repeatability * magnitude) ** 2 * (np.eye(3) - np.outer(up, up)))


def _turn_scatter(turn: FloatArray, seconds: tuple[float, float], imu: ImuModel, repeatability: float) -> FloatArray:
    """Return the covariance of a turn difference, rad², shape (3, 3), due to noise and errors of both joints."""
    duration, rest = seconds
    angle = float(np.linalg.norm(turn))
    along = np.outer(turn, turn) / angle**2
    noise = 2.0 * (imu.gyro_arw**2 * duration + (_rate_noise(imu, rest) * duration) ** 2)
    noise += 2.0 * (imu.gyro_bias_instability * duration) ** 2
    joint, other = 4.0 * repeatability**2, 2.0 * (repeatability * angle) ** 2
    return np.asarray(noise * np.eye(3) + joint * along + other * (np.eye(3) - along))


def _check_difference(
    name: str, difference: FloatArray, scatter: FloatArray, unit: str, margin: float = 0.0
) -> VerificationCheck:
    """Check the magnitude of a difference against its tolerance in the direction of the difference."""
    magnitude = float(np.linalg.norm(difference))
    direction = difference / magnitude if magnitude > 0.0 else np.array([1.0, 0.0, 0.0])
    sigma = 1.0 / np.sqrt(direction @ np.linalg.solve(scatter, direction))
    return VerificationCheck(name, magnitude, 0.0, SIGMA_LIMIT * float(sigma) + margin, unit)


def _rate_noise(imu: ImuModel, seconds: float) -> float:
    """Return the sigma of one gyro axis in `mean_at_rest`, rad/s; its variance is 6/5 of that of a plain mean."""
    return float(imu.gyro_arw * np.sqrt(1.2 / seconds))


def _force_noise(context: SolveContext, seconds: float) -> float:
    """Return the sigma of one accelerometer axis in `mean_at_rest`, m/s².

    It combines the sensor noise, as for the gyro, with the vibration of the base, which is the sigma σ √12 / (T √n) of
    the slope of a line fitted to n velocities over T; the table's profile specifies their sigma σ.
    """
    imu, table = context.imu, context.table
    count = seconds / table.velocity_interval
    vibration = table.velocity_sigma * np.sqrt(12.0 / count) / seconds
    return float(np.hypot(imu.accel_vrw * np.sqrt(1.2 / seconds), vibration))
