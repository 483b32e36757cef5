"""Live monitoring of secondary IMUs against their primary; calibrates those that are out of tolerance.

After a trigger (start-up, period, command) every secondary is checked at the first rest, and those out of tolerance
are fitted when enough motion has been recorded. A sensor that is out of tolerance in the primary is not calibrated in
any secondary, because the pair alone does not show which of the two is wrong.
"""

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal

import numpy as np

from calstation.errors import InputError, InsufficientDataError
from calstation.estimation.common import ImuModel, SampleBlock, Secondary, StageData, StoredPair, joined, stage_data
from calstation.estimation.pairs.calibration import SENSORS, PairCalibration, PairResult, StaticCheck

#: Time between evaluations while checking or calibrating, s.
EVALUATION_INTERVAL = 1.0
#: Duration of samples kept from before the motion, in units of the shortest rest; they determine the biases.
RESTS_KEPT = 10.0

#: Time without output after which the primary is silent, s.
SILENCE = 1.0

#: State of a sensor of a secondary after a check: within tolerance, out of it, or calibrated because it was out of it.
Verdict = Literal["within", "calibrated", "out_of_tolerance"]


@dataclass(frozen=True)
class WatchEvent:
    """An event of the live monitoring."""

    #: ``triggered``, ``checked``, ``primary_off``, ``primary_valid``, ``calibrating``, ``calibrated``, ``given_up``,
    #: ``primary_silent``, ``primary_resumed`` or ``aligned``.
    kind: str
    time: float  #: IMU time, s.
    number: int = 0  #: Number of the secondary; 0 for all.
    values: Mapping[str, Any] = field(default_factory=dict)  #: Other values, JSON types.


#: New results by number, the failure if there is one, and whether it is final.
_Fits = tuple[dict[int, PairResult], InputError | None, bool]

#: Executes a call and returns its future.
Submit = Callable[[Callable[[], _Fits]], "Future[_Fits]"]


def call_now(work: Callable[[], _Fits]) -> "Future[_Fits]":
    """Execute `work` immediately."""
    future: Future[_Fits] = Future()
    future.set_result(work())
    return future


