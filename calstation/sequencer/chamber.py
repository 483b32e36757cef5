"""Protection of a chamber and the units in it: checks before every set point and at every poll, and the safe end."""

import math
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import NoReturn

from calstation.devices import Chamber, ChamberStatus
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.messages import Text
from calstation.sequencer.context import Clock, Emit
from calstation.sequencer.events import ChamberChanged, Message
from calstation.sequencer.guard import attempt

#: Station time between two polls of the chamber, s.
POLL_INTERVAL = 2.0

#: Host time for which `ChamberControl.update` waits for a reply before the control loop continues without it, s.
_PATIENCE = 0.25

#: Largest temperature of metal that may be touched for minutes, °C (ISO 13732-1: 48 °C for 10 min, 43 °C for 8 h).
TOUCHABLE_C = 43.0

#: Smallest step of the set point on a ramp, K, because some controllers store every set point in memory that wears out.
_LEAST_STEP = 0.1

#: Largest accepted overshoot of the air temperature beyond the range of a device, K.
_OVERSHOOT = 5.0

#: Change of the air temperature that shows that the chamber follows its set point, K.
_PROGRESS = 0.5

#: Rate of the air temperature that is not plausible, relative to the largest rate in the profile, and period over which
#: it is measured, s.
_RATE_FACTOR, _RATE_TIME = 3.0, 30.0

#: Station time between two messages while the chamber returns to ambient, s.
_REPORT_INTERVAL = 60.0

#: Station time at ambient after which a unit whose temperature is unknown or no longer changes may be touched, s.
_BLIND_SOAK = 1800.0

#: Largest negligible change of the temperature of a unit in this time, K.
_SETTLED = 1.0

#: Number of polls in a row that the chamber may leave unanswered on its way to ambient.
_MAX_UNANSWERED = 20

#: Station time within which the chamber must return to ambient; otherwise, a failure is reported, s.
_RETURN_TIME = 4.0 * 3600.0


@dataclass(frozen=True)
class SoakProgress:
    """Progress of a soak: rates of the units by slot and their `limit`, K/min, and the `remaining` time, s."""

    limit: float
    rates: Mapping[str, float]
    remaining: float | None


@dataclass(frozen=True)
class ChamberLimits:
    """Limits of a chamber with a table and units in it; temperatures in °C, differences in K, times in s.

    ranges : lowest and highest temperature of "chamber", "table" and "unit"
    max_rate : largest rate of change of the set point, K/s
    ambient, dew_point : temperature and dew point of the room
    tolerance : largest difference between air and set point at which the chamber has arrived
    agreement : largest difference between a unit and the air after a soak
    follow_time : time within which the air must approach the set point
    """

    ranges: Mapping[str, tuple[float, float]]
    max_rate: float
    ambient: float
    dew_point: float
    tolerance: float = 1.0
    agreement: float = 10.0
    follow_time: float = 600.0

    @property
    def range(self) -> tuple[float, float]:
        """Lowest and highest temperature that all devices allow."""
        return max(low for low, _ in self.ranges.values()), min(high for _, high in self.ranges.values())

    def check(self, temperature: float, rate: float | None = None) -> None:
        """Check a target, °C, and the rate at which the set point moves to it, K/s. Raises ConfigurationError."""
        for device, (low, high) in self.ranges.items():
            if not low <= temperature <= high:
                values = {"temperature": temperature, "low": low, "high": high}
                raise ConfigurationError("chamber.target_outside", device=device, **values)
        if rate is not None and not 0.0 < rate <= self.max_rate * (1.0 + 1e-9):
            raise ConfigurationError("chamber.rate_outside", rate=60.0 * rate, allowed=60.0 * self.max_rate)

    def may_open(self, status: ChamberStatus, units: Mapping[str, float]) -> bool:
        """Return whether neither the air nor a unit is below the dew point of the room or too hot to touch."""
        low, high = self.open_range
        return all(low <= value <= high for value in (status.air_c, *units.values()))

    @property
    def open_range(self) -> tuple[float, float]:
        """Lowest and highest temperature that may be exposed to the room."""
        return self.dew_point, TOUCHABLE_C


