"""Takes samples of a unit that was just restarted where nothing drives it: a rest, turned over by hand, a rest."""

import numpy as np

from calstation.errors import DeviceFaultError
from calstation.estimation.common.samples import SampleBlock
from calstation.physics.arrays import FloatArray
from calstation.physics.motion import Carry
from calstation.physics.table import OUTER, TableGeometry
from calstation.sequencer.acquisition import Acquisition
from calstation.sequencer.capture import REST, VerificationData, mean_at_rest
from calstation.sequencer.control_loop import ControlLoop
from calstation.sequencer.steps import StepRunner

_OVER = np.pi
_QUARTER = 0.5 * np.pi
#: What turning it over is likely to take, s.
_WAY = 6.0
_ATTEMPTS = 3


def carried_data(
    control_loop: ControlLoop,
    acquisition: Acquisition,
    runner: StepRunner,
    geometry: TableGeometry,
    scale: FloatArray,
) -> VerificationData:
    """Rest, have the unit turned over, rest.

    `scale` : from counts to rad/s and m/s², shape (6,). Raises DeviceFaultError where data are missing.
    """
    outer, inner = runner.asked
    for attempt in range(_ATTEMPTS):
        start, end = (outer, over(geometry, outer)) if attempt % 2 == 0 else (over(geometry, outer), outer)
        runner.begin_stage()
        with acquisition.tap() as blocks:
            runner.run(Carry(start, inner, REST, _WAY if attempt else 0.0, 1, 2))
            first = _count(blocks)
            runner.run(Carry(end, inner, REST, _WAY, 2, 2))
        data = _taken(blocks, first, scale)
        if data is not None:
            return data
    raise DeviceFaultError(
        "IMU: samples are lost or spoilt again and again; check cable, baud and the load of this computer"
    )


def over(geometry: TableGeometry, outer: float) -> float:
    """Where the outer rail is to be turned to from `outer`, rad: half a turn on, or what travel allows of it."""
    for turn in (_OVER, -_OVER, _QUARTER, -_QUARTER):
        if geometry.limits.within(OUTER, outer + turn):
            return outer + turn
    return geometry.limits.low[OUTER]


def _taken(blocks: list[SampleBlock], first: int, scale: FloatArray) -> VerificationData | None:
    """Both rests and the way between, the first rest ending at sample `first`; None where samples are missing."""
    seq = np.concatenate([np.empty(0, np.int64), *(block.seq for block in blocks)])
    if len(seq) < 2 or (np.diff(seq) != 1).any() or not all(block.valid.all() for block in blocks):
        return None
    values = np.concatenate([block.counts for block in blocks]) * scale
    period = float(blocks[-1].time[-1] - blocks[0].time[0]) / (len(seq) - 1)
    rest = round(REST / period)
    rests = mean_at_rest(values[first - rest : first]), mean_at_rest(values[-rest:])
    return VerificationData(rests, REST, carried=values[first:-rest], period=period)


def _count(blocks: list[SampleBlock]) -> int:
    return sum(map(len, blocks))
