"""A manual rig with the unit on an inner rail inside an outer rail, which an operator pushes to positions.

The operator stops near a position, corrects it, and shakes the rig with a tremor. The unit is not mounted at the centre
of the rails.
"""

from dataclasses import dataclass

import numpy as np

from calstation.bench.truth.free_motion import Course, FreeMotion, Link, Pulse, tremor
from calstation.bench.truth.free_unit import Field, FreeStream, Mounting
from calstation.bench.truth.imu import ImuTruth, StreamOutput
from calstation.bench.truth.simulate import Simulated
from calstation.bench.truth.table import earth_rate_n, normal_gravity, rotation
from calstation.physics import FloatArray

Pose = tuple[float, float]


@dataclass(frozen=True)
class ManualRig:
    """Parameters of the rig and the operator, in rad, s and m.

    The durations `rest` vary by ±20 %. `stop_sigma` is the sigma of the deviation from the intended position, `play`
    the largest turn about the third axis during a push, of which a part remains, and `shake` the rms acceleration
    during a push, m/s². `tilt` is the tilt of the base, `velocity_sigma` its rms vibration velocity, m/s, and `arm` the
    position of the unit relative to the centre of the rails.
    """

    latitude: float = np.deg2rad(34.25)
    height: float = 400.0
    gravity: float | None = None
    outer_axis: tuple[float, float, float] = (1.0, 0.0, 0.0)
    inner_axis: tuple[float, float, float] = (0.0, 1.0, 0.0)
    initial_rest: float = 20.0
    rest: float = 5.0
    speed: float = np.deg2rad(60.0)
    stop_sigma: float = np.deg2rad(3.0)
    play: float = np.deg2rad(3.0)
    shake: float = 1.0
    tilt: float = np.deg2rad(1.0)
    arm: tuple[float, float, float] = (0.12, -0.05, 0.2)
    velocity_sigma: float = 1e-3

    @property
    def field(self) -> Field:
        """Specific force, earth rate and vibration of a body at rest on the rig."""
        gravity = normal_gravity(self.latitude, self.height) if self.gravity is None else self.gravity
        return Field(np.array([0.0, 0.0, gravity]), earth_rate_n(self.latitude), self.velocity_sigma)


def around(step: float = np.deg2rad(45.0)) -> list[Pose]:
    """Return the poses of three full turns and back: of the inner rail, and of the outer rail at inner 0° and 90°."""
    count = round(2.0 * np.pi / step)
    sweep = [k * step for k in (*range(1, count + 1), *range(count - 1, -1, -1))]
    quarter = 0.5 * np.pi
    return [(0.0, a) for a in sweep] + [(a, 0.0) for a in sweep] + [(a, quarter) for a in (0.0, *sweep)]


def record(
    imu: ImuTruth, rig: ManualRig, poses: list[Pose], seed: int | np.random.SeedSequence
) -> tuple[Simulated, FreeMotion]:
    """Return a recording of the unit moved from (0, 0) through `poses` (outer, inner), rad, and the true motion.

    Without encoders, all angles are NaN, and the step is 0.
    """
    root = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
    hand_seed, sensor_seed = root.spawn(2)
    motion, duration = push(rig, poses, np.random.default_rng(hand_seed))
    count = int(duration * imu.sample_rate)
    random = np.random.default_rng(sensor_seed)
    stream = FreeStream(imu, Mounting(np.eye(3), np.asarray(rig.arm)), rig.field, random, random)
    counts = stream.produce(count, motion).counts
    seq, unknown = np.arange(count), np.full((count, 3), np.nan)
    time, step = (seq + 1) / imu.sample_rate, np.zeros(count, np.int64)
    return Simulated("multi_position", seq, time, counts, unknown[:, :2], step, unknown[:, 2]), motion


def push(rig: ManualRig, poses: list[Pose], random: np.random.Generator) -> tuple[FreeMotion, float]:
    """Return the motion through `poses` and its duration, s."""
    operator, time = Operator(rig, random), rig.initial_rest
    for pose in poses:
        time = operator.push(pose, time) + rig.rest * random.uniform(0.8, 1.2)
    return operator.motion(base_attitude(rig, random)), time


def base_attitude(rig: ManualRig, random: np.random.Generator) -> FloatArray:
    """Return the attitude of the rig, tilted about a random direction, shape (3, 3)."""
    direction = random.standard_normal(3)
    return rotation(rig.tilt * direction / np.linalg.norm(direction))


