"""The control loop, which polls the table, reads samples, feeds the watchdog and processes commands."""

import logging
import time
from collections.abc import Callable

import numpy as np

from calstation.devices import LOCAL_CONTROL, TableStatus, latched_fault_error
from calstation.errors import CalstationError, DeviceFaultError
from calstation.sequencer.chamber import ChamberControl
from calstation.sequencer.context import RunContext
from calstation.sequencer.control import PauseRequested
from calstation.sequencer.events import JointsMoved, TableMoved
from calstation.sequencer.guard import check_joints
from calstation.sequencer.units import StepInvalid, Unit, Units

#: Minimum host time between two events that only refresh a display, s.
_TABLE_INTERVAL, _PROGRESS_INTERVAL = 0.1, 0.5

#: Host time of a tick above which a warning is logged, s.
_SLOW_TICK = 1.0

logger = logging.getLogger(__name__)


class ControlLoop:
    """The control loop in the engine's thread, which can interrupt the current step.

    While `powered` is set, disabled axes are a fault. While `pausable` is set, a pause interrupts the step; otherwise
    it is deferred. While `watchful` is set, lost or saturated samples of any unit invalidate the step.
    """

    def __init__(self, context: RunContext, units: Units, on_progress: Callable[[], None]) -> None:
        self.context = context
        self.units = units
        self.tags = units.tags
        self._on_show = on_progress
        self._fed_at = self._table_shown_at = self._progress_shown_at = -1e9
        self.status: TableStatus = context.table.status()
        self.powered = False
        self.pausable = False
        self.watchful = False
        #: Control of the chamber, which is polled from `begin_chamber` on; None without a chamber.
        self.chamber: ChamberControl | None = None
        if context.chamber is not None and context.task.chamber is not None:
            self.chamber = ChamberControl(context.chamber, context.task.chamber, context.clock, context.emit)
        self._controls_chamber = False

    def begin_chamber(self) -> None:
        """Start the chamber at its present temperature. Raises DeviceFaultError."""
        if self.chamber is not None:
            with self.units.attributing_errors_to_table():
                self.chamber.begin()
            self.tags.chamber = self.chamber.status.air_c
            self._controls_chamber = True

    def tick(self) -> None:
        """Let one tick of station time pass, then call `update`."""
        begin = time.monotonic()
        with self.units.attributing_errors_to_table():
            self.context.clock.sleep(self.context.clock.tick)
        self.update()
        seconds = time.monotonic() - begin
        if seconds > _SLOW_TICK:
            logger.warning("a tick of the control loop took %.1f s", seconds)

    def update(self) -> None:
        """Poll the table once, read the samples of all units, feed the watchdog and process commands.

        Raises DeviceFaultError if the table or the chamber has a fault or a channel of the last unit is stuck,
        StopRequested, PauseRequested or StepInvalid.
        """
        clock = self.context.clock
        with self.units.attributing_errors_to_table():
            requested = clock.now()
            self.status = self.context.table.status()
            replied = clock.now()
        for unit in self.units:
            unit.acquisition.poll(self.status, requested, replied)
        self.units.each(Unit.drain)
        self.feed_watchdog()
        self._show()
        with self.units.attributing_errors_to_table():
            self._check_table()
        self.units.each(_check_channels)
        self.check_cancelled()
        if self.watchful and (reasons := {unit: unit.invalid_reason for unit in self.units if unit.invalid_reason}):
            raise StepInvalid(reasons)

    def check_table(self) -> None:
        """Poll the table without reading samples. Raises DeviceFaultError if the table has a fault."""
        with self.units.attributing_errors_to_table():
            self.status = self.context.table.status()
            self._check_table()

    def check_cancelled(self) -> None:
        """Process the operator's commands. Raises StopRequested or PauseRequested."""
        self.context.control.check_cancelled()
        if self.context.control.pausing and self.pausable:
            raise PauseRequested

    def feed_watchdog(self) -> None:
        """Feed the watchdog of the table, write the logs to disk if necessary, and control and poll the chamber.

        The watchdog is fed if a quarter of its timeout has passed (host time); the chamber is polled when due.
        """
        now = time.monotonic()
        if self.status.watchdog > 0.0 and now - self._fed_at > 0.25 * self.status.watchdog:
            with self.units.attributing_errors_to_table():
                self.context.table.heartbeat()
            self._fed_at = now
        self.units.each(Unit.service)
        if self.chamber is not None and self._controls_chamber:
            with self.units.attributing_errors_to_table():
                self.chamber.update(self.units.temperatures())
            self.tags.chamber = self.chamber.status.air_c

    def wait(
        self, condition: Callable[[], bool], timeout: float, failure: CalstationError | Callable[[], CalstationError]
    ) -> None:
        """Tick until `condition` is true or the timeout has expired.

        Parameters
        ----------
        condition : evaluated after every tick
        timeout : station time, s
        failure : error to raise after the timeout, or a function that returns it
        """
        clock = self.context.clock
        deadline = clock.now() + timeout
        while not condition():
            if clock.now() > deadline:
                raise failure if isinstance(failure, CalstationError) else failure()
            self.tick()

    def wait_for_units(self, condition: Callable[[Unit], bool], timeout: float, failure: CalstationError) -> None:
        """Tick until `condition` is true for every unit; after `timeout` s of station time, the other units leave.

        Raises `failure` for the last unit.
        """
        clock = self.context.clock
        deadline = clock.now() + timeout
        while pending := [unit for unit in self.units if not condition(unit)]:
            if clock.now() > deadline:
                for unit in pending:
                    self.units.leave(unit, failure)
                return
            self.tick()

    def wait_for_samples(self, seconds: float) -> None:
        """Tick until `seconds` of IMU time have been received from every unit that is not silent."""
        is_done = self._has_received(seconds)
        self.wait_for_units(
            lambda unit: is_done(unit) or unit.silent, 1.5 * seconds + 10.0, _late_samples_error(seconds)
        )

    def rest(self, seconds: float) -> None:
        """Tick until `seconds` of IMU time have been received from every unit.

        A unit leaves the run after 5 s without a sample, or after 1.5·`seconds` + 10 s of station time. Raises
        DeviceFaultError for the last unit; see also `update`.
        """
        self.wait_for_units(
            lambda unit: unit.acquisition.newest_time is not None, 5.0, DeviceFaultError("stream.no_data")
        )
        self.wait_for_units(self._has_received(seconds), 1.5 * seconds + 10.0, _late_samples_error(seconds))

    def _has_received(self, seconds: float) -> Callable[[Unit], bool]:
        begin = {unit: unit.acquisition.newest_time or 0.0 for unit in self.units}
        return lambda unit: (unit.acquisition.newest_time or 0.0) - begin[unit] >= seconds - 1e-9

    def _check_table(self) -> None:
        if self.status.fault == LOCAL_CONTROL:
            raise DeviceFaultError("motion.switched_to_local")
        if self.status.fault is not None:
            raise latched_fault_error(self.status.fault)
        gimbal, joints = self.context.task.geometry.gimbal, self.status.joints
        if self.powered and self.status.homed and gimbal is not None and joints is not None:
            check_joints(gimbal, joints)
        if self.powered and not self.status.interlock_closed:
            raise DeviceFaultError("motion.interlock_opened")
        if self.powered and not self.status.enabled:
            raise DeviceFaultError("motion.switched_off")

    def _show(self) -> None:
        now = time.monotonic()
        if now - self._table_shown_at >= _TABLE_INTERVAL:
            self._table_shown_at = now
            self._show_table()
            for unit in self.units:
                unit.trace()
        started = any(unit.acquisition.newest_time is not None for unit in self.units)
        if now - self._progress_shown_at >= _PROGRESS_INTERVAL and started:
            self._progress_shown_at = now
            self._on_show()

    def show_stopped(self) -> None:
        """Emit the state of the stopped table, which may have been moving at the last poll. Raises DeviceFaultError."""
        self.status = self.context.table.status()
        self._show_table()

    def _show_table(self) -> None:
        emit, (outer, inner), (outer_rate, inner_rate) = self.context.emit, self.status.angles, self.status.rates
        if np.isfinite(self.status.angles).all():
            emit(TableMoved(float(outer), float(inner), float(outer_rate), float(inner_rate), self.status.moving))
        joints, joint_rates = self.status.joints, self.status.joint_rates
        if joints is not None and joint_rates is not None:
            emit(JointsMoved(tuple(joints.tolist()), tuple(joint_rates.tolist()), self.status.moving))


def _check_channels(unit: Unit) -> None:
    if unit.flow.stuck:
        raise DeviceFaultError("stream.stuck", channel=unit.flow.stuck)


def _late_samples_error(seconds: float) -> DeviceFaultError:
    return DeviceFaultError("stream.late", seconds=seconds)
