"""A gimbal's recording cut into motions: rests with the joints' course, turns from zero, and the ways back."""

from dataclasses import dataclass

import numpy as np

from calstation.errors import InputError, InsufficientDataError
from calstation.estimation.common.context import ImuModel
from calstation.estimation.common.stage_data import StageData
from calstation.estimation.common.stillness import find_stillness
from calstation.estimation.gimbal.iteration import drift_matrix, others
from calstation.physics.arrays import FloatArray

#: Joints within this count as brought back to zero.
AT_ZERO = np.deg2rad(2.0)
#: A joint that moved further was turned; one that moved less has drifted.
TURNED = np.deg2rad(5.0)
SHORTEST_REST = 1.0
#: The joints' rates at a rest are taken from this much of it next to the motion, s.
LONGEST_FIT = 3.0
#: And their angles from this much.
SHORT_LOOK = 0.3


@dataclass(frozen=True)
class Motion:
    """One motion between two rests.

    start, stop : its samples; before, after : joints x, y, z where it begins and ends, rad, shape (3,)
    drift : rates of the joints at the rest before, rad/s, shape (3,); rest : how long that was looked at, s
    duration : s; between : places of the rests before and after
    """

    start: int
    stop: int
    before: FloatArray
    after: FloatArray
    drift: FloatArray
    rest: float
    duration: float
    between: tuple[int, int]

    @property
    def axis(self) -> int | None:
        """The joint that was turned from zero; None for a way back."""
        moved = np.abs(self.after - self.before)
        if np.abs(self.before).max() > AT_ZERO or moved.max() < TURNED:
            return None
        return int(np.argmax(moved))

    @property
    def angle(self) -> float:
        """Of the joint that moved most, rad."""
        moved = self.after - self.before
        return float(moved[int(np.argmax(np.abs(moved)))])

    def lean(self, order: str) -> FloatArray:
        """D: change of the joints that were not turned, freed of what they drift at rest, rad, shape (2,)."""
        assert self.axis is not None, "a way back turns no axis"
        rest = others(self.axis)
        at_rest = drift_matrix(order, self.axis, self.angle) @ self.drift[rest] * (self.duration / self.angle)
        return np.asarray((self.after - self.before)[rest] - at_rest)


def find_motions(data: StageData, imu: ImuModel) -> list[Motion]:
    """The motions of a recording in order. Raises InputError or InsufficientDataError naming what is wrong."""
    if data.joints.shape[1] != 3:
        raise InputError(
            "no joint angles; add the columns joint_x_deg, joint_y_deg and joint_z_deg of the gimbal"
        )
    still = find_stillness(data, imu, SHORTEST_REST)
    found = []
    for link in still.links:
        first, second = still.rests[link.first], still.rests[link.second]
        before, after = _course(data, first, end=True), _course(data, second, end=False)
        if before is not None and after is not None:
            rest = min((first[1] - first[0]) * data.dt, LONGEST_FIT)
            duration = (link.stop - link.start) * data.dt
            between = (link.first, link.second)
            found.append(
                Motion(link.start, link.stop, before[0], after[0], before[1], rest, duration, between)
            )
    if not any(m.axis is not None for m in found):
        raise InsufficientDataError(
            f"no turn of one joint from zero between rests of {SHORTEST_REST:.0f} s ({len(found)} motions found); "
            "bring the joints to zero, rest, turn one axis, rest"
        )
    return found


def _course(data: StageData, rest: tuple[int, int], end: bool) -> tuple[FloatArray, FloatArray] | None:
    """The joints at a rest's `end` or begin (rad, shape (3,)), and their rates over the rest beside it (rad/s, (3,)).

    Rates need a long look; angles a short one, because what stabilises on noisy rates wanders with their noise.
    """
    a, b = rest
    long, short = (
        (max(a, b - round(seconds / data.dt)), b) if end else (a, min(b, a + round(seconds / data.dt)))
        for seconds in (LONGEST_FIT, SHORT_LOOK)
    )
    polled = long[0] + np.flatnonzero(~np.isnan(data.joints[slice(*long)]).any(axis=1))
    near = polled[(polled >= short[0]) & (polled < short[1])]
    if len(polled) < 3 or not len(near):
        return None
    slope = np.polyfit(polled * data.dt, data.joints[polled], 1)[0]
    edge = b if end else a
    value = data.joints[near].mean(axis=0) + slope * (edge - 0.5 - float(near.mean())) * data.dt
    return np.asarray(value), np.asarray(slope)