class Operator:
    """The operator who pushes the rails; `pose_reached` are the rail angles after the last push, rad, shape (2,)."""

    def __init__(self, rig: ManualRig, random: np.random.Generator) -> None:
        self._rig, self._random = rig, random
        self.pose_reached = np.zeros(2)
        self._lean_angle = 0.0
        self._rails: tuple[list[Pulse], list[Pulse], list[Pulse]] = ([], [], [])
        self._shaken: tuple[list[Pulse], list[Pulse], list[Pulse]] = ([], [], [])
        self._settled = np.zeros(3)

    def push(self, pose: Pose, time: float) -> float:
        """Push the rails from `time` approximately to `pose` (outer, inner); return the time of their release, s."""
        rig, random, pose_reached = self._rig, self._random, self.pose_reached
        goal = np.asarray(pose) + rig.stop_sigma * random.standard_normal(2)
        far = float(np.abs(goal - pose_reached).max())
        duration = max(far / rig.speed * random.uniform(0.8, 1.4), 0.6)
        correction = 0.1 * random.standard_normal(2) * np.abs(goal - pose_reached)
        for rail in range(2):
            amount = float(goal[rail] - pose_reached[rail])
            if abs(amount) < 2.0 * rig.stop_sigma and abs(pose[rail] - pose_reached[rail]) < 3.0 * rig.stop_sigma:
                goal[rail] = pose_reached[rail] + 0.2 * amount  # the operator only touches this rail
                amount, correction[rail] = 0.2 * amount, 0.0
            first = amount - float(correction[rail])
            self._rails[rail].append(Pulse(time, duration, first, tremor(random, 0.01 * abs(amount))))
            self._rails[rail].append(Pulse(time + duration, 0.5, float(correction[rail]), np.empty((0, 3))))
        lean = rig.play * random.uniform(-1.0, 1.0)
        stays = 0.3 * lean - self._lean_angle
        self._rails[2].append(Pulse(time, 0.5 * duration, lean, tremor(random, 0.05 * rig.play)))
        self._rails[2].append(Pulse(time + 0.5 * duration, 0.5 * duration + 0.5, stays - lean, np.empty((0, 3))))
        self._lean_angle += stays
        for axis in range(3):
            sines = tremor(random, rig.shake)
            sines[:, 0] /= (2.0 * np.pi * sines[:, 1]) ** 2
            self._shaken[axis].append(Pulse(time, duration + 0.5, 0.0, sines))
        self.pose_reached = goal
        return time + duration + 0.5

    def forget(self, time: float) -> None:
        """Replace the pushes that end before `time`, s, by constant angles; earlier times are no longer available."""
        for rail, pulses in enumerate(self._rails):
            over = [p for p in pulses if p.start + p.duration <= time]
            self._settled[rail] += sum(p.amount for p in over)
            pulses[:] = [p for p in pulses if p.start + p.duration > time]
        for pulses in self._shaken:
            pulses[:] = [p for p in pulses if p.start + p.duration > time]

    def motion(self, base: FloatArray) -> FreeMotion:
        """Return the motion of the unit due to the pushes so far, on a rig with attitude `base`, shape (3, 3)."""
        outer, inner = self._rig.outer_axis, self._rig.inner_axis
        third = np.cross(outer, inner)
        courses = [Course(tuple(p), float(o)) for p, o in zip(self._rails, self._settled, strict=True)]
        links = (
            Link(base, outer, courses[0]),
            Link(np.eye(3), (float(third[0]), float(third[1]), float(third[2])), courses[2]),
            Link(np.eye(3), inner, courses[1]),
        )
        x, y, z = (Course(tuple(pulses)) for pulses in self._shaken)
        return FreeMotion(links, np.eye(3), (x, y, z))


#: Range of the delay between a request and the push, s.
_REACTION_TIME = (0.5, 1.5)
#: Fraction of positions at which the operator touches the rig again too early.
_RETOUCH_FRACTION = 0.12
#: Angle by which such a touch turns a rail, rad.
_RETOUCH_ANGLE = np.deg2rad(12.0)


class ManualRigStream:
    """Samples of one unit on a manual rig; they do not depend on how many are requested at a time.

    The operator reacts after a delay, and sometimes touches the rig before it has rested long enough. `requested` is
    the last requested pose, rad.
    """

    def __init__(self, imu: ImuTruth, rig: ManualRig, seed: np.random.SeedSequence) -> None:
        vibration, noise, random = (np.random.default_rng(part) for part in seed.spawn(3))
        self._samples = FreeStream(imu, Mounting(np.eye(3), np.asarray(rig.arm)), rig.field, vibration, noise)
        self.interval = self._samples.interval
        self._random = random
        self._base = base_attitude(rig, random)
        self._operator = Operator(rig, random)
        self._motion = self._operator.motion(self._base)
        self._free = 0.0
        self.requested: Pose = (0.0, 0.0)

    @property
    def produced(self) -> int:
        """Number of samples produced so far."""
        return self._samples.produced

    def carry(self, pose: Pose, rest: float, time: float) -> None:
        """Request at `time`, s, a move of the rails to `pose` (outer, inner), rad, followed by a rest of `rest` s."""
        if pose == self.requested:
            return
        self.requested = pose
        operator, random = self._operator, self._random
        operator.forget(self.produced * self.interval)
        self._free = operator.push(pose, max(time, self._free) + random.uniform(*_REACTION_TIME))
        if random.uniform() < _RETOUCH_FRACTION:
            rail, direction = random.integers(2), random.choice([-1.0, 1.0])
            retouched = list(pose)
            retouched[rail] += direction * _RETOUCH_ANGLE
            retouch_time = self._free + max(random.uniform(0.3, 0.7) * rest, 1.0)
            self._free = operator.push((retouched[0], retouched[1]), retouch_time)
        self._motion = operator.motion(self._base)

    def produce(self, count: int) -> StreamOutput:
        """Return the next `count` samples."""
        return self._samples.produce(count, self._motion)