@dataclass(frozen=True)
class _Poll:
    """A poll of the chamber at station time `time`, s, with the set point that is sent after it, °C, or None."""

    time: float
    set_point: float | None
    status: "Future[ChamberStatus]"


class ChamberControl:
    """Controls the temperature of a chamber, and checks it at every poll.

    A separate thread communicates with the chamber, so that a slow reply delays neither the watchdog of the table nor a
    stop.

    `begin` starts the chamber; then `hold` or `ramp` sets a target and `update` is called at every tick. `safe` sends
    the chamber to ambient, where it stays until `wait_until_safe` has switched it off. `target` is the last target,
    `status` the last poll, and `soak` a function that returns the progress of the current soak, or None. Methods raise
    DeviceFaultError for a fault of the chamber and ConfigurationError for a target outside the limits.
    """

    status: ChamberStatus

    def __init__(self, chamber: Chamber, limits: ChamberLimits, clock: Clock, emit: Emit) -> None:
        self.limits = limits
        self.target = math.nan
        self.soak: Callable[[], SoakProgress] | None = None
        self._chamber, self._clock, self._emit = chamber, clock, emit
        self._set_point = self._expected = math.nan  #: Last set point sent, and set point at the last poll, °C.
        self._rate = limits.max_rate
        self._set_point_time = self._polled_at = -math.inf
        #: Times, s, temperatures of the air, °C, and its distances from the set point, K, since the last target.
        self._air: deque[tuple[float, float, float]] = deque()
        self._units: Mapping[str, float] = {}
        self._has_begun = False
        self._link = ThreadPoolExecutor(1, "chamber")
        self._pending: _Poll | None = None

    @property
    def arrived(self) -> bool:
        """Whether the set point has reached the target, and the air has reached the set point."""
        return self._set_point == self.target and self._distance <= self.limits.tolerance

    @property
    def remaining(self) -> float:
        """Estimated time until the target is reached, s, without settling."""
        gap = self._distance if self._set_point == self.target else abs(self.target - self._set_point)
        return 0.0 if self.arrived else gap / self._rate

    @property
    def may_open(self) -> bool:
        """Whether the operator may open the chamber, according to the last poll."""
        return self.limits.may_open(self.status, self._units)

    def begin(self) -> None:
        """Poll the chamber, then start it at its air temperature, or the nearest temperature that all devices allow."""
        self.status = self._chamber.status()
        self._check_state()
        low, high = self.limits.range
        present = min(max(self.status.air_c, low), high)
        self._set_target(present, self.limits.max_rate)
        self._has_begun = True
        self._send(present)
        self._chamber.start()
        self._send(present)  # some controllers accept a set point only after their start

    def hold(self, temperature: float) -> None:
        """Go to a temperature, °C, at the largest rate, and stay there."""
        self.ramp(temperature, self.limits.max_rate)

    def ramp(self, temperature: float, rate: float) -> None:
        """Move the set point to a temperature, °C, at a rate, K/s, and stay there."""
        self.limits.check(temperature, rate)
        self._set_target(temperature, rate)

    def update(self, units: Mapping[str, float]) -> None:
        """Move the set point and poll the chamber when due; `units` are the units' temperatures by slot, °C.

        A late reply is checked at the next call after its arrival.
        """
        if self._pending is None:
            if self._clock.now() - self._polled_at < POLL_INTERVAL:
                return
            self._pending = self._begin_poll()
        poll = self._pending
        if not wait([poll.status], _PATIENCE).done:
            return
        self._pending = None
        self._end_poll(poll, units)
        self._check_state()
        if not self.status.running:
            raise DeviceFaultError("chamber.not_running")
        self._check_air(poll.time)

    def check_agreement(self, unit: float) -> None:
        """Check after a soak that the temperature of a unit, °C, agrees with the chamber's. Raises DeviceFaultError."""
        if not abs(unit - self.status.air_c) <= self.limits.agreement:
            values = {"unit_c": unit, "air_c": self.status.air_c, "allowed": self.limits.agreement}
            raise DeviceFaultError("chamber.sensors_disagree", **values)

    def safe(self) -> list[Text]:
        """Send the chamber to ambient at once and leave it on; return any failures instead of raising them.

        The set point changes in one step, even if there is an alarm or the door is open.
        """
        if not self._has_begun:
            return []
        self._set_target(self.limits.ambient, self.limits.max_rate)
        self._pending = None
        failures: list[Text] = []
        attempt(lambda: self._send(self.limits.ambient), failures)
        if not failures:
            attempt(lambda: self._emit(Message("chamber_to_ambient", self._temperatures())), failures)
        return failures

    def wait_until_safe(self, units: Callable[[], Mapping[str, float]], tick: Callable[[], None]) -> list[Text]:
        """Wait until the chamber may be opened, with a message every minute, then switch it off; return any failures.

        It first sends the chamber to ambient unless `safe` has done so. A second call does nothing.

        Parameters
        ----------
        units : function that returns the units' temperatures by slot, °C; without any, the wait is longer
        tick : function that lets one tick of station time pass
        """
        if not self._has_begun:
            return []
        failures = [] if self.target == self.limits.ambient else self.safe()
        emit, self._has_begun = self._emit, False
        self._emit = lambda event: attempt(lambda: emit(event), failures)  # a full disk does not end the wait
        unknown: list[Text] = []
        attempt(lambda: self._wait_until_safe(units, tick), unknown)
        if unknown:
            self._emit(Message("chamber_unknown", {"ambient_c": self.limits.ambient}))
        return failures + unknown

    def _wait_until_safe(self, units: Callable[[], Mapping[str, float]], tick: Callable[[], None]) -> None:
        begin = reported_at = requested_at = self._clock.now()
        arrived_at, unanswered = math.inf, 0
        settled: dict[str, tuple[float, float]] = {}
        while True:
            now = self._clock.now()
            is_due = now - max(self._polled_at, requested_at) >= POLL_INTERVAL
            requested_at = now if is_due else requested_at
            if is_due and (unanswered := self._poll_again(units(), unanswered)) == 0:
                if self._distance > self.limits.tolerance + _OVERSHOOT:
                    arrived_at = math.inf
                elif arrived_at == math.inf:
                    arrived_at = now
                for slot, t in self._units.items():
                    if slot not in settled or abs(t - settled[slot][1]) > _SETTLED:
                        settled[slot] = now, t
                if now >= arrived_at + _BLIND_SOAK:  # a stuck sensor, or one in a self-heated unit, no longer changes
                    self._units = {s: t for s, t in self._units.items() if now < settled[s][0] + _BLIND_SOAK}
                if now >= arrived_at + (0.0 if self._units else _BLIND_SOAK) and self.may_open:
                    break
            if now - begin > _RETURN_TIME:
                self._raise_not_following(now - begin)
            if now - reported_at >= _REPORT_INTERVAL:
                reported_at = now
                self._emit(Message("chamber_returning", self._temperatures()))
            tick()
        self._chamber.stop()
        self._emit(Message("chamber_may_be_opened", self._temperatures()))

    def _poll_again(self, units: Mapping[str, float], unanswered: int) -> int:
        """Poll the chamber and return the new number of unanswered polls. Raises DeviceFaultError after too many."""
        try:
            self._end_poll(self._begin_poll(), units)
            if not abs(self.status.set_point_c - self.limits.ambient) <= self.limits.tolerance:
                self._send(self.limits.ambient)
        except DeviceFaultError:
            if unanswered + 1 >= _MAX_UNANSWERED:
                raise
            return unanswered + 1
        return 0

    @property
    def _distance(self) -> float:
        return abs(self.status.air_c - self._set_point)

    def _set_target(self, temperature: float, rate: float) -> None:
        self.target, self._rate = temperature, rate
        self._set_point_time = self._clock.now()
        self._air.clear()

    def _send(self, temperature: float) -> None:
        self._link.submit(self._chamber.set_point, temperature).result()
        self._set_point = temperature

    def _begin_poll(self) -> _Poll:
        """Request the state, and move the set point along the ramp."""
        now = self._clock.now()
        step, gap = self._rate * (now - self._set_point_time), self.target - self._set_point
        point = None
        if gap and abs(gap) <= step:
            point = self.target
        elif gap and step >= _LEAST_STEP:
            point = self._set_point + math.copysign(step, gap)

        def exchange() -> ChamberStatus:
            status = self._chamber.status()
            if point is not None:
                self._chamber.set_point(point)
            return status

        return _Poll(now, point, self._link.submit(exchange))

    def _end_poll(self, poll: _Poll, units: Mapping[str, float]) -> None:
        """Wait for the reply, and emit the state. Raises DeviceFaultError."""
        self.status, self._expected = poll.status.result(), self._set_point
        if poll.set_point is not None:
            self._set_point, self._set_point_time = poll.set_point, max(self._set_point_time, poll.time)
        self._polled_at = poll.time
        self._units = {slot: value for slot, value in units.items() if math.isfinite(value)}
        self._air.append((poll.time, self.status.air_c, self._distance))
        self._show(poll.time)

    def _show(self, now: float) -> None:
        soak = SoakProgress(math.nan, {}, None) if self.soak is None else self.soak()
        self._emit(
            ChamberChanged(
                time=now,
                air_c=self.status.air_c,
                set_point_c=self._set_point,
                target_c=self.target,
                remaining=self.remaining if soak.remaining is None else soak.remaining,
                units=dict(self._units),
                rates={slot: rate for slot, rate in soak.rates.items() if math.isfinite(rate)},
                limit=None if self.soak is None else soak.limit,
                open_c=self.limits.open_range,
                door_open=self.status.door_open,
            )
        )

    def _check_state(self) -> None:
        if self.status.alarm is not None:
            raise DeviceFaultError("chamber.alarm", alarm=self.status.alarm)
        if self.status.door_open:
            raise DeviceFaultError("chamber.door_open", air_c=self.status.air_c)
        if not math.isfinite(self.status.air_c):
            raise DeviceFaultError("chamber.no_temperature")

    def _check_air(self, now: float) -> None:
        """Check that the temperature of the air follows the set point plausibly. Raises DeviceFaultError."""
        limits, air = self.limits, self.status.air_c
        if not abs(self.status.set_point_c - self._expected) <= limits.tolerance:
            values = {"sent_c": self._expected, "found_c": self.status.set_point_c}
            raise DeviceFaultError("chamber.set_point_changed", **values)
        for device, (low, high) in limits.ranges.items():
            if not low - _OVERSHOOT <= air <= high + _OVERSHOOT:
                raise DeviceFaultError("chamber.air_outside", device=device, air_c=air, low=low, high=high)
        begin, before, _ = next(entry for entry in self._air if entry[0] >= now - _RATE_TIME)
        if abs(air - before) > _RATE_FACTOR * limits.max_rate * (now - begin) + 2.0 * _PROGRESS:
            rate = 60.0 * abs(air - before) / (now - begin)
            raise DeviceFaultError("chamber.too_fast", rate=rate, allowed=60.0 * limits.max_rate)
        if now - self._air[0][0] < limits.follow_time:
            return
        while now - self._air[1][0] >= limits.follow_time:
            self._air.popleft()
        gap = abs(self._set_point - air)
        if min(distance for _, _, distance in self._air) <= limits.tolerance:
            return
        if all(value == air for time, value, _ in self._air if now - time <= 0.5 * limits.follow_time):
            raise DeviceFaultError("chamber.sensor_stuck", air_c=air, set_point_c=self._set_point)
        if abs(self._set_point - self._air[0][1]) - gap < _PROGRESS:
            self._raise_not_following(limits.follow_time)

    def _raise_not_following(self, seconds: float) -> NoReturn:
        values = {"air_c": self.status.air_c, "set_point_c": self._set_point}
        raise DeviceFaultError("chamber.not_following", minutes=round(seconds / 60.0), **values)

    def _temperatures(self) -> dict[str, float]:
        """Return the temperatures of the air, of the unit that is farthest from ambient, and of the room."""
        ambient = self.limits.ambient
        farthest = max(self._units.values(), key=lambda value: abs(value - ambient), default=self.status.air_c)
        return {"air_c": self.status.air_c, "unit_c": farthest, "ambient_c": ambient}
