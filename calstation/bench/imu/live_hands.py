"""The unit on the manual rig as it comes, carried by hands that hear what the screen asks for.

Hands take a moment to begin, stop about where they should, and now and then touch the rig again before it has rested
long enough; then they leave it alone.
"""

import numpy as np

from calstation.bench.truth.free_unit import FreeStream, Place
from calstation.bench.truth.imu import ImuTruth
from calstation.bench.truth.manual_rig import Hands, ManualRig, Pose, foot
from calstation.bench.truth.stream import StreamOutput

#: Between what is asked and the push, s.
_REACTION = (0.5, 1.5)
#: Share of positions that are touched again too soon.
_IMPATIENT = 0.12
#: How far such a touch turns a rail, rad.
_TOUCHED = np.deg2rad(12.0)


class HandStream:
    """Samples of one unit, one after another; how they are asked for does not change them.

    Parameters
    ----------
    imu, rig : truth
    seed : of all noise, and of what the hands do

    Attributes
    ----------
    asked : where the rails were asked to be last, rad
    """

    def __init__(self, imu: ImuTruth, rig: ManualRig, seed: np.random.SeedSequence) -> None:
        vibration, noise, own = (np.random.default_rng(part) for part in seed.spawn(3))
        self._samples = FreeStream(imu, Place(np.eye(3), np.asarray(rig.arm)), rig.field, vibration, noise)
        self._random = own
        self._base = foot(rig, own)
        self._hands = Hands(rig, own)
        self._motion = self._hands.motion(self._base)
        self._free = 0.0
        self.asked: Pose = (0.0, 0.0)

    @property
    def interval(self) -> float:
        """Of a sample, s."""
        return self._samples.interval

    @property
    def produced(self) -> int:
        """Samples so far."""
        return self._samples.produced

    def carry(self, pose: Pose, rest: float, time: float) -> None:
        """Asked at `time`, s, to bring the rails to `pose` (outer, inner), rad, and to leave them for `rest` s."""
        if pose == self.asked:
            return
        self.asked = pose
        hands, random = self._hands, self._random
        hands.forget(self.produced * self.interval)
        self._free = hands.push(pose, max(time, self._free) + random.uniform(*_REACTION))
        if random.uniform() < _IMPATIENT:
            rail, way = random.integers(2), random.choice([-1.0, 1.0])
            touched = list(pose)
            touched[rail] += way * _TOUCHED
            again = self._free + max(random.uniform(0.3, 0.7) * rest, 1.0)
            self._free = hands.push((touched[0], touched[1]), again)
        self._motion = hands.motion(self._base)

    def produce(self, count: int) -> StreamOutput:
        """The next `count` samples."""
        return self._samples.produce(count, self._motion)
