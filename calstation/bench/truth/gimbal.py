"""A stabilised gimbal that carries the unit: its joints counteract the rotation measured by the corrected gyros.

    C_body^base = R(axis₁, q₁) · R(axis₂, q₂) · R(axis₃, q₃), joints from the base to the body

The loop integrates the difference between the demanded rates and the corrected rates c = (I + K)⁻¹ (measured − b̂). An
error of K or b̂ therefore appears not in c but as a drift of the joints. Locked joints follow their own profile.
"""

from dataclasses import dataclass

import numpy as np

from calstation.bench.truth.imu import Digitiser, ImuTruth
from calstation.bench.truth.kinematics import compiled
from calstation.bench.truth.noise import INSTABILITY_TIMES, draw_instability, instability_steps
from calstation.physics import FloatArray, IntArray

AXES = "xyz"
#: Fraction of the rate error that the loop removes per sample.
LOOP_GAIN = 0.25
#: Earth rate in the base frame, rad/s.
_EARTH = (0.0, 6.03e-5, 4.1e-5)


@dataclass(frozen=True)
class GimbalSamples:
    """Samples of one motion: end times, s; counts of gyros, accelerometers, (n, 6); joint angles x y z, rad, (n, 3)."""

    seq: IntArray
    time: FloatArray
    counts: FloatArray
    joints: FloatArray
    step: IntArray


class GimbalBench:
    """The gimbal with its unit, whose accelerometers are at the centre; time continues from call to call.

    `order` lists the joints from base to body. `up_force` is the specific force in the base frame, m/s².
    `encoder_sigma` is the repeatability, drawn for each motion, rad; reading noise is a tenth of it.
    """

    def __init__(
        self,
        imu: ImuTruth,
        seed: int | np.random.SeedSequence,
        *,
        order: str = "zxy",
        up_force: tuple[float, float, float] = (0.0, 0.0, 9.8),
        encoder_sigma: float = np.deg2rad(0.002),
    ) -> None:
        self._imu, self._model = imu, imu.error_model()
        self._order = np.array([AXES.index(a) for a in order])
        self._up, self._earth = np.array(up_force), np.array(_EARTH)
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
        """Hold the joints at their angles; the gyros then measure their bias and earth rate."""
        return self._run(round(seconds / self.interval), np.zeros((3, 3)), None, self.joints)

    def zero_bias(self, samples: GimbalSamples) -> None:
        """Set b̂ to the mean gyro output of locked samples."""
        per_count = 1.0 / self.interval if self._imu.output == "increment" else 1.0
        self.bias = samples.counts[:, :3].mean(axis=0) * self._imu.gyro_lsb * per_count

    def hold(self, seconds: float, correction: FloatArray) -> GimbalSamples:
        """Stabilise at rest with the correction K, shape (3, 3)."""
        demanded = np.zeros((round(seconds / self.interval), 3))
        return self._run(len(demanded), correction, demanded, self.joints)

    def turn(self, axis: int, angle: float, rate: float, correction: FloatArray) -> GimbalSamples:
        """Turn smoothly by `angle`, rad, at mean `rate`, rad/s, about one body axis, with the others at rest."""
        count = max(round(abs(angle) / rate / self.interval), 2)
        demanded = np.zeros((count, 3))
        demanded[:, axis] = angle * np.diff(_smooth(count)) / self.interval
        self._begin()
        return self._run(count, correction, demanded, self.joints)

    def home(self, rate: float) -> GimbalSamples:
        """Move all joints to zero without stabilisation."""
        seconds = max(float(np.abs(self.joints).max()) / rate, 0.5)
        self._begin()
        return self._run(round(seconds / self.interval), np.zeros((3, 3)), None, np.zeros(3))

    def _begin(self) -> None:
        self._step += 1
        self._offset = self._encoder_sigma * self._random.standard_normal(3)

    def _run(
        self, count: int, correction: FloatArray, demanded: FloatArray | None, target: FloatArray
    ) -> GimbalSamples:
        locked = demanded is None
        course = self.joints + (target - self.joints) * _smooth(count)[:, None] if locked else np.zeros((1, 3))
        stabilised = np.zeros((count, 3)) if demanded is None else demanded
        noise = self._random.standard_normal((count, 3)) * (self._imu.gyro_arw * np.sqrt(self.interval))
        driven = self._random.standard_normal((count, 6 * len(INSTABILITY_TIMES)))
        drift = np.zeros((count, 6))
        increments, joints = np.empty((count, 6)), np.empty((count, 3))
        _drift(self._bank, self._decay, self._driven, driven, drift)
        # (I + K)⁻¹ with K without its diagonal
        inverse = np.asarray(np.linalg.inv(np.eye(3) + correction - np.diag(np.diag(correction))), dtype=np.float64)
        gimbal = (self._model, self._order, self._up, self._earth, self.interval, locked)
        motion = (course, stabilised, inverse, self.bias, noise + drift[:, :3] * self.interval)
        _simulate(*gimbal, *motion, self.joints, self._rate, increments, joints)
        normals = self._random.standard_normal((count, 6))
        normals[:, :3] = 0.0  # the gyros' noise is already included
        increments[:, 3:] += drift[:, 3:] * self.interval
        counts = self._digitiser.digitise(increments, normals).counts
        seq = np.arange(self._produced, self._produced + count)
        self._produced += count
        read = joints + self._offset + 0.1 * self._encoder_sigma * self._random.standard_normal(joints.shape)
        ends = np.asarray((seq + 1) * self.interval, dtype=np.float64)
        return GimbalSamples(seq, ends, counts, read, np.full(count, self._step, np.int64))


