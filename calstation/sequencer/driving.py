"""Prepares and moves a unit and captures its output; every exit path leaves the table at rest with its axes off."""

import logging
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np

from calstation.errors import CalstationError, DeviceFaultError
from calstation.physics import Move
from calstation.sequencer.acquisition import Acquisition
from calstation.sequencer.capture import (
    Restarted,
    VerificationData,
    VerificationPath,
    carried_data,
    verification_data,
    verification_path,
)
from calstation.sequencer.context import Output, RunContext
from calstation.sequencer.control import State, StopReason, StopRequested, transition
from calstation.sequencer.control_loop import ControlLoop
from calstation.sequencer.events import Fault, Message, StateChanged
from calstation.sequencer.gimbal import GimbalLoop
from calstation.sequencer.guard import check_limits, check_travel, reason_of, safe_stop
from calstation.sequencer.preflight import Preflight
from calstation.sequencer.steps import StepRunner
from calstation.sequencer.unit_stream import UnitStream

#: Fraction of the gyro range used by the verification turns.
_RANGE_FRACTION = 0.5

#: Settling time after a move that may be too short to appear in a poll, s.
_SETTLED = 1.0

#: Maximum number of capture attempts if the unit restarts during a capture; each starts from the beginning.
_MAX_CAPTURES = 3

#: Host time between polls while another thread works, s.
POLL = 0.05

#: Type of a function that runs another one to its end in a separate thread and returns its result or raises its error.
RunInBackground = Callable[[Callable[[], Any]], Any]

logger = logging.getLogger(__name__)


class Driving:
    """Operates the table and the unit of a run. Nothing moves outside `run` or before `begin` and `preflight`.

    `begin` creates `control_loop`, `stream` and `runner`.
    """

    control_loop: ControlLoop
    stream: UnitStream
    runner: StepRunner

    def __init__(self, context: RunContext, on_show: Callable[[], None] = lambda: None) -> None:
        self.state = State.IDLE
        self._context = context
        self._on_show = on_show
        self._path: VerificationPath | None = None
        self._reference: VerificationData | None = None
        self._abandoned = threading.Event()
        self._begun = False
        slot = context.slot
        self.acquisition = Acquisition(
            slot.imu,
            slot.unit,
            context.clock,
            slot.take,
            latency=context.task.latency,
            after=slot.after,
            gimbal=context.task.gimbal,
        )

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
        self.control_loop = ControlLoop(self._context, self.acquisition, self._on_show)
        self.stream = UnitStream(self.control_loop, self.run_in_background, self._check_abandoned)
        gimbal = GimbalLoop(self.control_loop, self.run_in_background)
        self.runner = StepRunner(self.control_loop, self.stream, gimbal, self.go)
        self._begun = True

    def preflight(self) -> None:
        """Run all preflight checks, switch the axes on and move home. Raises DeviceFaultError or ConfigurationError."""
        Preflight(self.runner).run()
        # From here on, a unit that restarts by itself is commanded to stream again.
        self.control_loop.patient = True

    def check_turns(self) -> None:
        """Check the verification path against the limits. Raises ConfigurationError."""
        if self._context.task.gimbal:  # its own turns are checked before each of them
            return
        own = self.control_loop.status.limits
        for leg in self._verification_path(compared=False).legs:
            check_limits(self._context.task.geometry.limits, leg.move)
            check_travel(own, leg.move)

    def reference(self) -> None:
        """Capture the unit's current output as the reference for `verification_data`; only on a table.

        Raises DeviceFaultError, ConfigurationError, StopRequested.
        """
        task = self._context.task
        if task.by_hand or task.gimbal or self._context.slot.unit.corrected is Output.NEVER:
            return
        self._path = None
        with self.acquisition.unlogged_samples():
            self.stream.restore()
            self._reference = self._capture("stream.restarts_before_write", is_reference=True)

    def verification_data(self, *, restarted: bool = True) -> VerificationData:
        """Capture the unit's output at rest and in turns without logging it; the raw stream is on again afterwards.

        Raises DeviceFaultError, ConfigurationError, StopRequested.
        """
        corrected = self._context.slot.unit.corrected
        gimbal = self._context.task.gimbal  # which applies the registers itself
        asked = corrected is Output.ASKED and not gimbal
        if restarted:
            self.acquisition.unlogged = True  # its counter has restarted: log nothing until the run ends
        with self.acquisition.unlogged_samples():
            if restarted or asked:
                self.stream.start(corrected=asked)
            else:
                self.stream.restore()
            if self._context.task.by_hand:
                data = carried_data(self.runner)
            elif gimbal:
                data = VerificationData((), 0.0, drifts=self.runner.gimbal.verification_turns())
            else:
                data = self._capture("stream.restarts_after_write", is_reference=False)
            if asked:
                self.stream.start(corrected=False)
        # The next capture starts from the table's position at that time.
        reference, self._reference, self._path = self._reference, None, None
        return replace(data, corrected=gimbal or corrected is not Output.NEVER, reference=reference)

    def _verification_path(self, *, compared: bool) -> VerificationPath:
        """Return the path of a capture from the load position, where the table must go in the end anyway."""
        task, span = self._context.task, self._context.slot.unit.span
        ends = np.concatenate([span.high[:3], -span.low[:3]]) * self.acquisition.scale[0]
        limits = self.control_loop.status.limits
        fastest = _RANGE_FRACTION * float(ends.min())
        return verification_path(task.load_angle, task.geometry, limits, fastest, compared=compared)

    def _capture(self, code: str, *, is_reference: bool) -> VerificationData:
        """Capture the unit's output; if the unit restarts during the capture, begin again.

        `code` is the code of the error raised if the unit restarts during every attempt. The path is that of the
        reference, or a new one.
        """
        self._path = path = self._path or self._verification_path(compared=is_reference)
        known = self.runner.target is not None
        for _ in range(_MAX_CAPTURES):
            if not (known and self.runner.arrived(path.start)):
                first = path.legs[0].move
                self.runner.drive(replace(first, outer=path.start[0], inner=path.start[1]))
            if not known:
                # The polled angle differs from the commanded one; such a short move may end before the next poll.
                self.control_loop.rested(_SETTLED)
                if self.stream.broken:
                    self.stream.restore()
            try:
                return verification_data(self.runner, path, is_reference=is_reference)
            except Restarted:
                self._context.emit(Message("look_repeated"))
                known = False
        raise DeviceFaultError(code)

    def run_in_background(self, work: Callable[[], Any]) -> Any:
        """Run uninterruptible `work` in a thread while feeding the table's watchdog; return its result."""
        self._abandoned.clear()
        with ThreadPoolExecutor(1, "background") as worker:
            job = worker.submit(work)
            try:
                while not job.done():
                    self._context.clock.idle(POLL)
                    self.control_loop.feed_watchdog()
                    self._context.control.take()
            except BaseException:
                self._abandoned.set()
                raise
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
        self.acquisition.stage, self.acquisition.valid = "", False
        failures = safe_stop(self._context.table, self._context.clock)
        if self._begun:
            try:
                self.runner.gimbal.restore()
            except CalstationError as error:  # the former values return when the unit is restarted
                failures.append(reason_of(error))
        try:
            self.acquisition.drain()
        except CalstationError as error:  # of the unit, or of the log, which this flushes
            failures.append(reason_of(error))
        for failure in failures:
            self._context.emit(Message("safe_stop_incomplete", {"text": failure}))