class PairWatch:
    """Monitors a stream of blocks; `keep` is called with number and new values of a calibrated secondary.

    The fits are executed by `submit`, by default immediately; a live watch runs them beside its stream.
    Rows without output of the primary are invalid and have NaN counts. `stored` holds the calibration of each secondary
    by number, `checks` its last check, `verdicts` the state of its sensors since then, and `primary_off` the sensors of
    the primary that the last check found out of tolerance. `primary_silent` is whether the primary sends no samples.
    """

    def __init__(
        self,
        imu: ImuModel,
        secondaries: tuple[Secondary, ...],
        calibration: PairCalibration,
        keep: Callable[[int, StoredPair], None] = lambda number, stored: None,
        submit: Submit = call_now,
    ) -> None:
        self._imu, self._secondaries, self._calibration = imu, secondaries, calibration
        self._schedule, self._keep, self._submit = calibration.schedule, keep, submit
        self.state = "waiting"
        self.stored = {s.number: s.stored for s in secondaries}
        self.checks: dict[int, StaticCheck] = {}
        self.calibrated: dict[int, PairResult] = {}
        self.verdicts: dict[int, dict[str, Verdict]] = {}
        self.primary_off: tuple[str, ...] = ()
        self.primary_silent = False
        self._last_output: float | None = None
        self._notes: list[WatchEvent] = []
        self._fits: Future[_Fits] | None = None
        self._out_of_tolerance: dict[int, StaticCheck] = {}
        self._waiting: list[SampleBlock] = []
        self._blocks: list[SampleBlock] = []
        self._due = calibration.schedule.trigger != "command"
        self._checked: float | None = None
        self._evaluated = 0.0
        self._motion = 0.0

    def command(self) -> None:
        """Request a check at the next rest, independent of the period."""
        self._due = True

    def realigned(self, number: int, time: float, offset: float, sigma: float) -> None:
        """Note that a secondary's clock offset, s, was measured anew: motion before it was not aligned."""
        self._notes.append(WatchEvent("aligned", time, number, {"offset": offset, "sigma": sigma}))
        if self.state == "calibrating":
            self._blocks = [block for block in self._blocks if not self._moves(block)]

    def _moves(self, block: SampleBlock) -> bool:
        rate = block.counts[block.valid, :3] * self._imu.count_size[:3]
        return len(rate) > 0 and float(np.linalg.norm(rate, axis=1).max()) > self._schedule.moving

    @property
    def progress(self) -> float:
        """Fraction of the required motion that has been collected, 0 to 1."""
        return min(self._motion / self._schedule.motion_s, 1.0) if self.state == "calibrating" else 0.0

    def feed(self, block: SampleBlock) -> list[WatchEvent]:
        """Add samples, in blocks of any length, and return the resulting events."""
        second, events = round(self._imu.sample_rate), [*self._notes, *self._listen(block)]
        self._notes.clear()
        self._waiting.append(block)
        while sum(map(len, self._waiting)) >= second:
            whole = joined(self._waiting)
            events += self._process(whole.part(0, second))
            self._waiting = [whole.part(second, len(whole))]
        return events

    def _listen(self, block: SampleBlock) -> list[WatchEvent]:
        """Note whether the primary is silent."""
        if not len(block):
            return []
        now, present = float(block.time[-1]), ~np.isnan(block.counts).any(axis=1)
        if present.any() or self._last_output is None:
            self._last_output = float(block.time[present][-1]) if present.any() else float(block.time[0])
        silent = now - self._last_output > SILENCE
        if silent == self.primary_silent:
            return []
        self.primary_silent = silent
        return [WatchEvent("primary_silent" if silent else "primary_resumed", now)]

    def _process(self, block: SampleBlock) -> list[WatchEvent]:
        now = float(block.time[-1])
        events = [] if self.state != "waiting" else self._wait(now)
        if self.state == "waiting":
            return events
        self._blocks.append(block)
        if now - self._evaluated < EVALUATION_INTERVAL:
            return events
        self._evaluated = now
        return events + (self._check(now) if self.state == "checking" else self._collect(now, last=False))

    def finish(self) -> list[WatchEvent]:
        """Check or calibrate at the end of the stream if the samples so far are sufficient."""
        events = [e for block in self._waiting if len(block) for e in self._process(block)]
        self._waiting = []
        if not self._blocks:
            return events
        now = float(self._blocks[-1].time[-1])
        events += self._check(now) if self.state == "checking" else []
        return events + (self._collect(now, last=True) if self.state == "calibrating" else [])

    def _wait(self, now: float) -> list[WatchEvent]:
        if self._checked is None:
            self._checked = now
        periodic = self._schedule.trigger == "period"
        if not self._due and (not periodic or now - self._checked < self._schedule.period_s):
            return []
        self._due, self.state, self._checked = False, "checking", now
        self._blocks, self._evaluated = [], now
        return [WatchEvent("triggered", now)]

    def _check(self, now: float) -> list[WatchEvent]:
        calibration = self._calibration
        data = stage_data(self._blocks, self._imu)
        rest = calibration.last_rest(data)
        self._forget(now, RESTS_KEPT * self._schedule.static_s)
        if rest is None:
            return []
        events, self._out_of_tolerance, self._motion = [], {}, 0.0
        was_off, self.primary_off = self.primary_off, ()
        for place, secondary in enumerate(self._secondaries):
            number = secondary.number
            check = calibration.check(data, rest, place, secondary, self.stored[number])
            if check is None:
                continue
            self.checks[number] = check
            self.verdicts[number] = {s: "within" if check.secondary[s].within else "out_of_tolerance" for s in SENSORS}
            events.append(WatchEvent("checked", now, number, check_values(check)))
            self.primary_off = check.primary_out_of_tolerance
            if self.primary_off:
                events.append(WatchEvent("primary_off", now, number, {"sensors": list(self.primary_off)}))
            if calibration.to_calibrate(check):
                self._out_of_tolerance[number] = check
        if was_off and not self.primary_off:
            events.append(WatchEvent("primary_valid", now))
        self.state = "calibrating" if self._out_of_tolerance else "waiting"
        if self._out_of_tolerance:
            events.append(WatchEvent("calibrating", now, 0, {"secondaries": list(self._out_of_tolerance)}))
        return events

    def _forget(self, now: float, seconds: float) -> None:
        """Drop blocks that ended more than `seconds` ago."""
        self._blocks = [b for b in self._blocks if now - float(b.time[-1]) <= seconds]

    def _collect(self, now: float, last: bool) -> list[WatchEvent]:
        """Calibrate when there is enough motion; only the `last` evaluation reports failure."""
        if self._fits is None:
            self._fits = self._submit(partial(self._fit, last, self._motion_data()))
        if not last and not self._fits.done():
            return []
        (done, failed, last_fits), self._fits = self._fits.result(), None
        events: list[WatchEvent] = []
        for number, result in done.items():
            self.stored[number], self.calibrated[number] = result.stored, result
            self._keep(number, result.stored)
            check = self._out_of_tolerance.pop(number)
            for sensor, value in result.static.items():
                if not check.secondary[sensor].within and (value is None or value <= check.secondary[sensor].limit):
                    self.verdicts[number][sensor] = "calibrated"
            events.append(WatchEvent("calibrated", now, number, {"sensors": list(result.static)}))
        if failed and not last_fits:
            return events + (self._collect(now, last) if last else [])
        if failed:
            events.append(WatchEvent("given_up", now, 0, {"why": failed.as_text}))
        self.state, self._blocks = "waiting", []
        return events

    def _motion_data(self) -> StageData:
        data = stage_data(self._blocks, self._imu)
        rest = np.median(data.gyro[: round(self._schedule.static_s / data.dt)], axis=0)
        moving = np.linalg.norm(data.gyro - rest, axis=1) > self._schedule.moving
        self._motion = float(np.count_nonzero(moving)) * data.dt
        return data

    def _fit(self, last: bool, data: StageData) -> _Fits:
        """Fit the secondaries that are out of tolerance, up to the first failure."""
        last = last or len(data) * data.dt >= self._schedule.longest_s
        if self._motion < self._schedule.motion_s:
            wanted = self._schedule.motion_s
            return {}, InsufficientDataError("solve.too_little_motion", seconds=self._motion, wanted=wanted), last
        done: dict[int, PairResult] = {}
        failed: InputError | None = None
        for place, secondary in enumerate(self._secondaries):
            number = secondary.number
            if failed or number not in self._out_of_tolerance:
                continue
            choice = self._calibration.chosen(self._out_of_tolerance[number])
            try:
                done[number] = self._calibration.calibrate(data, place, secondary, choice, self.stored[number])
            except InputError as error:
                failed = error
        return done, failed, last


def check_values(check: StaticCheck) -> dict[str, Any]:
    """Return a static check as JSON values: deviation, threshold and result of each sensor of both IMUs."""
    return {
        unit: {s: {"value": x.value, "limit": x.limit, "within": x.within} for s, x in deviations.items()}
        for unit, deviations in (("primary", check.primary), ("secondary", check.secondary))
    }
