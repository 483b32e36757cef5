"""Preparation, motion and capture in a run, which always ends with the table at rest and its axes off."""

import logging
import threading
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from calstation.errors import CalstationError, DeviceFaultError
from calstation.messages import Text
from calstation.physics import Move
from calstation.sequencer.capture import UnitRestarted, manual_rig_data, verification_data
from calstation.sequencer.context import Output, RunContext
from calstation.sequencer.control import State, StopReason, StopRequested, transition
from calstation.sequencer.control_loop import ControlLoop
from calstation.sequencer.events import Fault, Message, StateChanged
from calstation.sequencer.gimbal import GimbalLoop
from calstation.sequencer.guard import attempt, check_limits, check_travel, reason_of, safe_stop
from calstation.sequencer.preflight import Preflight
from calstation.sequencer.steps import StepRunner
from calstation.sequencer.unit_stream import UnitStream
from calstation.sequencer.units import Unit, Units
from calstation.sequencer.verification_path import VerificationData, VerificationPath, verification_path

#: Fraction of the gyro range used by the verification turns.
_MAX_RANGE_FRACTION = 0.5

#: Settling time after a move so short that it may end before the next poll, s.
_SETTLE_TIME = 1.0

#: Number of captures interrupted by a restart of a unit after which the unit is considered faulty.
_MAX_CAPTURES = 3

#: Host time between polls while another thread works, s.
POLL = 0.05

logger = logging.getLogger(__name__)


