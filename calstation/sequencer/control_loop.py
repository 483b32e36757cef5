"""The engine's control loop: polls the table, drains samples, feeds the watchdog and processes commands."""

import logging
import time
from collections import deque
from collections.abc import Callable
from itertools import chain

import numpy as np

from calstation.devices import LOCAL_CONTROL, NoFramesError, TableStatus
from calstation.errors import CalstationError, DeviceFaultError
from calstation.sequencer.acquisition import Acquisition, Flow
from calstation.sequencer.context import RunContext
from calstation.sequencer.control import PauseRequested, StepInvalid
from calstation.sequencer.events import JointsMoved, TableMoved, Trace
from calstation.sequencer.guard import check_joints, latched

#: Station time without a sample after which the unit counts as silent, s.
NO_DATA = 1.0

#: Minimum host time between two events that only refresh a display, s.
_SHOW_TABLE, _SHOW_PROGRESS = 0.1, 0.5

#: Host time of a tick above which a warning is logged, s.
_SLOW_TICK = 1.0

#: Maximum number of ticks kept for a trace; if the listener is too slow, only the latest are shown.
_MAX_TRACED = 400

logger = logging.getLogger(__name__)


class ControlLoop:
    """Runs ticks in the engine's thread and interrupts the running step.

    If `powered`, it is a fault if the axes become disabled. If `pausable`, a pause interrupts the step;
    otherwise it waits. If `watchful`, lost or saturated samples invalidate the step. If `patient`, bytes that belong to
    no frame are treated as silence; otherwise they are an immediate fault.
    """

    def __init__(self, context: RunContext, acquisition: Acquisition, on_show: Callable[[], None]) -> None:
        self.context = context
        self.acquisition = acquisition
        self._on_show = on_show
        self._traced: deque[tuple[float, tuple[float, ...]]] = deque(maxlen=_MAX_TRACED)
        self._fed = self._shown_table = self._shown_progress = -1e9
        self.status: TableStatus = context.table.status()
        self.flow = Flow()
        self.powered = False
        self.pausable = False
        self.watchful = False
        self.patient = False

    def tick(self) -> None:
        """Let one tick of station time pass, then call `update`."""
        begin = time.monotonic()
        self.context.clock.sleep(self.context.clock.tick)
        self.update()
        seconds = time.monotonic() - begin
        if seconds > _SLOW_TICK:
            logger.warning("a tick of the control loop took %.1f s", seconds)

    def update(self) -> None:
        """Poll the table, drain samples, feed the watchdog and process commands.

        Raises DeviceFaultError for a table fault or a stuck channel, StopRequested, PauseRequested or StepInvalid.
        """
        clock = self.context.clock
        asked = clock.now()
        self.status = self.context.table.status()
        self.acquisition.poll(self.status, asked, clock.now())
        try:
            self.flow = self.acquisition.drain()
        except NoFramesError:
            if not self.patient:
                raise
            self.flow = Flow()
        newest, recent = self.acquisition.newest, self.acquisition.recent
        if self.flow.count and newest is not None and recent is not None and np.isfinite(recent[0]).all():
            self._traced.append((newest, recent[0]))
        self.feed_watchdog()
        self._show()
        self._check_table()
        if self.flow.stuck:
            raise DeviceFaultError("stream.stuck", channel=self.flow.stuck)
        self.check_cancelled()
        if self.watchful:
            self._check_data()

    @property
    def silent(self) -> bool:
        """Whether no sample has arrived for more than `NO_DATA` s."""
        return self.context.clock.now() - self.acquisition.last_arrival > NO_DATA

    def check_cancelled(self) -> None:
        """Process the operator's commands. Raises StopRequested or PauseRequested."""
        self.context.control.check_cancelled()
        if self.context.control.pausing and self.pausable:
            raise PauseRequested

    def feed_watchdog(self) -> None:
        """Feed the table's watchdog every quarter of its timeout (host time) and service the log."""
        journal = self.context.slot.journal
        if journal is not None:
            journal.service()
        now = time.monotonic()
        if self.status.watchdog > 0.0 and now - self._fed > 0.25 * self.status.watchdog:
            self.context.table.heartbeat()
            self._fed = now

    def wait(
        self, condition: Callable[[], bool], timeout: float, failure: CalstationError | Callable[[], CalstationError]
    ) -> None:
        """Tick until `condition` is true; after `timeout` s of station time raise `failure` or the error it returns."""
        clock = self.context.clock
        deadline = clock.now() + timeout
        while not condition():
            if clock.now() > deadline:
                raise failure if isinstance(failure, CalstationError) else failure()
            self.tick()

    def rested(self, seconds: float) -> bool:
        """Tick until `seconds` of IMU time have been received; return False if the unit falls silent."""
        enough = self._received(seconds)
        self.wait(lambda: enough() or self.silent, 1.5 * seconds + 10.0, _late(seconds))
        return enough()

    def rest(self, seconds: float) -> None:
        """Tick until `seconds` of IMU time have been received.

        Raises DeviceFaultError without a sample for 5 s, or after 1.5·`seconds` + 10 s of station time; see `update`.
        """
        self.wait(lambda: self.acquisition.newest is not None, 5.0, DeviceFaultError("stream.no_data"))
        self.wait(self._received(seconds), 1.5 * seconds + 10.0, _late(seconds))

    def _received(self, seconds: float) -> Callable[[], bool]:
        begin = self.acquisition.newest or 0.0
        return lambda: (self.acquisition.newest or 0.0) - begin >= seconds - 1e-9

    def _check_table(self) -> None:
        if self.status.fault == LOCAL_CONTROL:
            raise DeviceFaultError("motion.switched_to_local")
        if self.status.fault is not None:
            raise latched(self.status.fault)
        gimbal, joints = self.context.task.geometry.gimbal, self.status.joints
        if self.powered and self.status.homed and gimbal is not None and joints is not None:
            check_joints(gimbal, joints)
        if self.powered and not self.status.interlock_closed:
            raise DeviceFaultError("motion.interlock_opened")
        if self.powered and not self.status.enabled:
            raise DeviceFaultError("motion.switched_off")

    def _check_data(self) -> None:
        if self.silent:
            raise StepInvalid("no_data")
        if self.flow.missing:
            raise StepInvalid("gap")
        if self.flow.invalid:
            raise StepInvalid("invalid")
        if self.flow.saturated:
            raise StepInvalid("saturated")

    def _show(self) -> None:
        now, emit = time.monotonic(), self.context.emit
        if now - self._shown_table >= _SHOW_TABLE:
            self._shown_table = now
            (outer, inner), (outer_rate, inner_rate) = self.status.angles, self.status.rates
            if np.isfinite(self.status.angles).all():
                emit(TableMoved(float(outer), float(inner), float(outer_rate), float(inner_rate), self.status.moving))
            joints, joint_rates = self.status.joints, self.status.joint_rates
            if joints is not None and joint_rates is not None:
                emit(JointsMoved(tuple(joints.tolist()), tuple(joint_rates.tolist()), self.status.moving))
            if self._traced:
                times, outputs = zip(*self._traced, strict=True)
                emit(Trace(times, tuple(chain.from_iterable(outputs))))
                self._traced.clear()
        if now - self._shown_progress >= _SHOW_PROGRESS and self.acquisition.recent is not None:
            self._shown_progress = now
            self._on_show()


def _late(seconds: float) -> DeviceFaultError:
    return DeviceFaultError("stream.late", seconds=seconds)
