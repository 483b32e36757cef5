"""IMUs on one freely moving body, which alternates endlessly between rests and rotations about all axes."""

from functools import lru_cache

import numpy as np

from calstation.bench.truth.free_motion import Course, FreeMotion, Link, Pulse, tremor
from calstation.bench.truth.free_unit import Field, FreeStream, Mounting
from calstation.bench.truth.imu import ImuTruth, StreamOutput
from calstation.bench.truth.table import rotation
from calstation.physics import FloatArray

#: Number of rotations about each axis in an episode, and the largest angle of one, rad.
_ROTATIONS, _MAX_ANGLE = 8, np.deg2rad(100.0)
#: Smallest angle of a rotation, as a fraction of the largest.
_MIN_FRACTION = 0.4
#: Rms acceleration of the body's reference point during motion, m/s².
_SHAKE_RMS = 0.5
#: Number of samples produced at once, because short requests are slow.
_BLOCK_SIZE = 200

_AXES = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


class BodyMotion:
    """Motion of a body as a sequence of episodes, each a rest of `rest` s followed by a motion of `motion` s."""

    def __init__(self, rest: float, motion: float, seed: int) -> None:
        self._rest, self._motion, self._seed = rest, motion, seed
        self._period = rest + motion
        self._starts = [np.eye(3)]
        self._episode = lru_cache(maxsize=4)(self._make)

    def states(
        self, times: FloatArray, up_force: FloatArray, earth: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return specific force, rate and angular acceleration in b at `times` ≥ 0, s, like `FreeMotion.states`."""
        number = np.maximum(np.floor(times / self._period), 0.0).astype(np.int64)
        states = np.empty((3, len(times), 3))
        for k in np.unique(number):
            in_episode = number == k
            states[:, in_episode] = self._episode(int(k)).states(times[in_episode], up_force, earth)
        return states[0], states[1], states[2]

    def _make(self, number: int) -> FreeMotion:
        """Return the motion of an episode, which begins with the final attitude of the previous one."""
        while len(self._starts) <= number:
            self._starts.append(self._end(len(self._starts) - 1))
        random = np.random.default_rng([self._seed, number])
        begin = number * self._period + self._rest
        share = self._motion / _ROTATIONS
        courses = []
        for axis in range(3):
            pulses = []
            for k in range(_ROTATIONS):
                amount = _MAX_ANGLE * random.uniform(_MIN_FRACTION, 1.0) * random.choice([-1.0, 1.0])
                # the rotations about the three axes overlap
                start = begin + share * (k + 0.1 * axis)
                pulses.append(Pulse(start, 0.8 * share, float(amount), tremor(random, 0.01 * abs(float(amount)))))
            courses.append(Course(tuple(pulses)))
        shaken = []
        for _ in range(3):
            sines = tremor(random, _SHAKE_RMS)
            sines[:, 0] /= (2.0 * np.pi * sines[:, 1]) ** 2
            shaken.append(Course((Pulse(begin, self._motion, 0.0, sines),)))
        links = [Link(np.eye(3), axis, course) for axis, course in zip(_AXES, courses, strict=True)]
        links[0] = Link(self._starts[number], _AXES[0], courses[0])
        return FreeMotion(tuple(links), np.eye(3), (shaken[0], shaken[1], shaken[2]))

    def _end(self, number: int) -> FloatArray:
        attitude = np.eye(3)
        for link in self._episode(number).links:
            angle = sum(pulse.amount for pulse in link.course.pulses)
            attitude = attitude @ link.before @ rotation(angle * np.array(link.axis))
        return attitude


def draw_mounting(random: np.random.Generator) -> Mounting:
    """Draw the mounting of a secondary, rotated a few degrees from the primary and at most 0.17 m away from it."""
    return Mounting(rotation(0.03 * random.standard_normal(3)), random.uniform(-0.1, 0.1, 3))


class BodyStream:
    """Samples of a unit on a body.

    begin : time at which the unit was switched on, s
    gain : rate of the unit's clock relative to the bench's, s/s
    steps : rows of a time on the unit's clock, s, and the bias added to all gyros from then on, rad/s, shape (k, 2)
    """

    def __init__(
        self,
        imu: ImuTruth,
        motion: BodyMotion,
        mounting: Mounting,
        field: Field,
        seed: np.random.SeedSequence,
        begin: float,
        gain: float,
        steps: FloatArray,
    ) -> None:
        random, noise = (np.random.default_rng(part) for part in seed.spawn(2))
        self._samples = FreeStream(imu, mounting, field, random, noise, begin=begin, gain=gain)
        self._motion = motion
        self.interval = self._samples.interval
        self.produced = 0
        per_second = 1.0 if imu.output == "rate" else self.interval
        self._steps = [(float(at), float(rate) * per_second / imu.gyro_lsb) for at, rate in steps]
        self._counts, self._saturated = np.empty((0, 6)), np.empty(0, np.bool_)

    def produce(self, count: int) -> StreamOutput:
        """Return the next `count` samples."""
        if len(self._counts) < count:
            more = self._samples.produce(max(count, _BLOCK_SIZE), self._motion)
            self._counts = np.concatenate([self._counts, more.counts])
            self._saturated = np.concatenate([self._saturated, more.saturated])
        counts, saturated = self._counts[:count].copy(), self._saturated[:count]
        self._counts, self._saturated = self._counts[count:], self._saturated[count:]
        ends = np.arange(self.produced + 1, self.produced + count + 1) * self.interval
        for at, added in self._steps:
            counts[ends > at, :3] += np.round(added)
        self.produced += count
        return StreamOutput(counts, saturated)
