"""Is a unit's corrected output right? What it makes of its registers against what they mean, and against the world.

Rests and turns are compared with the same ones taken without the registers (`comparison`). Then the output alone with
what is known to be there: its size at rest against gravity and earth rate, turns against encoders; and where nothing
measures a turn, gravity at its end with where the gyros carried it. A unit that shows only its raw output is corrected
here by the registers that it gave back: that says that it works, and nothing of what it makes of them.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from calstation.config.resolved import ResolvedConfiguration
from calstation.devices.imu.registers import RegisterMap
from calstation.devices.imu.transfer import Closing, Entry, Step, Transferred, restore
from calstation.devices.interfaces import Imu
from calstation.errors import DeviceFaultError
from calstation.estimation.common.context import Belief, ImuModel, SolveContext
from calstation.physics.arrays import FloatArray
from calstation.physics.earth import RATE, normal_gravity
from calstation.physics.imu_model import compensate, compensation
from calstation.physics.parameters import COUNT, NAMES, PARAMETERS, group_indices, group_matrix, group_vector
from calstation.physics.rotation import rotation_matrix
from calstation.physics.table import OUTER
from calstation.records.meta import context_from_meta, prior_from_meta
from calstation.sequencer.capture import Turned, VerificationData
from calstation.sequencer.driving import RunInBackground

#: Off by more than this many standard deviations is wrong: noise reaches it once in 10^8 times.
SIGMAS = 6.0

#: Bias instabilities that a bias may have wandered since it was found.
WANDER = 3.0


@dataclass(frozen=True)
class VerificationCheck:
    """One comparison: what was measured, what was expected, and how far they may be apart, SI."""

    name: str
    value: float
    expected: float
    tolerance: float
    unit: str

    @property
    def passed(self) -> bool:
        """Whether the two agree; what is no number does not."""
        return abs(self.value - self.expected) <= self.tolerance

    def to_json(self) -> dict[str, Any]:
        """As a result holds it."""
        return {**asdict(self), "passed": self.passed}


def rate_noise(imu: ImuModel, seconds: float) -> float:
    """Sigma of one axis of `mean_at_rest` of the gyro, rad/s: 6/5 of a plain mean's variance."""
    return float(imu.gyro_arw * np.sqrt(1.2 / seconds))


def force_noise(context: SolveContext, seconds: float) -> float:
    """Sigma of one axis of `mean_at_rest` of the accelerometer, m/s².

    Its own noise as the gyro's, and the base's vibration: the slope of a line through velocities of the sigma that the
    table's profile states, as many as it says, σ √12 / (T √n).
    """
    imu, table = context.imu, context.table
    count = seconds / table.velocity_interval
    vibration = table.velocity_sigma * np.sqrt(12.0 / count) / seconds
    return float(np.hypot(imu.accel_vrw * np.sqrt(1.2 / seconds), vibration))


#: Names of these comparisons.
DIFFERENCES = ("force_difference", "rate_difference", "turn_difference")


@dataclass(frozen=True)
class AppliedRegisters:
    """What the unit holds, and what was in force in the reference; None where that was the raw output. SI by name."""

    held: Mapping[str, float]
    before: Mapping[str, float] | None = None


def compare(
    fresh: VerificationData,
    reference: VerificationData,
    registers: AppliedRegisters,
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


def _meant(rests: FloatArray, registers: AppliedRegisters) -> FloatArray:
    """What the reference's rests are with the registers that are held now, shape (n, 6)."""
    raw = _undone(rests, registers.before)
    omega, force = compensate(compensation(_vector(registers.held)), raw[:, :3], raw[:, 3:])
    return np.hstack([omega, force])


def _meant_turn(turned: Turned, registers: AppliedRegisters) -> FloatArray:
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


#: By which a gyro's scale at the rate of the turns may differ from that at the rate it was calibrated at.
_LINEAR = 5e-4

#: Cosine between the forces of two rests that are upside down to each other.
_OPPOSITE = -0.9


def verify_output(
    fresh: VerificationData,
    registers: AppliedRegisters,
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


def output_error(check: VerificationCheck, so: str) -> DeviceFaultError:
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


def verified_on(fresh: VerificationData) -> str:
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


def run_inline(work: Callable[[], Any]) -> Any:
    """Does a work where no table needs to be looked after meanwhile."""
    return work()


def finish_verification(
    setup: ResolvedConfiguration,
    imu: Imu,
    done: Transferred,
    fresh: VerificationData,
    run_in_background: RunInBackground = run_inline,
) -> None:
    """Close the journal's entry of new registers; where the output is wrong with them, the old ones are put back.

    Raises DeviceFaultError.
    """
    entry = done.entry
    wrong = _wrong(setup, done, fresh, back=False)
    if wrong:
        run_in_background(lambda: restore_refuted(imu, RegisterMap(tuple(setup.imu.registers)), entry))
        raise output_error(wrong[0], "its old registers were put back")
    run_in_background(lambda: close_verified(entry, fresh))


def restore_refuted(imu: Imu, entries: RegisterMap, entry: Entry) -> Mapping[str, float]:
    """Give a unit whose output was refuted its old registers back; what it holds then."""
    entry.note(Step.REFUTED)
    return restore(imu, entries, entry)


def close_verified(entry: Entry, fresh: VerificationData) -> None:
    """Close the journal's entry of registers whose output is right."""
    entry.note(verification_step(fresh))
    entry.close(Closing.DONE)


def judge_restored(setup: ResolvedConfiguration, done: Transferred, fresh: VerificationData) -> None:
    """Close the entry of registers that were put back: the unit is as it was, whatever its output is worth.

    Raises DeviceFaultError where that is wrong.
    """
    entry = done.entry
    wrong = _wrong(setup, done, fresh, back=True)
    entry.note(Step.REFUTED if wrong else verification_step(fresh))
    entry.close(Closing.RESTORED)
    if wrong:
        check = wrong[0]
        raise DeviceFaultError(
            f"IMU: its old registers are back, but with them {check.name} measures {check.value:.6g} {check.unit},"
            f" expected {check.expected:.6g} within {check.tolerance:.2g}; calibrate the unit before it is used"
        )


def _wrong(
    setup: ResolvedConfiguration, done: Transferred, fresh: VerificationData, *, back: bool
) -> list[VerificationCheck]:
    meta = setup.log_meta()
    entry = done.entry
    registers = AppliedRegisters(
        entry.old if back else entry.new, entry.old if setup.after_registers else None
    )
    prior = prior_from_meta(meta).covariance
    checks = verify_output(fresh, registers, prior, context_from_meta(meta), setup.repeatability)
    return [check for check in checks if not check.passed]


def verification_step(fresh: VerificationData) -> Step:
    """What the journal says of a proof."""
    if not fresh.corrected:
        return Step.READ_BACK
    return Step.TURNED if fresh.turns or len(fresh.carried) else Step.AT_REST
