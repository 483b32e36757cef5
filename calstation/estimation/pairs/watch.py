"""Live monitoring of secondary IMUs against their primary, and calibration of those that are out of tolerance.

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

from calstation.errors import ConfigurationError, InputError, InsufficientDataError
from calstation.estimation.common import (
    ImuModel,
    SampleBlock,
    Secondary,
    StageData,
    StoredCrossCalibration,
    join_blocks,
    stage_data,
)
from calstation.estimation.pairs.calibration import SENSORS, PairCalibration, PairResult, StaticCheck

#: Time between evaluations while checking or calibrating, s.
EVALUATION_INTERVAL = 1.0
#: Duration of the samples before the motion that are kept to estimate the biases, as a multiple of the shortest rest.
MAX_REST_FACTOR = 10.0

#: Time without output after which an IMU is reported as silent, s.
SILENCE = 1.0

#: State of a sensor of a secondary after a check: within tolerance, calibrated, or still out of tolerance.
Verdict = Literal["within", "calibrated", "out_of_tolerance"]


@dataclass(frozen=True)
class WatchEvent:
    """An event of the live monitoring."""

    #: ``triggered``, ``checked``, ``primary_off``, ``primary_valid``, ``calibrating``, ``calibrated``, ``not_stored``,
    #: ``given_up``, ``primary_silent``, ``primary_resumed``, ``secondary_silent``, ``secondary_resumed``, ``aligned``
    #: or ``alignment_lost``.
    kind: str
    time: float  #: IMU time, s.
    number: int = 0  #: Number of the secondary; 0 for all.
    values: Mapping[str, Any] = field(default_factory=dict)  #: Other values, JSON types.


#: New results by number, the error if there is one, and whether it is final.
_Fits = tuple[dict[int, PairResult], InputError | None, bool]

#: Executes a call and returns its future.
Submit = Callable[[Callable[[], _Fits]], "Future[_Fits]"]


def call_now(work: Callable[[], _Fits]) -> "Future[_Fits]":
    """Execute `work` immediately."""
    future: Future[_Fits] = Future()
    future.set_result(work())
    return future


class PairWatch:
    """Monitors a stream of blocks; `store` is called with the number and the new values of a secondary.

    A ConfigurationError of `store` is reported by an event. The fits are executed by `submit`, by default immediately;
    a live watch runs them in parallel with its stream. Rows without output of the primary are invalid and have NaN
    counts. `stored` contains the calibration of each secondary by number, `checks` its last check, `verdicts` the state
    of its sensors since then, and `primary_off` the sensors of the primary that were out of tolerance in the last
    check. `silent` contains the numbers of the IMUs that send no samples, 0 for the primary, and `unaligned` the
    secondaries whose clock offset is not measured, so that their motion is not used.
    """

    def __init__(
        self,
        imu: ImuModel,
        secondaries: tuple[Secondary, ...],
        calibration: PairCalibration,
        store: Callable[[int, StoredCrossCalibration], None] = lambda number, stored: None,
        submit: Submit = call_now,
    ) -> None:
        self._imu, self._secondaries, self._calibration = imu, secondaries, calibration
        self._schedule, self._store, self._submit = calibration.schedule, store, submit
        self.state = "waiting"
        self.stored = {s.number: s.stored for s in secondaries}
        self.checks: dict[int, StaticCheck] = {}
        self.calibrated: dict[int, PairResult] = {}
        self.verdicts: dict[int, dict[str, Verdict]] = {}
        self.primary_off: tuple[str, ...] = ()
        self.silent: frozenset[int] = frozenset()
        self.unaligned: frozenset[int] = frozenset()
        self._last_output: dict[int, float] = {}
        self._pending_events: list[WatchEvent] = []
        self._fits: Future[_Fits] | None = None
        self._out_of_tolerance: dict[int, StaticCheck] = {}
        self._pending: list[SampleBlock] = []
        self._blocks: list[SampleBlock] = []
        self._due = calibration.schedule.trigger != "command"
        self._checked: float | None = None
        self._evaluated = 0.0
        self._motion, self._rest = 0.0, np.zeros(3)

    def command(self) -> None:
        """Request a check at the next rest, regardless of the period."""
        self._due = True

    def realigned(self, number: int, time: float, offset: float, sigma: float) -> None:
        """Record a new clock offset of a secondary, s; discard the motion so far, which was not aligned."""
        self._pending_events.append(WatchEvent("aligned", time, number, {"offset": offset, "sigma": sigma}))
        self.unaligned -= {number}
        if self.state == "calibrating":
            self._blocks = [block for block in self._blocks if not self._moving(block)]
            self._pending = [block for block in self._pending if not self._moving(block)]
            self._fits, self._motion = None, 0.0

    def lost_alignment(self, number: int, time: float) -> None:
        """Record that a secondary's clock offset is no longer known well enough for a calibration."""
        self._pending_events.append(WatchEvent("alignment_lost", time, number))
        self.unaligned |= {number}

    def _moving(self, block: SampleBlock) -> float:
        """Return the duration of motion in a block, s."""
        rate = block.counts[block.valid, :3] * self._imu.count_size[:3] - self._rest
        moving = np.linalg.norm(rate, axis=1) > np.deg2rad(self._schedule.moving_dps)
        return float(np.count_nonzero(moving)) / self._imu.sample_rate

    @property
    def progress(self) -> float:
        """Fraction of the required motion that has been collected, 0 to 1."""
        return min(self._motion / self._schedule.motion_s, 1.0) if self.state == "calibrating" else 0.0

    def feed(self, block: SampleBlock) -> list[WatchEvent]:
        """Add samples, in blocks of any length, and return the resulting events."""
        second, events = round(self._imu.sample_rate), [*self._pending_events, *self._update_silent(block)]
        self._pending_events.clear()
        self._pending.append(block)
        while sum(map(len, self._pending)) >= second:
            whole = join_blocks(self._pending)
            events += self._process(whole.part(0, second))
            self._pending = [whole.part(second, len(whole))]
        return events

    def _update_silent(self, block: SampleBlock) -> list[WatchEvent]:
        """Update the set of silent IMUs; return the events of changes."""
        if not len(block):
            return []
        now, events = float(block.time[-1]), list[WatchEvent]()
        streams = {s.number: block.others[:, index] for index, s in enumerate(self._secondaries)}
        for number, counts in {0: block.counts, **streams}.items():
            present = block.time[~np.isnan(counts).any(axis=1)]
            if len(present) or not number:
                start = self._last_output.get(number, float(block.time[0]))
                self._last_output[number] = float(present[-1]) if len(present) else start
            last = self._last_output.get(number, now)  # a secondary may start later
            silent = now - last > SILENCE
            if silent != (number in self.silent):
                self.silent ^= {number}
                kind = f"{'secondary' if number else 'primary'}_{'silent' if silent else 'resumed'}"
                events.append(WatchEvent(kind, now, number))
        return events

    def _process(self, block: SampleBlock) -> list[WatchEvent]:
        now = float(block.time[-1])
        events = [] if self.state != "waiting" else self._wait(now)
        if self.state == "waiting":
            return events
        moving = self._moving(block) if self.state == "calibrating" else 0.0
        if moving and self.unaligned & self._out_of_tolerance.keys():
            return events
        self._motion += moving
        self._blocks.append(block)
        if now - self._evaluated < EVALUATION_INTERVAL:
            return events
        self._evaluated = now
        return events + (self._check(now) if self.state == "checking" else self._calibrate(now, last=False))

    def finish(self) -> list[WatchEvent]:
        """Complete a check or calibration at the end of the stream if the samples so far are sufficient."""
        events = [*self._pending_events, *(e for block in self._pending if len(block) for e in self._process(block))]
        self._pending = []
        self._pending_events.clear()
        if not self._blocks:
            return events
        now = float(self._blocks[-1].time[-1])
        events += self._check(now) if self.state == "checking" else []
        return events + (self._calibrate(now, last=True) if self.state == "calibrating" else [])

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
        kept = MAX_REST_FACTOR * self._schedule.static_s
        self._blocks = [block for block in self._blocks if now - float(block.time[-1]) <= kept]
        if rest is None:
            return []
        events, self._out_of_tolerance = list[WatchEvent](), {}
        was_invalid = self.primary_off
        for index, secondary in enumerate(self._secondaries):
            number = secondary.number
            check = calibration.check(data, rest, index, secondary, self.stored[number])
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
        if not events:
            return []
        if was_invalid and not self.primary_off:
            events.append(WatchEvent("primary_valid", now))
        self.state = "calibrating" if self._out_of_tolerance else "waiting"
        if self._out_of_tolerance:
            self._rest = np.median(data.gyro[rest[0] : rest[1]], axis=0)
            self._motion = sum(map(self._moving, self._blocks))
            events.append(WatchEvent("calibrating", now, 0, {"secondaries": list(self._out_of_tolerance)}))
        return events

    def _calibrate(self, now: float, last: bool) -> list[WatchEvent]:
        """Calibrate once there is enough motion; only the last evaluation reports a failure."""
        if self._fits is None:
            is_final = last or sum(map(len, self._blocks)) >= self._schedule.longest_s * self._imu.sample_rate
            if self._motion < self._schedule.motion_s and not is_final:
                return []
            self._fits = self._submit(partial(self._fit, is_final, stage_data(self._blocks, self._imu), self._motion))
        if not last and not self._fits.done():
            return []
        (done, failed, last_fits), self._fits = self._fits.result(), None
        events: list[WatchEvent] = []
        for number, result in done.items():
            self.stored[number], self.calibrated[number] = result.stored, result
            check = self._out_of_tolerance.pop(number)
            for sensor, value in result.static.items():
                deviation = check.secondary[sensor]
                if not deviation.within and value is not None and value <= deviation.limit:
                    self.verdicts[number][sensor] = "calibrated"
            skipped = [s for s in SENSORS if not (check.secondary[s].within or s in result.static)]
            events.append(WatchEvent("calibrated", now, number, {"sensors": list(result.static), "skipped": skipped}))
            try:
                self._store(number, result.stored)
            except ConfigurationError as error:
                events.append(WatchEvent("not_stored", now, number, {"why": error.as_text}))
        if failed and not last_fits:
            return events + (self._calibrate(now, last) if last else [])
        if failed:
            events.append(WatchEvent("given_up", now, 0, {"why": failed.as_text}))
        self.state, self._blocks = "waiting", []
        return events

    def _fit(self, last: bool, data: StageData, motion: float) -> _Fits:
        """Fit the secondaries that are out of tolerance, up to the first failure."""
        required = self._schedule.motion_s
        if motion < required:
            return {}, InsufficientDataError("solve.too_little_motion", seconds=motion, wanted=required), last
        done: dict[int, PairResult] = {}
        failed: InputError | None = None
        for index, secondary in enumerate(self._secondaries):
            number = secondary.number
            if failed or number not in self._out_of_tolerance:
                continue
            choice = self._calibration.choose_terms(self._out_of_tolerance[number])
            try:
                done[number] = self._calibration.calibrate(data, index, secondary, choice, self.stored[number])
            except InputError as error:
                failed = error
        return done, failed, last


def check_values(check: StaticCheck) -> dict[str, Any]:
    """Return a static check as JSON values: deviation, threshold and result of each sensor of both IMUs."""
    return {
        unit: {s: {"value": x.value, "limit": x.limit, "within": x.within} for s, x in deviations.items()}
        for unit, deviations in (("primary", check.primary), ("secondary", check.secondary))
    }
