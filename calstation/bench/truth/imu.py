"""Measurements of the unit, derived from the true motion with the contract's error model, noise and quantisation."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from calstation.bench.truth.base_motion import BaseMotion
from calstation.bench.truth.effects import (
    ACCEL_ASYMMETRY,
    ACCEL_CROSS,
    ACCEL_CUBIC,
    ACCEL_FIFTH,
    ACCEL_MOVING_BIAS,
    ACCEL_RATE_SQUARE,
    G_SENSITIVITY,
    GYRO_ASYMMETRY,
    GYRO_CUBIC,
    GYRO_FIFTH,
    GYRO_FLEX,
    GYRO_G_SQUARE,
    GYRO_MOVING_BIAS,
    GYRO_SQUARE,
    Changes,
    EffectTruth,
)
from calstation.bench.truth.kinematics import JointProfile, joint_state
from calstation.bench.truth.noise import Vibration, draw_instability, instability_steps
from calstation.bench.truth.table import TableTruth, body_motion, to_body
from calstation.bench.truth.thermal import GRID, REFERENCE, UnitThermal
from calstation.physics import BoolArray, FloatArray, group_matrix, group_vector, kernel

#: First rows of the parts of `ImuTruth.error_model`.
_GYRO, _ACCEL, _GYRO_BIAS, _ACCEL_BIAS, _QUADRATIC, _SITES, _TERMS = 0, 3, 6, 7, 8, 9, 12


@dataclass(frozen=True)
class ImuTruth:
    """The true errors, noise and output of a unit, SI.

    `output` is "increment" (LSBs in rad and m/s) or "rate" (mean over the sample, LSBs in rad/s and m/s²). Bias
    instabilities are the flicker coefficients B. The output saturates at the ranges.
    """

    parameters: FloatArray
    sample_rate: float
    output: str
    gyro_lsb: float
    accel_lsb: float
    gyro_arw: float
    accel_vrw: float
    gyro_bias_instability: float = 0.0
    accel_bias_instability: float = 0.0
    gyro_range: float = 17.5
    accel_range: float = 400.0
    effects: EffectTruth = field(default_factory=EffectTruth)

    @property
    def interval(self) -> float:
        """True duration of a sample, s."""
        return 1.0 / (self.sample_rate * (1.0 + self.effects.clock))

    def error_model(self) -> FloatArray:
        """Return rows I + M_g (3), I + M_a (3), b_g, b_a, K2, positions of the accelerometers (3), and `effects.terms`.

        The shape is (12 + `TERM_ROWS`, 3).
        """
        p = self.parameters
        sites = group_vector(p, "outer_lever") + np.diag(group_vector(p, "inner_lever")) + self.effects.off_axis
        return np.vstack(
            [
                np.eye(3) + group_matrix(p, "gyro_scale", "gyro_misalign"),
                np.eye(3) + group_matrix(p, "accel_scale", "accel_misalign"),
                group_vector(p, "gyro_bias"),
                group_vector(p, "accel_bias"),
                group_vector(p, "accel_quadratic"),
                sites,
                self.effects.terms,
            ]
        )


#: Gauss-Legendre nodes and weights on (0, 1), exact to the fifth degree.
GAUSS_NODES = (0.5 - np.sqrt(0.15), 0.5, 0.5 + np.sqrt(0.15))
GAUSS_WEIGHTS = (5.0 / 18.0, 4.0 / 9.0, 5.0 / 18.0)


#: Gauss-Laguerre nodes and weights: a first-order low-pass is a mean over exponentially distributed delays.
LAGUERRE = tuple(np.polynomial.laguerre.laggauss(4))
#: Rate of a joint above which a motor runs, rad/s.
MOVING = 1e-3


@kernel
def _measured_rates(
    model: FloatArray,
    chain: FloatArray,
    outer: FloatArray,
    inner: FloatArray,
    field: FloatArray,
    vectors: FloatArray,
    rates: FloatArray,
) -> None:
    """Write the noise-free output of the six channels at one time to `rates`; `field` is (up force, ω_ie) in n."""
    vectors[0], vectors[1], vectors[2] = field[0], field[1], 0.0
    body_motion(chain, outer, inner, vectors)
    force, w, a = vectors[0], vectors[1], vectors[2]
    terms = model[_TERMS:]
    for i in range(3):
        # Row i of ω×(ω×r) + ω'×r at accelerometer i, which senses only the component along e_i.
        x, y, z = model[_SITES + i, 0], model[_SITES + i, 1], model[_SITES + i, 2]
        along = w[0] * x + w[1] * y + w[2] * z
        j, k = (i + 1) % 3, (i + 2) % 3
        square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
        centripetal = w[i] * along - model[_SITES + i, i] * square
        euler = a[j] * model[_SITES + i, k] - a[k] * model[_SITES + i, j]
        force[i] += centripetal + euler
    for i in range(3):
        rates[i] = (
            model[_GYRO_BIAS, i]
            + terms[GYRO_ASYMMETRY, i] * abs(w[i])
            + (terms[GYRO_SQUARE, i] + terms[GYRO_CUBIC, i] * w[i]) * w[i] * w[i]
        )
        rates[3 + i] = model[_ACCEL_BIAS, i] + model[_QUADRATIC, i] * force[i] * force[i]
        cubic = terms[ACCEL_CUBIC, i] * force[i] * force[i] * force[i]
        rates[3 + i] += cubic + terms[ACCEL_ASYMMETRY, i] * abs(force[i])
        for j in range(3):
            rates[i] += model[_GYRO + i, j] * w[j] + terms[G_SENSITIVITY + i, j] * force[j]
            rates[3 + i] += model[_ACCEL + i, j] * force[j]
            rates[3 + i] += terms[ACCEL_CROSS + i, j] * force[(j + 1) % 3] * force[(j + 2) % 3]
            rates[3 + i] += terms[ACCEL_RATE_SQUARE + i, j] * w[j] * w[j]
            rates[i] += terms[GYRO_G_SQUARE + i, j] * force[j] * force[j]
            # gyros rotated by K f sense ω − (K f) × ω
            j1, j2 = (i + 1) % 3, (i + 2) % 3
            rates[i] += (terms[GYRO_FLEX + j2, j] * w[j1] - terms[GYRO_FLEX + j1, j] * w[j2]) * force[j]
        rates[i] += terms[GYRO_FIFTH, i] * w[i] ** 5
        rates[3 + i] += terms[ACCEL_FIFTH, i] * force[i] ** 5
        if abs(outer[1]) + abs(inner[1]) > MOVING:
            rates[i] += terms[GYRO_MOVING_BIAS, i]
            rates[3 + i] += terms[ACCEL_MOVING_BIAS, i]


@kernel
def true_increments(
    model: FloatArray,
    chain: FloatArray,
    field: FloatArray,
    outer: FloatArray,
    outer_rest_time: float,
    inner: FloatArray,
    inner_rest_time: float,
    first: int,
    interval: float,
    base_velocity: FloatArray,
) -> FloatArray:
    """Return noise-free increments of the six channels, rad and m/s, shape (n, 6).

    The output is integrated by Gauss-Legendre quadrature over each sample, split where the commanded acceleration of a
    joint changes. The accelerometers' second-order term acts on the table's motion, not on the base's vibration.

    Parameters
    ----------
    model, chain : `ImuTruth.error_model` and `TableTruth.chain`
    field : up force, m/s², and ω_ie, rad/s, in n, shape (2, 3)
    outer, inner : segments of the joints' profiles, shape (k, 6), each with its `rest_time`, s
    first, interval : number of the first sample, which ends at (first + 1) · interval, and interval, s
    base_velocity : velocity of the centre of rotation in n at the borders of the samples, m/s, shape (n + 1, 3)
    """
    count = base_velocity.shape[0] - 1
    result = np.zeros((count, 6))
    vectors = np.empty((3, 3))
    rates = np.empty(6)
    resting = np.empty(6)
    outer_state = np.zeros(3)
    inner_state = np.zeros(3)
    rest_time = max(outer_rest_time, inner_rest_time)
    known = False
    for n in range(count):
        start = (first + n) * interval
        end = (first + n + 1) * interval
        if start >= rest_time:
            if not known:
                outer_state[0] = outer[outer.shape[0] - 1, 1]
                inner_state[0] = inner[inner.shape[0] - 1, 1]
                outer_state[1] = outer_state[2] = inner_state[1] = inner_state[2] = 0.0
                _measured_rates(model, chain, outer_state, inner_state, field, vectors, resting)
                known = True
            for i in range(6):
                result[n, i] = resting[i] * interval
        else:
            low = start
            while low < end:
                high = end
                for row in range(outer.shape[0]):
                    if low < outer[row, 0] < high:
                        high = outer[row, 0]
                for row in range(inner.shape[0]):
                    if low < inner[row, 0] < high:
                        high = inner[row, 0]
                for node in range(3):
                    time = low + (high - low) * GAUSS_NODES[node]
                    outer_state[0], outer_state[1], outer_state[2] = joint_state(outer, outer_rest_time, time)
                    inner_state[0], inner_state[1], inner_state[2] = joint_state(inner, inner_rest_time, time)
                    _measured_rates(model, chain, outer_state, inner_state, field, vectors, rates)
                    for i in range(6):
                        result[n, i] += rates[i] * GAUSS_WEIGHTS[node] * (high - low)
                low = high
        change = base_velocity[n + 1] - base_velocity[n]
        if change[0] != 0.0 or change[1] != 0.0 or change[2] != 0.0:
            middle = 0.5 * (start + end)
            outer_state[0], outer_state[1], outer_state[2] = joint_state(outer, outer_rest_time, middle)
            inner_state[0], inner_state[1], inner_state[2] = joint_state(inner, inner_rest_time, middle)
            sensed = to_body(chain, outer_state[0], inner_state[0], change)
            for i in range(3):
                for j in range(3):
                    result[n, 3 + i] += model[3 + i, j] * sensed[j]
    return result


@kernel
def _add_tilt(
    increments: FloatArray,
    model: FloatArray,
    chain: FloatArray,
    up_force: FloatArray,
    angles: FloatArray,
    tilt: FloatArray,
    interval: float,
) -> None:
    """Add the effect of a rotation of the base by small angles to increments, rad and m/s, shape (n, 6), in place.

    Parameters
    ----------
    model, chain : `ImuTruth.error_model` and `TableTruth.chain`
    up_force : specific force of a body at rest, in n, m/s², shape (3,)
    angles : outer and inner joint angle in the middle of the samples, rad, shape (n, 2)
    tilt : rotation vector of the base in n at the borders of the samples, rad, shape (n + 1, 3)
    interval : duration of a sample, s
    """
    for n in range(len(increments)):
        turn, middle = tilt[n + 1] - tilt[n], 0.5 * (tilt[n + 1] + tilt[n])
        rotation = to_body(chain, angles[n, 0], angles[n, 1], turn)
        force = to_body(chain, angles[n, 0], angles[n, 1], np.cross(up_force, middle) * interval)
        for i in range(3):
            for j in range(3):
                increments[n, i] += model[i, j] * rotation[j]
                increments[n, 3 + i] += model[3 + i, j] * force[j]


@kernel
def digitise(
    increments: FloatArray,
    normals: FloatArray,
    white: FloatArray,
    decay: FloatArray,
    driven: FloatArray,
    bias: FloatArray,
    lsb: FloatArray,
    limit: FloatArray,
    interval: float,
    as_rate: bool,
    remainder: FloatArray,
) -> tuple[FloatArray, BoolArray]:
    """Add noise to the increments and quantise them; return counts, shape (n, 6), and saturation, shape (n,).

    Parameters
    ----------
    increments : increments, rad and m/s, shape (n, 6)
    normals : standard normals of the white noise and then of the Gauss-Markov bank, shape (n, 6 or 6 + 6m)
    white, lsb, limit : noise sigma, size of a count and largest count, shape (6,)
    decay, driven, bias : coefficients and state of the bank, shapes (m,), (6, m), (6, m); `bias` is updated
    interval : duration of a sample, s
    as_rate : whether sample means are rounded independently instead of increments with their remainders
    remainder : remainders of the last increments, counts, shape (6,), which are updated
    """
    count, bank = increments.shape[0], decay.shape[0]
    counts = np.empty((count, 6))
    saturated = np.zeros(count, dtype=np.bool_)
    for n in range(count):
        for i in range(6):
            value = increments[n, i] + white[i] * normals[n, i]
            for m in range(bank):
                bias[i, m] = decay[m] * bias[i, m] + driven[i, m] * normals[n, 6 + i * bank + m]
                value += bias[i, m] * interval
            exact = value / (lsb[i] * interval) if as_rate else value / lsb[i] + remainder[i]
            whole = np.floor(exact + 0.5)
            if abs(whole) > limit[i]:
                whole = np.sign(whole) * limit[i]
                saturated[n] = True
                exact = whole
            if not as_rate:
                remainder[i] = exact - whole
            counts[n, i] = whole
    return counts, saturated


@dataclass(frozen=True)
class StreamOutput:
    """Counts, shape (n, 6), and whether any channel saturated, shape (n,)."""

    counts: FloatArray
    saturated: BoolArray


class Digitiser:
    """Adds noise to the increments of a unit and quantises them; `columns` is the number of normals per sample."""

    def __init__(self, imu: ImuTruth, *, instability: bool = True) -> None:
        self._interval = imu.interval
        self._as_rate = imu.output == "rate"
        self._white = np.repeat([imu.gyro_arw, imu.accel_vrw], 3) * np.sqrt(self._interval)
        self._lsb = np.repeat([imu.gyro_lsb, imu.accel_lsb], 3)
        seconds = 1.0 if self._as_rate else self._interval
        ranges, clip = [imu.gyro_range, imu.accel_range], [imu.effects.gyro_clip, np.inf]
        self._range, limit = (np.floor(np.repeat(reach, 3) * seconds / self._lsb) for reach in (ranges, clip))
        self._limit = np.minimum(self._range, limit)
        self._remainder = np.zeros(6)
        self._instability = np.repeat([imu.gyro_bias_instability, imu.accel_bias_instability], 3)
        if instability:
            self._decay, self._driven = instability_steps(self._instability, self._interval)
        else:
            self._decay, self._driven = np.zeros(0), np.zeros((6, 0))
        self._bias = np.zeros_like(self._driven)
        self.columns = 6 + self._bias.size

    def start_drift(self, random: np.random.Generator) -> None:
        """Draw the biases' initial values from their stationary distribution."""
        self._bias = draw_instability(self._instability, random)

    def digitise(self, increments: FloatArray, normals: FloatArray) -> StreamOutput:
        """Quantise increments, rad and m/s, shape (n, 6), with standard normals of shape (n, `columns` or more)."""
        lsb, limit, remainder = self._lsb, self._limit, self._remainder
        noise = (self._white, self._decay, self._driven, self._bias)
        counts, saturated = digitise(increments, normals, *noise, lsb, limit, self._interval, self._as_rate, remainder)
        if np.any(self._limit < self._range):  # gyros that clip below their range do not report saturation
            saturated = np.any(np.abs(counts) >= self._range, axis=1)
        return StreamOutput(counts, saturated)


