"""Motions of a gimbal's recording: turns of one joint from zero and returns to zero, with the drift at rest."""

from dataclasses import dataclass

import numpy as np

from calstation.errors import InputError, InsufficientDataError
from calstation.estimation.common import ImuModel, StageData, find_stillness
from calstation.estimation.gimbal.iteration import drift_matrix, others
from calstation.physics import FloatArray

#: Joints within this angle count as at zero, rad.
AT_ZERO = np.deg2rad(2.0)
#: A joint that moved further was turned; one that moved less has drifted, rad.
TURNED = np.deg2rad(5.0)
SHORTEST_REST = 1.0
#: Part of a rest next to the motion from which the joints' rates are taken, s.
RATE_FIT = 3.0
#: Part of a rest from which the joints' angles are taken, s.
ANGLE_FIT = 0.3


@dataclass(frozen=True)
class Motion:
    """One motion between two rests."""

    start: int  #: First sample.
    stop: int  #: The sample after the last.
    before: FloatArray  #: Joints x, y, z at its start, rad, shape (3,).
    after: FloatArray  #: Joints x, y, z at its end, rad, shape (3,).
    drift: FloatArray  #: Rates of the joints at the rest before, rad/s, shape (3,).
    rest: float  #: Length of the fit of these rates, s.
    duration: float  #: s
    between: tuple[int, int]  #: Indices of the rests before and after.

    @property
    def axis(self) -> int | None:
        """The joint that was turned from zero; None for a return to zero."""
        moved = np.abs(self.after - self.before)
        if np.abs(self.before).max() > AT_ZERO or moved.max() < TURNED:
            return None
        return int(np.argmax(moved))

    @property
    def angle(self) -> float:
        """Angle of the joint that moved most, rad."""
        moved = self.after - self.before
        return float(moved[int(np.argmax(np.abs(moved)))])

    def joint_drift(self, order: str) -> FloatArray:
        """D: change of the joints that were not turned, less their drift at rest, rad, shape (2,)."""
        assert self.axis is not None, "a return to zero turns no axis"
        rest = others(self.axis)
        at_rest = drift_matrix(order, self.axis, self.angle) @ self.drift[rest] * (self.duration / self.angle)
        return np.asarray((self.after - self.before)[rest] - at_rest)


def find_motions(data: StageData, imu: ImuModel) -> list[Motion]:
    """The motions of a recording in order. Raises InputError or InsufficientDataError if it is unusable."""
    if data.joints.shape[1] != 3:
        raise InputError("recording.no_joint_angles")
    still = find_stillness(data, imu, SHORTEST_REST)
    found = []
    for link in still.links:
        first, second = still.rests[link.first], still.rests[link.second]
        before, after = _joint_line(data, first, end=True), _joint_line(data, second, end=False)
        if before is not None and after is not None:
            rest = min((first[1] - first[0]) * data.dt, RATE_FIT)
            duration = (link.stop - link.start) * data.dt
            between = (link.first, link.second)
            found.append(Motion(link.start, link.stop, before[0], after[0], before[1], rest, duration, between))
    if not any(m.axis is not None for m in found):
        raise InsufficientDataError("recording.no_joint_turn", seconds=SHORTEST_REST, motions=len(found))
    return found


def _joint_line(data: StageData, rest: tuple[int, int], end: bool) -> tuple[FloatArray, FloatArray] | None:
    """The joints at a rest's `end` or start (rad, shape (3,)), and their rates there (rad/s, shape (3,)).

    Rates need a long fit. Angles need a short one, because a gimbal that stabilises on noisy rates drifts with them.
    """
    a, b = rest
    long, short = (
        (max(a, b - round(seconds / data.dt)), b) if end else (a, min(b, a + round(seconds / data.dt)))
        for seconds in (RATE_FIT, ANGLE_FIT)
    )
    polled = long[0] + np.flatnonzero(~np.isnan(data.joints[slice(*long)]).any(axis=1))
    near = polled[(polled >= short[0]) & (polled < short[1])]
    if len(polled) < 3 or not len(near):
        return None
    slope = np.polyfit(polled * data.dt, data.joints[polled], 1)[0]
    edge = b if end else a
    value = data.joints[near].mean(axis=0) + slope * (edge - 0.5 - float(near.mean())) * data.dt
    return np.asarray(value), np.asarray(slope)
