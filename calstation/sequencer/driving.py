"""Prepares and moves units and captures their output; every exit path leaves the table at rest with its axes off."""

import logging
import threading
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np

from calstation.errors import CalstationError, DeviceFaultError
from calstation.physics import Move
from calstation.sequencer.capture import Restarted, carried_data, verification_data
from calstation.sequencer.context import Output, RunContext
from calstation.sequencer.control import State, StopReason, StopRequested, transition
from calstation.sequencer.control_loop import ControlLoop
from calstation.sequencer.events import Fault, Message, StateChanged
from calstation.sequencer.gimbal import GimbalLoop
from calstation.sequencer.guard import check_limits, check_travel, reason_of, safe_stop
from calstation.sequencer.preflight import Preflight
from calstation.sequencer.steps import StepRunner
from calstation.sequencer.unit_stream import UnitStream
from calstation.sequencer.units import Unit, Units
from calstation.sequencer.verification_path import VerificationData, VerificationPath, verification_path

#: Fraction of the gyro range used by the verification turns.
_RANGE_FRACTION = 0.5

#: Settling time after a move that may be too short to be seen by a poll, s.
_SETTLED = 1.0

#: Maximum number of captures in which a unit may restart before it is at fault; each starts from the beginning.
_MAX_CAPTURES = 3

#: Host time between polls while another thread works, s.
POLL = 0.05

logger = logging.getLogger(__name__)