class SensorStream:
    """Samples of one unit on one table; they do not depend on how many are requested at a time.

    `interval` is the true duration of a sample, s, which differs from the nominal one if the unit's clock is wrong. The
    motion of the table is in the time of another unit, which is `rate` times as fast as the time of this unit and
    equals `begin`, s, when this unit's time is 0. Gravity and earth rate are per second of this unit. In a chamber, the
    parameters depend on the temperatures of `thermal`, and `air` returns the air temperature, °C.
    """

    def __init__(
        self,
        imu: ImuTruth,
        table: TableTruth,
        seed: int | np.random.SeedSequence,
        *,
        rate: float = 1.0,
        begin: float = 0.0,
        thermal: UnitThermal | None = None,
        air: Callable[[], float] = lambda: REFERENCE,
    ) -> None:
        self.interval = imu.interval
        self.produced = 0
        self._thermal, self._air, self._cell = thermal, air, -1
        root = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
        self._random = np.random.Generator(np.random.PCG64(root))
        self._imu = imu
        bias = group_vector(imu.parameters, "gyro_bias")
        self._changes = Changes(imu.effects, self.interval, np.random.default_rng(root.spawn(1)[0]), bias)
        self._model = imu.error_model()
        self._chain = table.chain()
        self._field = np.array([table.up_force_n, table.earth_rate_n]) / rate
        self._table_interval, self.begin = self.interval * rate, begin
        drifts = imu.gyro_bias_instability != 0.0 or imu.accel_bias_instability != 0.0
        self._digitiser = Digitiser(imu, instability=drifts)
        if drifts:
            self._digitiser.start_drift(self._random)
        #: Uncompensated gyro increments of the last sample, rad, shape (1, 3).
        self._last: FloatArray | None = None
        self._vibration = Vibration(table.velocity_sigma, self.interval, self._random)
        self._base = BaseMotion(table.motion, self.interval, np.random.default_rng(root.spawn(1)[0]))
        self._columns = self._digitiser.columns + (6 if self._vibration.active else 0)

    @property
    def time(self) -> float:
        """End of the last sample produced, s."""
        return self.produced * self.interval

    def produce(self, count: int, outer: JointProfile, inner: JointProfile) -> StreamOutput:
        """Return the next `count` samples while the joints follow these profiles."""
        if self._thermal is None or count == 0:
            return self._produce(count, outer, inner)
        parts, cell = [], -1
        for taken in self._cells(self._thermal, count, outer, inner):
            if cell != self._cell:
                cell = self._cell
                parameters = self._thermal.parameters(self._imu.parameters)
                self._model = replace(self._imu, parameters=parameters).error_model()
            parts.append(self._produce(taken, outer, inner))
        return StreamOutput(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("counts", "saturated")))

    def skip(self, count: int, outer: JointProfile, inner: JointProfile) -> None:
        """Skip the next `count` samples; only the temperatures change."""
        thermal = self._thermal
        if thermal is not None and count:
            for taken in self._cells(thermal, count, outer, inner):
                self.produced += taken

    def _cells(self, thermal: UnitThermal, count: int, outer: JointProfile, inner: JointProfile) -> Iterator[int]:
        """Advance the temperatures, and yield the number of samples in each interval of constant temperature."""
        cell_size = max(1, round(GRID / self.interval))
        while count > 0:
            cell, used = divmod(self.produced, cell_size)
            if cell != self._cell:
                self._cell = cell
                self._advance(thermal, outer, inner)
            taken = min(count, cell_size - used)
            yield taken
            count -= taken

    def _advance(self, thermal: UnitThermal, outer: JointProfile, inner: JointProfile) -> None:
        """Advance the temperatures to the next interval, in which the parameters are constant."""
        now = np.array([self.produced * self._table_interval + self.begin])
        outer_angle, inner_angle = (float(joint.states(now)[0, 0]) for joint in (outer, inner))
        force = self._field[0]
        up = force / np.linalg.norm(force)
        thermal.step(self._air(), to_body(self._chain, outer_angle, inner_angle, up))

    def _produce(self, count: int, outer: JointProfile, inner: JointProfile) -> StreamOutput:
        normals = self._random.standard_normal((count, self._columns))
        vibration = self._vibration
        velocity = vibration.velocities(normals[:, -6:]) if vibration.active else np.zeros((count + 1, 3))
        velocity += self._base.velocity(self.produced, count)
        outer, inner = _delayed(outer, -self.begin), _delayed(inner, -self.begin)
        increments = self._increments(velocity, outer, inner)
        effects = self._imu.effects
        for delay in np.unique(effects.delay[effects.delay != 0.0] if not effects.low_pass else effects.delay).tolist():
            late = np.zeros_like(increments)
            for node, weight in zip(*(LAGUERRE if effects.low_pass else ((0.0,), (1.0,))), strict=True):
                later = delay + effects.low_pass * node
                late += weight * self._increments(velocity, _delayed(outer, later), _delayed(inner, later))
            increments[:, effects.delay == delay] = late[:, effects.delay == delay]
        if self._base.is_tilting:
            middle = np.asarray((self.produced + 0.5 + np.arange(count)) * self._table_interval, np.float64)
            angles = np.stack([joint.states(middle)[:, 0] for joint in (outer, inner)], axis=1)
            tilt = self._base.tilt(self.produced, count, max(outer.rest_time, inner.rest_time))
            _add_tilt(increments, self._model, self._chain, self._field[0], angles, tilt, self.interval)
        if effects.coning_compensation and count:
            gyros = np.vstack([increments[:1, :3] if self._last is None else self._last, increments[:, :3]])
            self._last = gyros[-1:]
            increments[:, :3] += effects.coning_compensation / 12.0 * np.cross(gyros[:-1], gyros[1:])
        if effects.changing:
            self._changes.apply(increments, self.produced)
        self.produced += count
        return self._digitiser.digitise(increments, normals)

    @property
    def parameters(self) -> FloatArray:
        """The unit's 30 parameters at the end of the last sample produced, SI, shape (30,)."""
        base = self._imu.parameters
        return self._changes.parameters(base if self._thermal is None else self._thermal.parameters(base), self.time)

    def _increments(self, velocity: FloatArray, outer: JointProfile, inner: JointProfile) -> FloatArray:
        joints = (outer.segments, outer.rest_time, inner.segments, inner.rest_time)
        samples = self.produced, self._table_interval, velocity
        return true_increments(self._model, self._chain, self._field, *joints, *samples)


def _delayed(profile: JointProfile, seconds: float) -> JointProfile:
    """Return the same motion `seconds` later."""
    later = np.array([seconds, 0.0, 0.0, 0.0, 0.0, 0.0])
    return JointProfile(profile.segments + later) if seconds else profile
