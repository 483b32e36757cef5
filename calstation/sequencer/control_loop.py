"""The engine's tick: poll the table, drain samples, feed the watchdog, hear commands."""

import time
from collections import deque
from collections.abc import Callable
from itertools import chain

import numpy as np

from calstation.devices.interfaces import LOCAL_CONTROL, Imu, NoFramesError, Table, TableStatus
from calstation.errors import DeviceFaultError
from calstation.sequencer.acquisition import Acquisition, Flow
from calstation.sequencer.control import Control, PauseRequested, SpoiltStep, StopRequested
from calstation.sequencer.events import SampleStats, TableMoved, Trace
from calstation.sequencer.guard import latched
from calstation.sequencer.ports import Clock, Emit

#: Station time without a sample that counts as no data, s.
NO_DATA = 1.0

_NOTHING = Flow(0, 0, False, False, False)

#: Host time between two events that only refresh a display, s.
_SHOW_TABLE, _SHOW_SAMPLES = 0.1, 0.5

#: Ticks kept for a trace: a bench faster than its listener shows the latest.
_TRACED_AT_MOST = 400


class ControlLoop:
    """Runs ticks in the engine's thread and interrupts the step in hand.

    Attributes
    ----------
    status : the table as last polled
    powered : the axes must stay enabled; a table that drops them is a fault
    pausable : a pause interrupts (otherwise it waits)
    watchful : lost or saturated samples spoil the step
    patient : bytes that belong to no frame are taken for silence (otherwise they are a fault at once)
    """

    def __init__(
        self,
        table: Table,
        imu: Imu,
        acquisition: Acquisition,
        clock: Clock,
        control: Control,
        emit: Emit,
        service: Callable[[], None],
        on_show: Callable[[], None],
    ) -> None:
        self._table = table
        self._imu = imu
        self._acquisition = acquisition
        self._clock = clock
        self._control = control
        self._emit = emit
        self._service = service
        self._on_show = on_show
        self._traced: deque[tuple[float, tuple[float, ...]]] = deque(maxlen=_TRACED_AT_MOST)
        self._fed = self._shown_table = self._shown_samples = -1e9
        self.status: TableStatus = table.status()
        self.flow = _NOTHING
        self.powered = False
        self.pausable = False
        self.watchful = False
        self.patient = False

    def tick(self) -> None:
        """Let a tick of station time pass, then `look`."""
        self._clock.sleep(self._clock.tick)
        self.look()

    def look(self) -> None:
        """Poll, drain, feed the watchdog, hear commands.

        Raises DeviceFaultError for a faulty table, StopRequested, PauseRequested or SpoiltStep.
        """
        asked = self._clock.now()
        self.status = self._table.status()
        self._acquisition.poll(self.status, asked, self._clock.now())
        self.flow = self._drained()
        self._trace()
        self.feed_watchdog()
        self._show()
        self._check_table()
        self._check_unit()
        self.check_cancelled()
        if self.watchful:
            self._check_data()

    @property
    def silent(self) -> bool:
        """Whether the unit has sent nothing for too long."""
        return self._clock.now() - self._acquisition.last_arrival > NO_DATA

    def check_cancelled(self) -> None:
        """Take the operator's commands. Raises StopRequested or PauseRequested."""
        self._control.take()
        if self._control.stopping:
            raise StopRequested
        if self._control.pausing and self.pausable:
            raise PauseRequested

    def feed_watchdog(self) -> None:
        """Feed the table's watchdog every quarter of its time (host time); let the journal write."""
        self._service()
        now = time.monotonic()
        if self.status.watchdog > 0.0 and now - self._fed > 0.25 * self.status.watchdog:
            self._table.heartbeat()
            self._fed = now

    def wait(self, condition: Callable[[], bool], timeout: float, failure: str | Callable[[], str]) -> None:
        """Tick until `condition`; raises DeviceFaultError(`failure`) after `timeout` s of station time."""
        deadline = self._clock.now() + timeout
        while not condition():
            if self._clock.now() > deadline:
                raise DeviceFaultError(failure if isinstance(failure, str) else failure())
            self.tick()

    def rested(self, seconds: float) -> bool:
        """Tick until `seconds` of IMU time have been received; False where the unit falls silent."""
        begin = self._acquisition.newest or 0.0

        def enough() -> bool:
            return (self._acquisition.newest or 0.0) - begin >= seconds - 1e-9

        self.wait(lambda: enough() or self.silent, 1.5 * seconds + 10.0, _late(seconds))
        return enough()

    def rest(self, seconds: float) -> None:
        """Tick until `seconds` of IMU time have been received."""
        acquisition = self._acquisition
        self.wait(lambda: acquisition.newest is not None, 5.0, "IMU: no data; check port, baud and power")
        begin = acquisition.newest or 0.0
        self.wait(
            lambda: (acquisition.newest or 0.0) - begin >= seconds - 1e-9,
            1.5 * seconds + 10.0,
            _late(seconds),
        )

    def _check_table(self) -> None:
        if self.status.fault == LOCAL_CONTROL:
            raise DeviceFaultError(
                "table: it was switched to local control; switch it back, then start again"
            )
        if self.status.fault is not None:
            raise latched(self.status.fault)
        if self.powered and not self.status.interlock_closed:
            raise DeviceFaultError("table: the interlock was opened; close the cover and start again")
        if self.powered and not self.status.enabled:
            raise DeviceFaultError("table: the drive switched the axes off; look at the drive's display")

    def _check_unit(self) -> None:
        if self.flow.stuck:
            raise DeviceFaultError(
                f"IMU: {self.flow.stuck} shows the same value all the time; switch the unit off and on,"
                " replace it where that does not help"
            )

    def _drained(self) -> Flow:
        try:
            return self._acquisition.drain()
        except NoFramesError:
            if not self.patient:
                raise
            return _NOTHING

    def _check_data(self) -> None:
        if self.silent:
            raise SpoiltStep("no_data")
        if self.flow.missing:
            raise SpoiltStep("gap")
        if self.flow.invalid:
            raise SpoiltStep("invalid")
        if self.flow.saturated:
            raise SpoiltStep("saturated")

    def _trace(self) -> None:
        newest, recent = self._acquisition.newest, self._acquisition.recent
        if self.flow.count and newest is not None and recent is not None and np.isfinite(recent[0]).all():
            self._traced.append((newest, recent[0]))

    def _show(self) -> None:
        now = time.monotonic()
        if now - self._shown_table >= _SHOW_TABLE:
            self._shown_table = now
            (outer, inner), (outer_rate, inner_rate) = self.status.angles, self.status.rates
            if np.isfinite(self.status.angles).all():
                self._emit(
                    TableMoved(
                        float(outer), float(inner), float(outer_rate), float(inner_rate), self.status.moving
                    )
                )
            if self._traced:
                times, outputs = zip(*self._traced, strict=True)
                self._emit(Trace(times, tuple(chain.from_iterable(outputs))))
                self._traced.clear()
        if now - self._shown_samples >= _SHOW_SAMPLES and self._acquisition.recent is not None:
            self._shown_samples = now
            self._on_show()
            mean, temperature = self._acquisition.recent
            self._emit(
                SampleStats(
                    self._acquisition.received,
                    self._acquisition.gaps,
                    self._imu.stats.crc_errors,
                    mean,
                    temperature,
                )
            )


def _late(seconds: float) -> str:
    return f"IMU: {seconds:g} s of data did not come in time; check the link and the sample rate"
