"""Motion of the table from its encoders, and the outputs of the IMU at rest and between rests."""

import itertools
from dataclasses import dataclass

import numpy as np

from calstation.estimation.common import REST_MARGIN, SHORTEST_REST, SolveContext, StageData, mean_angles
from calstation.physics import FloatArray, IntArray, rotation_vector

#: Time over which the encoders are compared to find rests, s, and largest change of an angle at rest, rad.
_STILL_TIME, _STILL_ANGLE = 0.25, np.deg2rad(0.02)
#: Smallest rotation of a joint that is compared with that of the gyros, rad.
SMALLEST_TURN = np.deg2rad(5.0)
#: Largest time between two angles of a rest, in units of `_STILL_TIME`.
_LONGEST_POLL = 4
#: Largest change of an angle within a part of a motion, rad, and largest number of parts in a stage.
_LARGEST_PART, _MAX_PARTS = np.deg2rad(45.0), 60
#: Largest rotation of the other joint relative to that of a joint that moves alone.
_OTHER_JOINT = 0.02
#: Smallest number of angles between two rests, and smallest jump of an angle, rad, that show that a motion was cut out.
_CUT_ANGLES, _CUT_STEP = 20, np.deg2rad(5.0)


@dataclass(frozen=True)
class TableMotion:
    """Rests of the table and the motions between them, each without a gap.

    If both joints move at once, the angles at the rests do not define the rotation; such motions are divided into
    parts.
    """

    rests: tuple[tuple[int, int], ...]  #: First sample of each rest and the one after its last.
    angles: FloatArray  #: Outer and inner encoder angle at the rests, rad, shape (k, 2).
    force: FloatArray  #: Mean specific force at the rests, m/s², shape (k, 3).
    rate: FloatArray  #: Mean rate at the rests, rad/s, shape (k, 3).
    links: tuple[tuple[int, int], ...]  #: Indices of the rests before and after each of m motions.
    joints: tuple[int | None, ...]  #: The only joint that moves in each motion; None if both do.
    rotation: FloatArray  #: Integral of the rate minus its mean at the adjacent rests, rad, shape (m, 3).
    part_angles: FloatArray  #: Angles of the joints at the start and the end of the parts, rad, shape (p, 2, 2).
    part_rotation: FloatArray  #: The same integral in the parts, rad, shape (p, 3).


