"""Simulation of noise-free samples of a plan, from which a covariance analysis predicts the sigmas of a run."""

from collections.abc import Iterator

import numpy as np

from calstation.estimation.common.context import SolveContext
from calstation.estimation.common.samples import SampleBlock
from calstation.physics import (
    Dwell,
    FloatArray,
    Move,
    Step,
    axis_rotation,
    axis_rotations,
    group_matrix,
    group_vector,
    rotation_matrix,
    rotation_rate,
)

#: Largest number of samples per generated block.
LONGEST_BLOCK = 20_000


class PlannedSamples:
    """Simulates an ideal table and unit; time, joint angles, counter and step number continue from step to step.

    An unknown azimuth is taken as 0 (north). `mount` is the rotation vector of the unit on the inner platform, rad;
    `joints` are the angles of the joints at the start, rad.
    """

    def __init__(
        self, context: SolveContext, parameters: FloatArray, mount: FloatArray, joints: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        site, imu = context.site, context.imu
        self._geometry = context.table.geometry
        self._mount = rotation_matrix(mount) @ np.array(context.table.orientation)  # from b to the platform's axes
        self._dt = 1.0 / imu.sample_rate
        self._azimuth = site.azimuth or 0.0
        self._earth = rotation_rate(site.latitude)
        self._gravity = site.local_gravity
        self._matrices = tuple(
            np.eye(3) + group_matrix(parameters, f"{sensor}_scale", f"{sensor}_misalign")
            for sensor in ("gyro", "accel")
        )
        self._biases = tuple(group_vector(parameters, f"{sensor}_bias") for sensor in ("gyro", "accel"))
        self._quadratic = group_vector(parameters, "accel_quadratic")
        self._levers = tuple(group_vector(parameters, f"{kind}_lever") for kind in ("outer", "inner"))
        per_count = self._dt if imu.output == "increment" else 1.0
        self._per_count = per_count / np.repeat([imu.gyro_lsb, imu.accel_lsb], 3)
        self.joints = joints  #: Outer and inner joint angle, rad.
        self.step = 0  #: Number of the last move.
        self._count = 0  # number of samples so far

    def run(self, step: Step, seconds: float, stage: str) -> Iterator[SampleBlock]:
        """Generate the samples of a step that lasts `seconds`; only moves and dwells have samples."""
        begin, start, target = self._count * self._dt, self.joints, self.joints
        last = round((begin + seconds) / self._dt)
        if isinstance(step, Move):
            self.step += 1
            target = (step.outer, step.inner)
        elif not isinstance(step, Dwell):
            return
        for a in range(self._count, last, LONGEST_BLOCK):
            b = min(a + LONGEST_BLOCK, last)
            joints = np.tile(start, (2 * (b - a) + 1, 1))
            if isinstance(step, Move):
                halves = 0.5 * self._dt * np.arange(2 * a, 2 * b + 1, dtype=np.float64) - begin
                for joint in range(2):
                    joints[:, joint] = profile(halves, start[joint], target[joint], step.rate, step.acceleration)
            yield self._block(stage, a, joints)
            self._count = b
        self.joints = target

    def _block(self, stage: str, first: int, joints: FloatArray) -> SampleBlock:
        """Return a block for the joint angles at the ends and midpoints of its samples, rad, shape (2 n + 1, 2)."""
        rate, angular_acceleration = self._rates(joints)
        level = self._level(joints[1::2])
        omega = rate + level.transpose(0, 2, 1) @ self._earth
        force = self._gravity * level[:, 2, :] + self._lever_force(rate, angular_acceleration)
        gyro, accel = self._matrices
        counts = np.hstack(
            [omega @ gyro.T + self._biases[0], force @ accel.T + self._quadratic * force**2 + self._biases[1]]
        )
        seq = np.arange(first, first + len(counts))
        time = np.asarray((seq + 1) * self._dt, dtype=np.float64)
        step = np.full(len(counts), self.step, dtype=np.int64)
        return SampleBlock.without_table(stage, seq, time, counts * self._per_count, angles=joints[2::2], step=step)

    def _rates(self, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the mean of ω_nb over each sample, rad/s, and its rate of change, rad/s², each shape (n, 3).

        In platform axes, the outer axis rotates with the inner joint; its mean over a sample is computed by Simpson's
        rule.
        """
        axes = self._outer_axis(joints[:, 1])
        mean_axis = (axes[:-2:2] + 4.0 * axes[1::2] + axes[2::2]) / 6.0
        inner_axis = np.array(self._geometry.inner_axis)
        joint_rate = np.diff(joints[::2], axis=0) / self._dt
        rate = mean_axis * joint_rate[:, :1] + inner_axis * joint_rate[:, 1:]
        half_rate = np.diff(joints, axis=0) / (0.5 * self._dt)
        halves = 0.5 * (axes[1:] + axes[:-1]) * half_rate[:, :1] + inner_axis * half_rate[:, 1:]
        acceleration = (halves[1::2] - halves[::2]) / (0.5 * self._dt)
        return rate @ self._mount, acceleration @ self._mount

    def _outer_axis(self, inner: FloatArray) -> FloatArray:
        """Return the outer axis in platform axes, shape (n, 3), at inner joint angles, rad, shape (n,)."""
        k, v = np.array(self._geometry.inner_axis), np.array(self._geometry.outer_axis)
        c, s = np.cos(inner)[:, None], np.sin(inner)[:, None]
        return np.asarray(v * c - np.cross(k, v) * s + k * ((k @ v) * (1.0 - c)))

    def _level(self, joints: FloatArray) -> FloatArray:
        """Return C_bn, shape (n, 3, 3), at joint angles, rad, shape (n, 2)."""
        heading = axis_rotation((0.0, 0.0, 1.0), -self._azimuth)
        outer = axis_rotations(self._geometry.outer_axis, joints[:, 0])
        inner = axis_rotations(self._geometry.inner_axis, joints[:, 1])
        return np.asarray(heading @ outer @ inner @ self._mount)

    def _lever_force(self, rate: FloatArray, alpha: FloatArray) -> FloatArray:
        """Return the specific force due to the lever arms, α × r + ω × (ω × r), of each axis, m/s², shape (n, 3)."""
        outer, inner = self._levers
        square = rate**2
        along = inner * (square - square.sum(axis=1, keepdims=True))
        return np.asarray(np.cross(alpha, outer) + np.cross(rate, np.cross(rate, outer)) + along)


def profile(time: FloatArray, start: float, end: float, rate: float, acceleration: float) -> FloatArray:
    """Return the joint angles, rad, shape (n,), of a trapezoidal or triangular move at times since its start, s.

    Parameters
    ----------
    time : times since the start of the move, s, shape (n,)
    start, end : joint angles before and after the move, rad
    rate, acceleration : largest rate, rad/s, and acceleration, rad/s²
    """
    distance = abs(end - start)
    ramp = min(rate / acceleration, float(np.sqrt(distance / acceleration)))
    cruise = max(distance - acceleration * ramp**2, 0.0) / rate
    t = np.clip(time, 0.0, 2.0 * ramp + cruise)
    accelerated = 0.5 * acceleration * np.minimum(t, ramp) ** 2
    cruised = acceleration * ramp * np.clip(t - ramp, 0.0, cruise)
    braking = np.clip(t - ramp - cruise, 0.0, ramp)
    decelerated = acceleration * (ramp * braking - 0.5 * braking**2)
    return np.asarray(start + np.sign(end - start) * (accelerated + cruised + decelerated))
