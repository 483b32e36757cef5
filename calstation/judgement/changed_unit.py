"""Changes of unit, mounting or table during a run, which cause different outputs in repeated rests and motions.

Outputs are compared with those at the same angles of the table, without a model. Only changes larger than any drift of
a unit are detected here; the tests of the model detect smaller changes.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calstation.estimation import Diagnosis
from calstation.estimation.common import StageData
from calstation.judgement.table_motion import SMALLEST_TURN, TableMotion
from calstation.physics import CHANNELS, FloatArray

#: Largest difference of the angles of equal rests or motions, rad.
_SAME = np.deg2rad(1.0)
#: Largest permitted change of a rate at rest, °/s, and of a rotation relative to that of the table.
_RATE, _ROTATION = 1.0, 0.1
#: Largest permitted change of a force, relative to gravity.
_FORCE = 0.1
#: Smallest number of different attitudes or motions whose outputs must change.
_SHOWN_BY = 2


@dataclass(frozen=True)
class _Output:
    """The outputs of gyros and accelerometers in a rest, or the rotation that the gyros measure in a motion."""

    time: float  #: Start, s.
    angles: FloatArray  #: Angles at the rest, (2,), or angles at the start of the motion and their changes, (4,), rad.
    values: FloatArray  #: Rates, °/s, and forces, m/s², shape (6,); or rotations relative to the table's, shape (3,).
    tolerances: FloatArray  #: Largest permitted change of each value.

    def equals(self, other: "_Output") -> bool:
        """Return whether the table rests at the same angles, or moves in the same way."""
        if len(self.angles) != len(other.angles):
            return False
        difference = self.angles - other.angles
        difference[:2] = (difference[:2] + np.pi) % (2.0 * np.pi) - np.pi
        return bool(np.abs(difference).max() < _SAME)

    def change(self, other: "_Output") -> FloatArray:
        """Return the difference from another output relative to the permitted change."""
        return np.asarray(np.abs(self.values - other.values) / self.tolerances)


class ChangedUnit:
    """Comparison of the outputs at the same angles of the table over all stages.

    Parameters
    ----------
    gravity : local gravity, m/s²
    over_temperature : whether the samples are of a calibration over temperature, in which the biases of good gyros
        change by any amount
    """

    def __init__(self, gravity: float, *, over_temperature: bool = False) -> None:
        self._tolerances = np.repeat([np.inf if over_temperature else _RATE, _FORCE * gravity], 3)
        self._repeated: list[list[_Output]] = []

    def find(self, motion: TableMotion, data: StageData) -> Diagnosis | None:
        """Add the motion of a stage; return the diagnosis if outputs have changed since their first occurrence."""
        for output in self._outputs(motion, data):
            same = next((each for each in self._repeated if each[0].equals(output)), None)
            if same is None:
                self._repeated.append([output])
            else:
                same.append(output)
        changed = [each for each in self._repeated if each[0].change(each[-1]).max() > 1.0]
        if len(changed) < _SHOWN_BY:
            return None
        pairs = [(each[0], next(o for o in each if each[0].change(o).max() > 1.0)) for each in changed]
        before, after = min(pairs, key=lambda pair: pair[1].time)
        k = int(np.argmax(before.change(after)))
        unit = ("°/s" if k < 3 else "m/s²") if len(after.values) == len(CHANNELS) else "°/°"
        values = {"channel": CHANNELS[k], "unit": unit, "first": after.time}
        values |= {"before": float(before.values[k]), "after": float(after.values[k])}
        return Diagnosis("unit_changed", values=values)

    def _outputs(self, motion: TableMotion, data: StageData) -> Iterator[_Output]:
        """Yield the rests of a stage, and its motions about a single joint."""
        for (a, _), angles, rate, force in zip(motion.rests, motion.angles, motion.rate, motion.force, strict=True):
            yield _Output(float(data.time[a]), angles, np.hstack([np.rad2deg(rate), force]), self._tolerances)
        for (k, _), joint, rotation in zip(motion.links, motion.joints, motion.rotation, strict=True):
            change = motion.angles[k + 1] - motion.angles[k]
            if joint is not None and abs(change[joint]) > SMALLEST_TURN:
                at = np.hstack([motion.angles[k], change])
                time = float(data.time[motion.rests[k][1]])
                yield _Output(time, at, rotation / abs(change[joint]), np.full(3, _ROTATION))
