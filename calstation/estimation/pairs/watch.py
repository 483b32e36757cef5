"""Watches secondaries against their primary and calibrates those that are off.

    waiting      a trigger (start-up, the period, a command) → checking
    checking     the first rest: the static check of every secondary → waiting, or calibrating those that are off
    calibrating  motion enough: fit, stored in place of the last → waiting

A primary that is off itself calibrates nothing: which of the two is wrong, the pair alone cannot tell.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from calstation.errors import InputError
from calstation.estimation.common.context import ImuModel, Secondary, StoredPair
from calstation.estimation.common.samples import SampleBlock, joined
from calstation.estimation.common.stage_data import stage_data
from calstation.estimation.pairs.calibration import PairCalibration, PairResult
from calstation.estimation.pairs.static import StaticCheck

#: Time between looks at the data while something is waited for, s.
LOOK_INTERVAL = 1.0
#: So many rests' lengths of samples from before the motion are collected with it: the biases show there.
RESTS_KEPT = 10.0


@dataclass(frozen=True)
class Triggers:
    """When to check and how long to wait then.

    start_up : at the first rest; period : every so many s of IMU time, None for never
    motion : to collect, s; longest : given up after that, s; moving : rate beyond that at rest which counts, rad/s
    """

    start_up: bool = True
    period: float | None = None
    motion: float = 20.0
    longest: float = 600.0
    moving: float = np.deg2rad(10.0)


@dataclass(frozen=True)
class WatchEvent:
    """What happened at an IMU time, s.

    kind : triggered, checked, primary_off, calibrating, calibrated, given_up; number : of the secondary, 0 for all
    """

    kind: str
    time: float
    number: int = 0
    values: Mapping[str, Any] = field(default_factory=dict)


class PairWatch:
    """Follows a stream of blocks.

    Parameters
    ----------
    keep : told what is stored from now on, by number; the caller makes it last

    Attributes
    ----------
    state : waiting, checking or calibrating
    stored : what each secondary is compensated with from now on; checks, calibrated : the last of each, by number
    """

    def __init__(
        self,
        imu: ImuModel,
        secondaries: tuple[Secondary, ...],
        calibration: PairCalibration,
        triggers: Triggers,
        keep: Callable[[int, StoredPair], None] = lambda number, stored: None,
    ) -> None:
        self._imu, self._secondaries, self._calibration = imu, secondaries, calibration
        self._triggers, self._keep = triggers, keep
        self.state = "waiting"
        self.stored = {s.number: s.stored for s in secondaries}
        self.checks: dict[int, StaticCheck] = {}
        self.calibrated: dict[int, PairResult] = {}
        self._off: dict[int, StaticCheck] = {}
        self._waiting: list[SampleBlock] = []
        self._blocks: list[SampleBlock] = []
        self._due = triggers.start_up
        self._checked: float | None = None
        self._looked = 0.0
        self._motion = 0.0

    def command(self) -> None:
        """Check at the next rest, whatever the period says."""
        self._due = True

    @property
    def progress(self) -> float:
        """How much of the motion wanted has been collected, 0 to 1."""
        return min(self._motion / self._triggers.motion, 1.0) if self.state == "calibrating" else 0.0

    def feed(self, block: SampleBlock) -> list[WatchEvent]:
        """Take further samples; what happened in them. It looks by the sample count, however they were cut."""
        self._waiting.append(block)
        second, events = round(self._imu.sample_rate), []
        while sum(map(len, self._waiting)) >= second:
            whole = joined(self._waiting)
            events += self._take(whole.part(0, second))
            self._waiting = [whole.part(second, len(whole))]
        return events

    def _take(self, block: SampleBlock) -> list[WatchEvent]:
        now = float(block.time[-1])
        events = [] if self.state != "waiting" else self._wait(now)
        if self.state == "waiting":
            return events
        self._blocks.append(block)
        if now - self._looked < LOOK_INTERVAL:
            return events
        self._looked = now
        return events + (self._check(now) if self.state == "checking" else self._collect(now, last=False))

    def finish(self) -> list[WatchEvent]:
        """The stream has ended: check or calibrate with what there is, if it is enough."""
        events = [e for block in self._waiting if len(block) for e in self._take(block)]
        self._waiting = []
        if not self._blocks:
            return events
        now = float(self._blocks[-1].time[-1])
        events += self._check(now) if self.state == "checking" else []
        return events + (self._collect(now, last=True) if self.state == "calibrating" else [])

    def _wait(self, now: float) -> list[WatchEvent]:
        if self._checked is None:
            self._checked = now
        period = self._triggers.period
        if not self._due and (period is None or now - self._checked < period):
            return []
        self._due, self.state, self._checked = False, "checking", now
        self._blocks, self._looked = [], now
        return [WatchEvent("triggered", now)]

    def _check(self, now: float) -> list[WatchEvent]:
        calibration = self._calibration
        data = stage_data(self._blocks, self._imu)
        rest = calibration.last_rest(data)
        self._forget(now, RESTS_KEPT * calibration.rules.rest)
        if rest is None:
            return []
        events, self._off, self._motion = [], {}, 0.0
        for place, secondary in enumerate(self._secondaries):
            number = secondary.number
            check = calibration.check(data, rest, place, secondary, self.stored[number])
            if check is None:
                continue
            self.checks[number] = check
            events.append(WatchEvent("checked", now, number, check_values(check)))
            if check.doubtful and not all(shown.within for shown in check.secondary.values()):
                events.append(WatchEvent("primary_off", now, number, {"sensors": list(check.doubtful)}))
            if check.off:
                self._off[number] = check
        self.state = "calibrating" if self._off else "waiting"
        if self._off:
            events.append(WatchEvent("calibrating", now, 0, {"secondaries": list(self._off)}))
        return events

    def _forget(self, now: float, seconds: float) -> None:
        """Drop blocks that ended longer than so many seconds ago."""
        self._blocks = [b for b in self._blocks if now - float(b.time[-1]) <= seconds]

    def _collect(self, now: float, last: bool) -> list[WatchEvent]:
        """Calibrate once there is motion enough; before the `last` look what is too little may become enough."""
        data = stage_data(self._blocks, self._imu)
        rest = np.median(data.gyro[: round(self._calibration.rules.rest / data.dt)], axis=0)
        moving = np.linalg.norm(data.gyro - rest, axis=1) > self._triggers.moving
        self._motion = float(np.count_nonzero(moving)) * data.dt
        last = last or len(data) * data.dt >= self._triggers.longest
        events, failed = [], ""
        if self._motion < self._triggers.motion:
            failed = f"{self._motion:.1f} s of motion where {self._triggers.motion:g} are asked for"
        for place, secondary in enumerate(self._secondaries):
            number = secondary.number
            if failed or number not in self._off:
                continue
            choice = self._calibration.rules.chosen(self._off[number])
            try:
                done = self._calibration.calibrate(data, place, secondary, choice, self.stored[number])
            except InputError as error:
                failed = str(error)
                continue
            self.stored[number], self.calibrated[number] = done.stored, done
            self._keep(number, done.stored)
            del self._off[number]
            events.append(WatchEvent("calibrated", now, number))
        if failed and not last:
            return events
        if failed:
            events.append(WatchEvent("given_up", now, 0, {"why": failed}))
        self.state, self._blocks = "waiting", []
        return events


def check_values(check: StaticCheck) -> dict[str, Any]:
    """A static check, JSON-ready: what each sensor of each unit shows, its threshold, and the verdict."""
    return {
        unit: {s: {"value": x.value, "limit": x.limit, "within": x.within} for s, x in shown.items()}
        for unit, shown in (("primary", check.primary), ("secondary", check.secondary))
    }