class RunDriver:
    """Operates the table and the units of a run.

    The table moves only within `run`, after `begin`, which creates `control_loop` and `runner`, and `preflight`.
    """

    control_loop: ControlLoop
    runner: StepRunner

    def __init__(self, context: RunContext, on_progress: Callable[[], None] = lambda: None) -> None:
        self.state = State.IDLE
        self._context = context
        self._on_show = on_progress
        self._path: VerificationPath | None = None
        self._references: Mapping[Unit, VerificationData] = {}
        self._is_abandoned = threading.Event()
        self._has_begun = False
        self.units = Units(context)
        self.tags = self.units.tags

    def run(self, work: Callable[[], State]) -> CalstationError | None:
        """Run `work`, leave the table at rest with its axes off, and change to the state that `work` returns.

        After a CalstationError, the state is a fault and the error is returned. Any other exception is a programming
        error, which is raised after the table has been stopped. In every case, the chamber first returns to ambient.
        """
        try:
            return self._run(work)
        finally:
            self._return_chamber()

    def _run(self, work: Callable[[], State]) -> CalstationError | None:
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
                self._return_chamber()
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
        self.state = state  # set last, so that an error of the log occurs in the previous state

    def begin(self) -> None:
        """Poll the table for the first time without motion. Raises DeviceFaultError if it does not respond."""
        self.control_loop = ControlLoop(self._context, self.units, self._on_show)
        self._streams = {
            unit: UnitStream(self.control_loop, unit, self.run_in_background, self._check_abandoned)
            for unit in self.units
        }
        gimbal = GimbalLoop(self.control_loop, self.run_in_background)
        self.runner = StepRunner(self.control_loop, self._streams, gimbal, self.go)
        self._has_begun = True
        self.control_loop.begin_chamber()

    def preflight(self) -> None:
        """Perform all preflight checks, in which the axes are switched on and the table moves home.

        Raises DeviceFaultError or ConfigurationError.
        """
        Preflight(self.runner).run()
        for unit in self.units:
            unit.tolerates_noise = True  # the stream of a unit that restarts is requested again

    def check_turns(self) -> None:
        """Check the verification path against the limits. Raises ConfigurationError."""
        if self._context.task.gimbal:  # each turn of a gimbal is checked before it begins
            return
        limits = self.control_loop.status.limits
        for leg in self._verification_path(self.units, compared=False).legs:
            check_limits(self._context.task.geometry.limits, leg.move)
            check_travel(limits, leg.move)

    def reference(self, units: Iterable[Unit], verified: Collection[Unit]) -> None:
        """Capture the current output of units on a table as a reference for `verification_data`.

        Half turns suffice in both captures if all units in `verified` are compared with the reference. Raises
        DeviceFaultError, ConfigurationError or StopRequested.
        """
        task = self._context.task
        compared = [unit for unit in units if unit.slot.unit.corrected is not Output.NEVER]
        if task.by_hand or task.gimbal or not compared:
            return
        self._path = self._verification_path(verified, compared=set(verified) <= set(compared))
        with self.tags.without_logging():
            self.units.each(lambda unit: self._streams[unit].restore(), compared)
            capture = partial(self._capture, compared, "stream.restarts_before_write", is_reference=True)
            self._references = self.runner.pausable(capture)

    def verification_data(self, units: Iterable[Unit], *, restarted: bool = True) -> dict[Unit, VerificationData]:
        """Capture the output of units at rest and in turns without logging it, then restore their raw streams.

        The result has no entry for a unit that leaves the run during the capture. Raises DeviceFaultError,
        ConfigurationError or StopRequested.
        """
        task, units = self._context.task, tuple(units)
        gimbal = task.gimbal  # a gimbal applies the registers itself
        switched = {unit for unit in units if unit.slot.unit.corrected is Output.ON_COMMAND and not gimbal}

        def start_stream(unit: Unit) -> None:
            if restarted or unit in switched:
                self._streams[unit].start(corrected=unit in switched)
            else:
                self._streams[unit].restore()

        if restarted:
            self.tags.unlogged = True  # the counters have restarted: log nothing until the run ends
        with self.tags.without_logging():
            self.units.each(start_stream, units)
            if task.by_hand:
                data = {self.units.first: manual_rig_data(self.runner)}
            elif gimbal:
                first, drifts = self.units.first, self.runner.pausable(self.runner.gimbal.verification_turns)
                data = {first: VerificationData((), 0.0, drifts=drifts, temperature=first.temperature)}
            else:
                capture = partial(self._capture, units, "stream.restarts_after_write", is_reference=False)
                data = self.runner.pausable(capture)
            self.units.each(
                lambda unit: self._streams[unit].start(corrected=False), filter(switched.__contains__, units)
            )
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
        """Return the path of a capture from the load position, where the run ends in any case."""
        task, limits = self._context.task, self.control_loop.status.limits
        max_rate = _MAX_RANGE_FRACTION * min(map(_gyro_range, units))
        return verification_path(task.load_angle, task.geometry, limits, max_rate, compared=compared)

    def _capture(self, units: Iterable[Unit], code: str, *, is_reference: bool) -> dict[Unit, VerificationData]:
        """Capture the output of units along the path of the reference, or along a new path.

        If a unit restarts, the capture is repeated; `code` is the code of the error if a unit restarts too often.
        """
        restarts: Counter[Unit] = Counter()
        has_arrived = self.runner.target is not None
        while units := self.units.of(units):
            self._path = path = self._path or self._verification_path(units, compared=False)
            if not (has_arrived and self.runner.arrived(path.start)):
                first = (path.reference if is_reference else path.legs)[0].move
                self.runner.drive(replace(first, outer=path.start[0], inner=path.start[1]))
            if not has_arrived:
                # The polled angle differs from the commanded angle, and so short a move may end before the next poll.
                self.control_loop.wait_for_samples(_SETTLE_TIME)
                self.units.each(lambda unit: self._streams[unit].broken and self._streams[unit].restore(), units)
            try:
                return verification_data(self.runner, path, units, is_reference=is_reference)
            except UnitRestarted as restarted:
                restarted.unit.emit(Message("look_repeated"))
                restarts[restarted.unit] += 1
                has_arrived = False
                if restarts[restarted.unit] == _MAX_CAPTURES:
                    self.units.leave(restarted.unit, DeviceFaultError(code))
        return {}

    def run_in_background(self, work: Callable[[], Any]) -> Any:
        """Run `work`, which cannot be interrupted, in a thread while feeding the watchdog; return its result.

        An error of the log, the table or the chamber is raised only after the work is done.
        """
        errors: list[CalstationError] = []
        self._is_abandoned.clear()
        with ThreadPoolExecutor(1, "background") as worker:
            job = worker.submit(work)
            try:
                while not job.done():
                    self._context.clock.idle(POLL)
                    try:
                        self.control_loop.feed_watchdog()
                    except CalstationError as error:
                        errors.append(error)
                        self._is_abandoned.set()
                    self._context.control.take()
            except BaseException:
                self._is_abandoned.set()
                raise
        if errors:
            raise errors[0]
        return job.result()

    def _check_abandoned(self) -> None:
        """Raise StopRequested in the background thread if its result is no longer needed."""
        if self._context.control.stopping or self._is_abandoned.is_set():
            raise StopRequested

    def finish(self) -> None:
        """Move to the load position, switch the axes off, and wait until the chamber may be opened."""
        self._context.emit(Message("finishing"))
        task = self._context.task
        if task.gimbal:
            self.runner.pausable(self.runner.gimbal.home)
        elif not self.runner.arrived(task.load_angle):
            speeds = task.geometry.limits.limited(task.travel_rate, task.travel_acceleration)
            self.runner.pausable(lambda: self.runner.drive(Move(*task.load_angle, *speeds, ("load",))))
        self.control_loop.powered = False
        self._context.table.disable()
        if (chamber := self.control_loop.chamber) is not None:
            self._report_failures(chamber.safe())
            self._return_chamber()

    def _stop_safely(self) -> None:
        """Bring the table to rest, switch its axes off, and send the chamber to ambient."""
        self.tags.stage, self.tags.valid = "", False
        unstopped, failures = safe_stop(self._context.table, self._context.clock), list[Text]()
        # first, because the table may still move, and neither a slow chamber nor an error may delay this message
        attempt(lambda: self._report_failures(unstopped, of_table=self._has_begun), failures)
        if self._has_begun and not unstopped:
            with suppress(CalstationError):  # this is only displayed
                self.control_loop.show_stopped()
        if self._has_begun and self.control_loop.chamber is not None:
            failures += self.control_loop.chamber.safe()
        if self._has_begun:
            try:
                self.runner.gimbal.restore()
            except CalstationError as error:  # the unit has its original values again once it restarts
                failures.append(reason_of(error))
        for unit in self.units:
            try:
                unit.acquisition.drain()
            except CalstationError as error:  # an error of the unit or of the log
                failures.append(reason_of(error))
        self._report_failures(failures)

    def _return_chamber(self) -> None:
        """Wait until the chamber is at ambient and may be opened; neither commands nor errors end this wait."""
        chamber = self.control_loop.chamber if self._has_begun else None
        if chamber is None:
            return
        self.tags.unlogged = True

        def tick() -> None:
            self._context.clock.sleep(self._context.clock.tick)
            self._context.control.take()
            for unit in self.units.loaded:  # also units with complete results, which are equally hot or cold
                with suppress(Exception):  # a unit that cannot be read has no temperature
                    unit.drain()

        self._report_failures(chamber.wait_until_safe(lambda: self.units.temperatures(loaded=True), tick))

    def _report_failures(self, failures: Iterable[Text], *, of_table: bool = False) -> None:
        for failure in failures:
            values = {"text": failure} | ({"table": True} if of_table else {})
            self._context.emit(Message("safe_stop_incomplete", values))


def _gyro_range(unit: Unit) -> float:
    """Return the smallest rate at which a gyro of the unit saturates, rad/s."""
    span = unit.slot.unit.span
    return float(np.concatenate([span.high[:3], -span.low[:3]]).min()) * float(unit.acquisition.scale[0])
