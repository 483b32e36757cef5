"""A stabilised gimbal with a unit, whose joints counteract the rotation measured by the corrected gyros.

    C_body^base = R(axis₁, q₁) · R(axis₂, q₂) · R(axis₃, q₃), joints from the base to the body

The loop integrates the difference between the demanded rates and the corrected rates c = (I + K)⁻¹ (measured − b̂). An
error of K or b̂ therefore appears not in c but as a drift of the joints. Locked joints follow their own profile.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from calstation.bench.truth.imu import Digitiser, ImuTruth, StreamOutput
from calstation.bench.truth.noise import INSTABILITY_TIMES, draw_instability, instability_steps
from calstation.physics import FloatArray, IntArray, kernel

AXES = "xyz"
#: Fraction of the rate error that the loop removes per sample.
LOOP_GAIN = 0.25
#: Default earth rate in the base frame, rad/s.
_EARTH = (0.0, 6.03e-5, 4.1e-5)
#: Duration of a stop, s.
_STOPPING = 0.2


@dataclass(frozen=True)
class GimbalSamples:
    """Samples of a motion: end times, s, shape (n,), counts (n, 6), and angles of joints x y z, rad, (n, 3)."""

    seq: IntArray
    time: FloatArray
    counts: FloatArray
    joints: FloatArray
    step: IntArray


class GimbalBench:
    """A gimbal with a unit whose accelerometers are at the centre; successive calls are consecutive in time.

    order : joints from base to body
    up_force, earth : specific force, m/s², and earth rate, rad/s, in the base frame
    encoder_sigma : sigma of the encoder error of a motion, rad; the noise of a reading is a tenth of it
    """

    def __init__(
        self,
        imu: ImuTruth,
        seed: int | np.random.SeedSequence,
        *,
        order: str = "zxy",
        up_force: tuple[float, float, float] = (0.0, 0.0, 9.8),
        earth: tuple[float, float, float] = _EARTH,
        encoder_sigma: float = np.deg2rad(0.002),
    ) -> None:
        self._imu, self._model = imu, imu.error_model()
        self._order = np.array([AXES.index(a) for a in order])
        self._up, self._earth = np.array(up_force), np.array(earth)
        self._encoder_sigma = encoder_sigma
        self._random = np.random.default_rng(seed)
        self.interval = 1.0 / imu.sample_rate
        #: True angles of the joints x, y, z, rad.
        self.joints = np.zeros(3)
        #: Estimated bias b̂ of the gyros, rad/s.
        self.bias = np.zeros(3)
        self._produced = self._step = 0
        instability = np.repeat([imu.gyro_bias_instability, imu.accel_bias_instability], 3)
        self._decay, self._driven = instability_steps(instability, self.interval)
        self._bank = draw_instability(instability, self._random)
        self._digitiser = Digitiser(imu, instability=False)
        self._offset = encoder_sigma * self._random.standard_normal(3)
        self._rate = np.zeros(3)

    def lock(self, seconds: float) -> GimbalSamples:
        """Lock the joints, so that the gyros measure their bias and earth rate."""
        return self._locked(np.tile(self.joints, (round(seconds / self.interval), 1)))

    def zero_bias(self, samples: GimbalSamples) -> None:
        """Set b̂ to the mean gyro output of locked samples."""
        per_count = 1.0 / self.interval if self._imu.output == "increment" else 1.0
        self.bias = samples.counts[:, :3].mean(axis=0) * self._imu.gyro_lsb * per_count

    def hold(self, seconds: float, correction: FloatArray) -> GimbalSamples:
        """Stabilise at rest with the correction K, shape (3, 3)."""
        return self._stabilised(np.zeros((round(seconds / self.interval), 3)), correction)

    def turn(self, axis: int, angle: float, rate: float, correction: FloatArray) -> GimbalSamples:
        """Turn smoothly by `angle`, rad, at mean `rate`, rad/s, about one body axis, with the other axes at rest."""
        demanded = self.turn_rates(axis, angle, rate)
        self._begin()
        return self._stabilised(demanded, correction)

    def home(self, rate: float) -> GimbalSamples:
        """Move all joints to zero without stabilisation."""
        course = self.course_home(rate)
        self._begin()
        return self._locked(course)

    def turn_rates(self, axis: int, angle: float, rate: float) -> FloatArray:
        """Return the body rates demanded in each sample of a turn, rad/s, shape (n, 3)."""
        count = max(round(abs(angle) / rate / self.interval), 2)
        demanded = np.zeros((count, 3))
        demanded[:, axis] = angle * np.diff(_smooth(count)) / self.interval
        return demanded

    def course_home(self, rate: float) -> FloatArray:
        """Return the joint angles at the end of each sample of a return to zero, rad, shape (n, 3)."""
        seconds = max(float(np.abs(self.joints).max()) / rate, 0.5)
        return np.asarray(self.joints * (1.0 - _smooth(round(seconds / self.interval))[1:, None]))

    def course_stop(self) -> FloatArray:
        """Return the joint angles at the end of each sample of a stop from the current rate, rad, shape (n, 3)."""
        s = np.linspace(0.0, 1.0, round(_STOPPING / self.interval) + 1)[1:, None]
        rates = joint_rates(self._order, self.joints, self._rate)
        return np.asarray(self.joints + rates * _STOPPING * (s - 0.5 * s**2))

    def _begin(self) -> None:
        self._step += 1
        self._offset = self._encoder_sigma * self._random.standard_normal(3)

    def read(self, joints: FloatArray) -> FloatArray:
        """Return encoder angles at true angles of joints x, y, z, rad, shape (..., 3)."""
        noise = 0.1 * self._encoder_sigma * self._random.standard_normal(joints.shape)
        return np.asarray(joints + self._offset + noise)

    def _locked(self, course: FloatArray) -> GimbalSamples:
        return self._sampled(self._run(len(course), np.eye(3), None, course))

    def _stabilised(self, demanded: FloatArray, correction: FloatArray) -> GimbalSamples:
        # (I + K)⁻¹ with K without its diagonal
        inverse = np.asarray(np.linalg.inv(np.eye(3) + correction - np.diag(np.diag(correction))), np.float64)
        return self._sampled(self._run(len(demanded), inverse, np.vstack([demanded, np.zeros(3)]), None))

    def _sampled(self, output: tuple[StreamOutput, FloatArray]) -> GimbalSamples:
        stream, joints = output
        count = len(joints)
        seq = np.arange(self._produced - count, self._produced)
        ends = np.asarray((seq + 1) * self.interval, dtype=np.float64)
        return GimbalSamples(seq, ends, stream.counts, self.read(joints), np.full(count, self._step, np.int64))

    def _run(
        self, count: int, gyro_matrix: FloatArray, demanded: FloatArray | None, course: FloatArray | None
    ) -> tuple[StreamOutput, FloatArray]:
        """Produce samples and the true joint angles at their ends, rad, shape (count, 3).

        Either the body rates are `demanded` (rad/s, shape (count + 1, 3), the last row for the following sample)
        with the rates corrected by `gyro_matrix`, shape (3, 3), or the joints follow `course`, rad, shape (count, 3).
        """
        locked = demanded is None
        path = np.zeros((1, 3)) if course is None else np.vstack([self.joints, course])
        stabilised = np.zeros((1, 3)) if demanded is None else demanded
        width = 6 * len(INSTABILITY_TIMES)
        # all numbers are drawn at once, so that the output does not depend on how a run is divided
        random = self._random.standard_normal((count, 9 + width))
        noise = random[:, :3] * (self._imu.gyro_arw * np.sqrt(self.interval))
        drift = np.zeros((count, 6))
        increments, joints = np.empty((count, 6)), np.empty((count, 3))
        _drift(self._bank, self._decay, self._driven, np.ascontiguousarray(random[:, 9:]), drift)
        gimbal = (self._model, self._order, self._up, self._earth, self.interval, locked)
        motion = (path, stabilised, np.asarray(gyro_matrix), self.bias, noise + drift[:, :3] * self.interval)
        _simulate(*gimbal, *motion, self.joints, self._rate, increments, joints)
        normals = np.hstack([np.zeros((count, 3)), random[:, 3:6]])  # the gyro noise is already included
        increments[:, 3:] += drift[:, 3:] * self.interval
        self._produced += count
        return self._digitiser.digitise(increments, normals), joints


class GimbalStream(GimbalBench):
    """A gimbal that is commanded while it runs; the joints are locked or stabilise the body."""

    def __init__(self, imu: ImuTruth, seed: int | np.random.SeedSequence, **settings: Any) -> None:
        super().__init__(imu, seed, **settings)
        #: Whether the joints stabilise the body; otherwise they are locked.
        self.is_stabilised = False
        self._bias_samples: list[FloatArray] | None = None
        #: Joint angles at the ends of the following samples if locked, or demanded rates, shape (n, 3).
        self._program = np.empty((0, 3))

    @property
    def produced(self) -> int:
        """Number of samples produced so far."""
        return self._produced

    @property
    def end(self) -> float:
        """Time at which the commanded motion ends, s."""
        return (self._produced + len(self._program)) * self.interval if len(self._program) else 0.0

    @property
    def readings(self) -> tuple[FloatArray, FloatArray]:
        """Encoder angles, rad, and rates, rad/s, of joints x, y, z, each of shape (3,)."""
        return self.read(self.joints), joint_rates(self._order, self.joints, self._rate)

    def lock_and_average_bias(self) -> None:
        """Lock the joints at their current angles, and average the gyro output from now on as the bias."""
        self.is_stabilised, self._program, self._bias_samples = False, np.empty((0, 3)), []

    def stabilise(self) -> None:
        """Stabilise at rest, with the bias averaged since `lock_and_average_bias`."""
        if self._bias_samples:
            self.bias = np.concatenate(self._bias_samples).mean(axis=0)
        self.is_stabilised, self._program, self._bias_samples = True, np.empty((0, 3)), None

    def command_turn(self, axis: int, angle: float, rate: float) -> None:
        """Turn about a body axis by `angle`, rad, at mean `rate`, rad/s, with the other axes stabilised."""
        self._begin()
        self._program = self.turn_rates(axis, angle, rate)

    def command_home(self, rate: float) -> None:
        """Move all joints to zero and lock them there."""
        course = self.course_home(rate)
        self._begin()
        self.is_stabilised, self._program, self._bias_samples = False, course, None

    def stop(self) -> None:
        """Decelerate to rest and lock the joints."""
        if self.is_stabilised:
            self._program = self.course_stop()
        elif len(self._program):
            self._program = self._program[:1]
        self.is_stabilised, self._bias_samples = False, None

    def produce(self, count: int, gyro_matrix: FloatArray) -> StreamOutput:
        """Return the next `count` samples; stabilisation uses rates corrected by `gyro_matrix`, shape (3, 3)."""
        parts = []
        while count > 0:
            n = min(count, len(self._program)) or count
            now, self._program = self._program[:n], self._program[n:]
            if self.is_stabilised:
                following = np.vstack([now, self._program[:1], np.zeros((n + 1, 3))])[: n + 1]
                output, _ = self._run(n, gyro_matrix, following, None)
            else:
                output, _ = self._run(n, gyro_matrix, None, now if len(now) else np.tile(self.joints, (n, 1)))
            if self._bias_samples is not None:
                per_count = 1.0 / self.interval if self._imu.output == "increment" else 1.0
                self._bias_samples.append(output.counts[:, :3] * self._imu.gyro_lsb * per_count)
            parts.append(output)
            count -= n
        counts = np.concatenate([p.counts for p in parts])
        return StreamOutput(counts, np.concatenate([p.saturated for p in parts]))


def _smooth(count: int) -> FloatArray:
    """Return a minimum-jerk profile from 0 to 1 at the borders of `count` samples, shape (count + 1,)."""
    s = np.linspace(0.0, 1.0, count + 1)
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s**2))


@kernel
def _drift(bank: FloatArray, decay: FloatArray, driven: FloatArray, normals: FloatArray, out: FloatArray) -> None:
    """Add the bias instability of the six channels to each sample of `out`; updates `bank`, shape (6, m)."""
    m = decay.shape[0]
    for n in range(out.shape[0]):
        for i in range(6):
            for k in range(m):
                bank[i, k] = decay[k] * bank[i, k] + driven[i, k] * normals[n, i * m + k]
                out[n, i] += bank[i, k]


@kernel
def _turn_matrix(axis: int, angle: float) -> FloatArray:
    R = np.eye(3)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    c, s = np.cos(angle), np.sin(angle)
    R[j, j], R[k, k] = c, c
    R[j, k], R[k, j] = -s, s
    return R


@kernel
def joint_rates(order: IntArray, joints: FloatArray, omega: FloatArray) -> FloatArray:
    """Return the rates of the joints x, y, z that result in a body rate, rad/s, shape (3,).

    Parameters
    ----------
    order : axes of the joints from the base to the body, 0 to 2, shape (3,)
    joints : angles x, y, z of the joints, rad, shape (3,)
    omega : rate in b, rad/s, shape (3,)
    """
    S = np.zeros((3, 3))
    to_body = np.eye(3)
    for axis in order[::-1]:
        S[:, axis] = to_body[:, axis]
        to_body = to_body @ _turn_matrix(axis, joints[axis]).T
    rates = np.empty(3)
    rates[:] = np.linalg.solve(S, omega)
    return rates


@kernel
def attitude(order: IntArray, joints: FloatArray) -> FloatArray:
    """Return C_body^base for angles of joints x y z, rad, shape (3, 3)."""
    C = np.eye(3)
    for axis in order:
        C = C @ _turn_matrix(axis, joints[axis])
    return C


@kernel
def _simulate(
    model: FloatArray,
    order: IntArray,
    up: FloatArray,
    earth: FloatArray,
    interval: float,
    locked: bool,
    course: FloatArray,
    demanded: FloatArray,
    inverse: FloatArray,
    bias: FloatArray,
    noise: FloatArray,
    joints: FloatArray,
    rate: FloatArray,
    increments: FloatArray,
    read: FloatArray,
) -> None:
    """Simulate one motion: true increments with gyro noise, and true joint angles; updates `joints` and body `rate`.

    Joint angles are integrated by Heun's method in quarters of a sample, with the body's rate constant over the sample.
    """
    parts = 4
    for n in range(increments.shape[0]):
        before = attitude(order, joints)
        if locked:
            step = (course[n + 1] - course[n]) / interval
            middle = 0.5 * (course[n + 1] + course[n])
            omega = np.zeros(3)
            to_body = np.eye(3)
            for axis in order[::-1]:
                omega += to_body[:, axis] * step[axis]
                to_body = to_body @ _turn_matrix(axis, middle[axis]).T
            joints[:] = course[n + 1]
            rate[:] = 0.0
        else:
            omega = rate.copy()
            for _ in range(parts):
                first = joint_rates(order, joints, omega)
                second = joint_rates(order, joints + first * interval / parts, omega)
                joints += 0.5 * (first + second) * interval / parts
        after = attitude(order, joints)
        mean = 0.5 * (before + after)
        inertial = omega + mean.T @ earth
        measured = model[0:3] @ inertial + model[6] + noise[n] / interval
        increments[n, :3] = measured * interval
        force = mean.T @ up
        increments[n, 3:] = (model[3:6] @ force + model[7] + model[8] * force * force) * interval
        if not locked:
            corrected = inverse @ (measured - bias)
            rate += LOOP_GAIN * (demanded[n] - corrected) + (demanded[n + 1] - demanded[n])
        read[n] = joints