class Driving:
    """Operates the table and the units of a run. Nothing moves outside `run` or before `begin` and `preflight`.

    `begin` creates `control_loop` and `runner`.
    """

    control_loop: ControlLoop
    runner: StepRunner

    def __init__(self, context: RunContext, on_show: Callable[[], None] = lambda: None) -> None:
        self.state = State.IDLE
        self._context = context
        self._on_show = on_show
        self._path: VerificationPath | None = None
        self._references: Mapping[Unit, VerificationData] = {}
        self._abandoned = threading.Event()
        self._begun = False
        self.units = Units(context)
        self.stamps = self.units.stamps

    def run(self, work: Callable[[], State]) -> CalstationError | None:
        """Run `work` and change to the state it returns. Every exit path leaves the table at rest with its axes off.

        Errors of devices, configuration and input end in the fault state and are returned; any other exception (a
        programming error) also stops the table and is raised.
        """
        control = self._context.control
        try:
            try:
                with control.ticking():
                    end = work()
            except StopRequested:
                self.go(State.STOPPING)
                if control.stop_reason not in (None, StopReason.OPERATOR):
                    self._context.emit(Message("stopped_because", {"reason": str(control.stop_reason)}))
                self._stop_safely()
                end = State.STOPPED
            self.go(end)
            return None
        except CalstationError as error:
            logger.error("fault %s: %s", error.code, error)
            self._stop_safely()
            self.go(State.FAULT)
            self._context.emit(Fault.of(error))
            return error
        except BaseException:
            self._stop_safely()
            raise

    def go(self, state: State) -> None:
        """Change the state of the run."""
        previous, state = self.state, transition(self.state, state)
        logger.info("state %s -> %s", previous, state)
        self._context.emit(StateChanged(state, previous))
        self.state = state  # not earlier: a fault of the log must be possible from the previous state

    def begin(self) -> None:
        """Poll the table for the first time; nothing moves. Raises DeviceFaultError if it does not respond."""
        self.control_loop = ControlLoop(self._context, self.units, self._on_show)
        self._streams = {
            unit: UnitStream(self.control_loop, unit, self.run_in_background, self._check_abandoned)
            for unit in self.units
        }
        gimbal = GimbalLoop(self.control_loop, self.run_in_background)
        self.runner = StepRunner(self.control_loop, self._streams, gimbal, self.go)
        self._begun = True

    def preflight(self) -> None:
        """Run all preflight checks, switch the axes on and move home. Raises DeviceFaultError or ConfigurationError."""
        Preflight(self.runner).run()
        # From here on, the stream of a unit that restarts is requested again.
        for unit in self.units:
            unit.patient = True

    def check_turns(self) -> None:
        """Check the verification path against the limits. Raises ConfigurationError."""
        if self._context.task.gimbal:  # a gimbal's turns are checked before each of them
            return
        limits = self.control_loop.status.limits
        for leg in self._verification_path(self.units, compared=False).legs:
            check_limits(self._context.task.geometry.limits, leg.move)
            check_travel(limits, leg.move)

    def reference(self, units: Iterable[Unit], verified: Collection[Unit]) -> None:
        """Capture the current output of some units as the reference for `verification_data`; only on a table.

        Half turns are enough in both captures if all units that will be `verified` are compared with the reference.
        Raises DeviceFaultError, ConfigurationError, StopRequested.
        """
        task = self._context.task
        compared = [unit for unit in units if unit.slot.unit.corrected is not Output.NEVER]
        if task.by_hand or task.gimbal or not compared:
            return
        self._path = self._verification_path(verified, compared=set(verified) <= set(compared))
        with self.stamps.unlogged_samples():
            self.units.each(lambda unit: self._streams[unit].restore(), compared)
            self._references = self._capture(compared, "stream.restarts_before_write", is_reference=True)

    def verification_data(self, units: Iterable[Unit], *, restarted: bool = True) -> dict[Unit, VerificationData]:
        """Capture unlogged output of some units at rest and in turns, and restore the raw stream.

        Units that leave the run during the capture have no data. Raises DeviceFaultError, ConfigurationError,
        StopRequested.
        """
        task, units = self._context.task, tuple(units)
        gimbal = task.gimbal  # a gimbal applies the registers itself
        asked = {unit for unit in units if unit.slot.unit.corrected is Output.ASKED and not gimbal}

        def stream(unit: Unit) -> None:
            if restarted or unit in asked:
                self._streams[unit].start(corrected=unit in asked)
            else:
                self._streams[unit].restore()

        if restarted:
            self.stamps.unlogged = True  # the counters have restarted: log nothing until the run ends
        with self.stamps.unlogged_samples():
            self.units.each(stream, units)
            if task.by_hand:
                data = {self.units.first: carried_data(self.runner)}
            elif gimbal:
                drifts = self.runner.gimbal.verification_turns()
                data = {self.units.first: VerificationData((), 0.0, drifts=drifts)}
            else:
                data = self._capture(units, "stream.restarts_after_write", is_reference=False)
            self.units.each(lambda unit: self._streams[unit].start(corrected=False), filter(asked.__contains__, units))
        # The next capture starts from the table's current position.
        references, self._references, self._path = self._references, {}, None
        return {
            unit: replace(
                data[unit],
                corrected=gimbal or unit.slot.unit.corrected is not Output.NEVER,
                reference=references.get(unit),
            )
            for unit in self.units.of(data)
        }

    def _verification_path(self, units: Iterable[Unit], *, compared: bool) -> VerificationPath:
        """Return the path of a capture from the load position, where the table must end in any case."""
        task, limits = self._context.task, self.control_loop.status.limits
        fastest = _RANGE_FRACTION * min(map(_gyro_range, units))
        return verification_path(task.load_angle, task.geometry, limits, fastest, compared=compared)

    def _capture(self, units: Iterable[Unit], code: str, *, is_reference: bool) -> dict[Unit, VerificationData]:
        """Capture the output of some units; if one restarts during the capture, start over.

        `code` is the error code for a unit that restarts during every attempt. The path is the path of the reference,
        or a new one.
        """
        restarts: Counter[Unit] = Counter()
        known = self.runner.target is not None
        while units := self.units.of(units):
            self._path = path = self._path or self._verification_path(units, compared=False)
            if not (known and self.runner.arrived(path.start)):
                first = path.legs[0].move
                self.runner.drive(replace(first, outer=path.start[0], inner=path.start[1]))
            if not known:
                # The polled angle differs from the commanded one; such a short move may end before the next poll.
                self.control_loop.rested(_SETTLED)
                self.units.each(lambda unit: self._streams[unit].broken and self._streams[unit].restore(), units)
            try:
                return verification_data(self.runner, path, units, is_reference=is_reference)
            except Restarted as restarted:
                restarted.unit.emit(Message("look_repeated"))
                restarts[restarted.unit] += 1
                known = False
                if restarts[restarted.unit] == _MAX_CAPTURES:
                    self.units.leave(restarted.unit, DeviceFaultError(code))
        return {}

    def run_in_background(self, work: Callable[[], Any]) -> Any:
        """Run uninterruptible `work` in a thread while feeding the table's watchdog; return its result.

        The watchdog is fed until the work is done, even after an error, which is raised at the end.
        """
        errors: list[CalstationError] = []
        self._abandoned.clear()
        with ThreadPoolExecutor(1, "background") as worker:
            job = worker.submit(work)
            try:
                while not job.done():
                    self._context.clock.idle(POLL)
                    try:
                        self.control_loop.feed_table()
                        self.units.each(Unit.service)
                    except CalstationError as error:
                        errors.append(error)
                        self._abandoned.set()
                    self._context.control.take()
            except BaseException:
                self._abandoned.set()
                raise
        if errors:
            raise errors[0]
        return job.result()

    def _check_abandoned(self) -> None:
        """Raise StopRequested in the background thread if its result is no longer wanted."""
        if self._context.control.stopping or self._abandoned.is_set():
            raise StopRequested

    def finish(self) -> None:
        """Move to the load position and switch the axes off."""
        self._context.emit(Message("finishing"))
        task = self._context.task
        if task.gimbal:
            self.runner.gimbal.home()
        elif not self.runner.arrived(task.load_angle):
            speeds = task.geometry.limits.limited(task.travel_rate, task.travel_acceleration)
            self.runner.drive(Move(*task.load_angle, *speeds, ("load",)))
        self.control_loop.powered = False
        self._context.table.disable()

    def _stop_safely(self) -> None:
        self.stamps.stage, self.stamps.valid = "", False
        failures = safe_stop(self._context.table, self._context.clock)
        if self._begun:
            try:
                self.runner.gimbal.restore()
            except CalstationError as error:  # the former values return when the unit restarts
                failures.append(reason_of(error))
        for unit in self.units:
            try:
                unit.acquisition.drain()
            except CalstationError as error:  # error of the unit, or of the log, which this call flushes
                failures.append(reason_of(error))
        for failure in failures:
            self._context.emit(Message("safe_stop_incomplete", {"text": failure}))


def _gyro_range(unit: Unit) -> float:
    """Return the smallest rate at which a gyro of the unit saturates, rad/s."""
    span = unit.slot.unit.span
    return float(np.concatenate([span.high[:3], -span.low[:3]]).min()) * float(unit.acquisition.scale[0])