def _smooth(count: int) -> FloatArray:
    """Return a minimum-jerk profile from 0 to 1 at the borders of `count` samples, shape (count + 1,)."""
    s = np.linspace(0.0, 1.0, count + 1)
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s**2))


@compiled
def _drift(bank: FloatArray, decay: FloatArray, driven: FloatArray, normals: FloatArray, out: FloatArray) -> None:
    """Add the bias instability of the six channels to each sample of `out`; updates `bank`, shape (6, m)."""
    m = decay.shape[0]
    for n in range(out.shape[0]):
        for i in range(6):
            for k in range(m):
                bank[i, k] = decay[k] * bank[i, k] + driven[i, k] * normals[n, i * m + k]
                out[n, i] += bank[i, k]


@compiled
def _turn_matrix(axis: int, angle: float) -> FloatArray:
    R = np.eye(3)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    c, s = np.cos(angle), np.sin(angle)
    R[j, j], R[k, k] = c, c
    R[j, k], R[k, j] = -s, s
    return R


@compiled
def joint_rates(order: IntArray, joints: FloatArray, omega: FloatArray) -> FloatArray:
    """Return the rates of joints x y z that turn the body at `omega` (rad/s, in the body), rad/s, shape (3,)."""
    S = np.zeros((3, 3))
    to_body = np.eye(3)
    for axis in order[::-1]:
        S[:, axis] = to_body[:, axis]
        to_body = to_body @ _turn_matrix(axis, joints[axis]).T
    rates = np.empty(3)
    rates[:] = np.linalg.solve(S, omega)
    return rates


@compiled
def attitude(order: IntArray, joints: FloatArray) -> FloatArray:
    """Return C_body^base for angles of joints x y z, rad, shape (3, 3)."""
    C = np.eye(3)
    for axis in order:
        C = C @ _turn_matrix(axis, joints[axis])
    return C


@compiled
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
            follow = demanded[n + 1] if n + 1 < demanded.shape[0] else np.zeros(3)
            rate += LOOP_GAIN * (demanded[n] - corrected) + (follow - demanded[n])
        read[n] = joints
