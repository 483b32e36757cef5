"""Information matrices of moves and rests, computed once with the filter of a run and then joined to schedules."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from calstation.estimation.common import PlannedSamples, Posterior, SolveContext, stage_data, starts
from calstation.estimation.navigation import (
    ClosedLoopFilter,
    Drifts,
    Segment,
    advance_information,
    join_segments,
    segment_information,
)
from calstation.physics import Dwell, Effect, FloatArray, Move, Step
from calstation.sequencer import step_time

#: Joint angles in a schedule are multiples of this, °.
LATTICE_DEG = 45.0
#: Rests are multiples of this, s.
REST_UNIT = 0.5
_LATTICE: Final = np.deg2rad(LATTICE_DEG)
_TURN = round(360.0 / LATTICE_DEG)
#: Duration of the rest before a segment, in which the filter starts, s.
_BEGIN = 2.0

#: Angles of outer and inner joint, in units of the lattice.
Position = tuple[int, int]


@dataclass(frozen=True)
class Conditions:
    """Conditions that determine the information of a motion."""

    context: SolveContext
    prior: Posterior
    settle: float  #: Settling time after a move, s.
    rate: float  #: Rate of all moves, rad/s.
    acceleration: float  #: Acceleration of all moves, rad/s².
    mount: FloatArray  #: Assumed mounting rotation, rad, shape (3,).
    effects: tuple[Effect, ...] = ()  #: Effects that the motion should detect.


class SegmentLibrary:
    """Durations of moves and rests on the lattice, and their information matrices for parameters and effects."""

    def __init__(self, conditions: Conditions) -> None:
        self._conditions = conditions
        self.settle = conditions.settle  #: Settling time after a move, s.
        self.states = 0  #: Number of boundary states, once a segment exists.
        self.drifts = Drifts.among(conditions.effects)
        self._moves: dict[tuple[int, int, int, int], tuple[FloatArray, float]] = {}
        self._rests: dict[tuple[int, int, int], FloatArray] = {}

    def begin(self, position: Position, rest: int) -> FloatArray:
        """Return the information matrix of states and parameters, shape (m + 30, m + 30), after the first rest."""
        segment, seconds = self._pass(position, [Dwell(rest * REST_UNIT)])
        return np.asarray(self.advance(segment.start[None], segment.motion[None], seconds)[0])

    def advance(self, before: FloatArray, segments: FloatArray, seconds: FloatArray | float) -> FloatArray:
        """Return the information at the ends of n segments that last `seconds`, see `advance_information`."""
        return advance_information(before, segments, seconds, self.drifts)

    def join(self, first: FloatArray, second: FloatArray, seconds: float) -> FloatArray:
        """Return the information matrix of two successive segments, of which the second lasts `seconds`."""
        return join_segments(first, second, self.states, seconds, self.drifts)

    def move(self, at: Position, to: Position) -> tuple[FloatArray, float]:
        """Return the information matrix and duration, s, of a move including settling and the shortest rest."""
        key = (at[0] % _TURN, at[1] % _TURN, to[0] - at[0], to[1] - at[1])
        if key not in self._moves:
            conditions = self._conditions
            target = ((key[0] + key[2]) * _LATTICE, (key[1] + key[3]) * _LATTICE)
            move = Move(*target, conditions.rate, conditions.acceleration)
            segment, seconds = self._pass((key[0], key[1]), [move, Dwell(REST_UNIT)])
            self._moves[key] = segment.motion, seconds
        return self._moves[key]

    def rest(self, at: Position, units: int) -> FloatArray:
        """Return the information matrix of a rest."""
        key = (at[0] % _TURN, at[1] % _TURN, units)
        if key not in self._rests:
            if units == 1:
                self._rests[key] = self._pass((key[0], key[1]), [Dwell(REST_UNIT)])[0].motion
            else:
                half, remaining = units // 2, units - units // 2
                self._rests[key] = self.join(self.rest(at, half), self.rest(at, remaining), remaining * REST_UNIT)
        return self._rests[key]

    def _pass(self, at: Position, steps: Sequence[Step]) -> tuple[Segment, float]:
        """Return the information matrices of steps and their duration, s."""
        c, joints = self._conditions, (at[0] * _LATTICE, at[1] * _LATTICE)
        samples = PlannedSamples(c.context, c.prior.mean, c.mount, joints)
        blocks = list(samples.run(Dwell(_BEGIN), _BEGIN, "designed"))
        duration = 0.0
        for step in steps:
            seconds = step_time(step, joints, c.settle)
            blocks += samples.run(step, seconds, "designed")
            duration += seconds
        data = stage_data(blocks, c.context.imu)
        (start,) = starts(data, c.context, c.prior)
        run, begin = ClosedLoopFilter(c.context, c.prior, c.prior.mean), replace(start, begin=round(_BEGIN / data.dt))
        segment = segment_information(run, data, begin, c.context, c.effects)
        self.states = segment.states
        return segment, duration