def table_motion(data: StageData) -> TableMotion | None:
    """Return the motion of the table in a stage; None if its angles are unknown or it does not rest."""
    polled = np.flatnonzero(np.isfinite(data.angles).all(axis=1))
    if len(polled) < 2:
        return None
    rests = _rests(data, polled)
    if not rests:
        return None
    angles = np.array([np.nanmean(data.angles[a:b], axis=0) for a, b in rests])
    force = np.array([data.accel[a:b].mean(axis=0) for a, b in rests])
    rate = np.array([data.gyro[a:b].mean(axis=0) for a, b in rests])
    links, joints, rotations = [], [], []
    begins, ends, parts = [np.zeros((0, 2))], [np.zeros((0, 2))], [np.zeros((0, 3))]
    for k, ((a0, a1), (b0, b1)) in enumerate(itertools.pairwise(rests)):
        start, stop = (a0 + a1) // 2, (b0 + b1) // 2
        if data.seq[stop] - data.seq[start] != stop - start or _is_cut(data.angles[start:stop], data.dt):
            continue
        at_rest = 0.5 * (rate[k] + rate[k + 1])
        links.append((k, k + 1))
        rotations.append((data.gyro[start:stop] - at_rest).sum(axis=0) * data.dt)
        between = polled[(polled >= start) & (polled < stop)]
        joints.append(_moved_joint(data.angles[between]))
        if joints[-1] is None:
            at = _spaced(between, data.dt)
            rotated = np.vstack([np.zeros(3), np.cumsum(data.gyro[start:stop] - at_rest, axis=0) * data.dt])
            begins.append(data.angles[at[:-1]])
            ends.append(data.angles[at[1:]])
            parts.append(np.diff(rotated[at - start], axis=0))
    part_angles = np.stack([np.vstack(begins), np.vstack(ends)], axis=1)
    change = np.abs((part_angles[:, 1] - part_angles[:, 0] + np.pi) % (2.0 * np.pi) - np.pi).max(axis=1)
    used = np.flatnonzero((change > SMALLEST_TURN) & (change < _LARGEST_PART))
    used = used[:: max(-(-len(used) // _MAX_PARTS), 1)]
    return TableMotion(
        rests=tuple(rests),
        angles=angles,
        force=force,
        rate=rate,
        links=tuple(links),
        joints=tuple(joints),
        rotation=np.array(rotations).reshape(-1, 3),
        part_angles=part_angles[used],
        part_rotation=np.vstack(parts)[used],
    )


def _moved_joint(angles: FloatArray) -> int | None:
    """Return the only joint that moves according to angles, rad, shape (n, 2); None if both move."""
    span = np.ptp(np.unwrap(angles, axis=0), axis=0)
    joint = int(np.argmax(span))
    return joint if span[1 - joint] <= _OTHER_JOINT * span[joint] else None


def _is_cut(angles: FloatArray, dt: float) -> bool:
    """Return whether a motion was cut out of the recording: angles, shape (n, 2), jump within a short time."""
    polled = np.flatnonzero(np.isfinite(angles).all(axis=1))
    if len(polled) < _CUT_ANGLES:
        return False
    joint = int(np.argmax(np.ptp(angles[polled], axis=0)))
    steps = np.abs(np.diff(angles[polled, joint]))
    steps[np.abs(steps - 2.0 * np.pi) < 0.1] = 0.0  # the end of a turn, if the angles are recorded modulo a turn
    k = int(np.argmax(steps))
    is_jump = steps[k] > max(0.5 * np.ptp(angles[polled, joint]), _CUT_STEP)
    return bool(is_jump and (polled[k + 1] - polled[k]) * dt < _STILL_TIME)


def _rests(data: StageData, polled: IntArray) -> list[tuple[int, int]]:
    """Return the intervals in which the encoders do not move; `polled` are the samples with angles."""
    spacing, at = max(round(_STILL_TIME / data.dt), 1), _spaced(polled, data.dt)
    still = np.abs(np.diff(data.angles[at], axis=0)).max(axis=1) < _STILL_ANGLE
    still &= (np.diff(data.seq[at]) == np.diff(at)) & (np.diff(at) <= _LONGEST_POLL * spacing)
    margin, shortest = round(REST_MARGIN / data.dt), round(SHORTEST_REST / data.dt)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(np.int8)))
    rests = []
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        a, b = int(at[first]) + margin, int(at[last]) - margin
        if b - a >= shortest and mean_angles(data, a, b) is not None:
            rests.append((a, b))
    return rests


def _spaced(polled: IntArray, dt: float) -> IntArray:
    """Return one of the samples in each interval of `_STILL_TIME`."""
    if not len(polled):
        return polled
    spacing = max(round(_STILL_TIME / dt), 1)
    marks = np.unique(polled[0] + (polled - polled[0]) // spacing * spacing)
    return np.unique(polled[np.searchsorted(polled, marks)])


def turn_axis(joints: FloatArray, joint: int, context: SolveContext) -> FloatArray:
    """Return the axis of a joint in b at joint angles, rad, shape (2,), as a unit vector, shape (3,).

    Parameters
    ----------
    joints : angles of the outer and the inner joint, rad, shape (2,)
    joint : 0 for the outer joint, 1 for the inner one
    context : table with its axes
    """
    geometry = context.table.geometry
    step = joints + 0.01 * np.eye(2)[joint]
    return np.asarray(rotation_vector(geometry.body_to_home(*joints).T @ geometry.body_to_home(*step)) / 0.01)
