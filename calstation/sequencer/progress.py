"""How far a stage has come: the plan's seconds done, and within a step the station time gone by."""

import numpy as np

from calstation.physics.arrays import FloatArray
from calstation.physics.parameters import GROUPS, group_indices
from calstation.sequencer.events import StageProgress


class StageTrack:
    """Progress of one stage; `duration` is what its plan takes, s."""

    def __init__(self, stage: str, duration: float) -> None:
        self._stage = stage
        self._duration = duration
        self._done = 0.0
        self._begun = 0.0
        self._step = 0.0
        self._sigma: dict[str, float] = {}

    def begin(self, now: float, seconds: float) -> None:
        """A step that takes `seconds` begins at station time `now`."""
        self._begun, self._step = now, seconds

    def end(self, sigma: FloatArray) -> None:
        """The step is done; `sigma` is what is known by now, shape (30,), SI."""
        self._done += self._step
        self._step = 0.0
        self._sigma = {group: float(np.max(sigma[group_indices(group)])) for group in GROUPS}

    def event(self, now: float) -> StageProgress:
        """Where the stage stands at station time `now`."""
        done = self._done + min(max(now - self._begun, 0.0), self._step)
        fraction = min(done / self._duration, 1.0) if self._duration > 0.0 else 1.0
        return StageProgress(self._stage, fraction, max(self._duration - done, 0.0), self._sigma)
