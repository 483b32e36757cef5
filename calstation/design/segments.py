"""The information of moves and rests of a table, computed once and joined to schedules."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from calstation.estimation.common import Belief, PlannedSamples, SolveContext, stage_data, starts
from calstation.estimation.navigation import Gatherer, NavigationFilter, advanced, joined
from calstation.physics import Dwell, FloatArray, Move, TableGeometry
from calstation.sequencer import step_time

#: Angles of the joints in a schedule are multiples of this, °.
LATTICE_DEG = 45.0
_LATTICE = np.deg2rad(LATTICE_DEG)
_TURN = 8
#: Rest before a segment that the filter needs to begin, s; it is not part of the segment.
_BEGIN = 2.0

Position = tuple[int, int]


class SegmentLibrary:
    """Information of moves and rests on the lattice, for one table, unit and prior."""

    def __init__(
        self,
        context: SolveContext,
        prior: Belief,
        geometry: TableGeometry,
        settle: float,
        rate: float,
        acceleration: float,
        mount: FloatArray,
    ) -> None:
        self._context, self._prior, self._geometry = context, prior, geometry
        self._settle, self._rate, self._acceleration, self._mount = settle, rate, acceleration, mount
        self._moves: dict[tuple[int, int, int, int], tuple[FloatArray, float]] = {}
        self._rests: dict[Position, FloatArray] = {}

    def begin(self, position: Position, seconds: float) -> FloatArray:
        """Return the information about states and parameters after the first rest."""
        start, matrix, _ = self._pass(position, [Dwell(seconds)])
        return advanced(start, matrix)

    def move(self, at: Position, to: Position) -> tuple[FloatArray, float]:
        """Return information and duration, s, of a move with its settling."""
        key = (at[0] % _TURN, at[1] % _TURN, to[0] - at[0], to[1] - at[1])
        if key not in self._moves:
            begin = (key[0], key[1])
            target = ((key[0] + key[2]) * _LATTICE, (key[1] + key[3]) * _LATTICE)
            _, matrix, seconds = self._pass(begin, [Move(*target, self._rate, self._acceleration)])
            self._moves[key] = matrix, seconds
        return self._moves[key]

    def rest(self, at: Position) -> FloatArray:
        """Return the information of a rest of 1 s."""
        key = (at[0] % _TURN, at[1] % _TURN)
        if key not in self._rests:
            self._rests[key] = self._pass(key, [Dwell(1.0)])[1]
        return self._rests[key]

    def _pass(self, at: Position, steps: Sequence[Move | Dwell]) -> tuple[FloatArray, FloatArray, float]:
        joints = (at[0] * _LATTICE, at[1] * _LATTICE)
        samples = PlannedSamples(self._context, self._prior.mean, self._geometry, self._mount)
        samples._joints = joints
        blocks = list(samples.run(Dwell(_BEGIN), _BEGIN, "designed"))
        duration = 0.0
        for step in steps:
            seconds = step_time(step, joints, self._settle)
            blocks += list(samples.run(step, seconds, "designed"))
            duration += seconds
        data = stage_data(blocks, self._context.imu)
        (start,) = starts(data, self._context, self._prior)
        begin = round(_BEGIN / data.dt)
        run, gathered = NavigationFilter(self._context, self._prior, self._prior.mean), Gatherer()
        run.run(data, replace(start, begin=begin), start.attitude, smooth=False, watch=gathered)
        assert gathered.start is not None and gathered.matrix is not None
        return gathered.start, gathered.matrix, duration
