"""The units of a run; a unit that fails leaves the run without stopping the other units."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from calstation.devices import NoFramesError
from calstation.errors import CalstationError
from calstation.estimation import Solution
from calstation.estimation.common import SampleBlock
from calstation.judgement import Judgement
from calstation.sequencer.acquisition import Acquisition, DrainResult, SampleTags
from calstation.sequencer.context import RunContext, RunEnd, Slot
from calstation.sequencer.control import Interruption, State
from calstation.sequencer.events import Event, Fault, Message, Trace
from calstation.sequencer.guard import reason_of

_Result = TypeVar("_Result")

#: Station time without a sample after which a unit is considered silent, s.
NO_DATA = 1.0

#: Prefix of the names of the solver threads; at the end of a run, their results are no longer needed.
SOLVER_THREADS = "solver"

#: Maximum number of ticks in a trace; if the listener is too slow, earlier ticks are omitted.
_MAX_TRACED = 400


class Unit:
    """A unit in a run and its samples.

    If `tolerates_noise` is set, bytes outside frames are treated as silence; otherwise they are a fault. `unverified`
    is True if registers of the unit have been written but not verified.
    """

    def __init__(self, context: RunContext, slot: Slot, tags: SampleTags) -> None:
        self._context = context
        self.slot = slot
        self.acquisition = Acquisition(
            slot.imu,
            slot.unit,
            context.clock,
            tags,
            slot.add_samples,
            latency=context.task.latency,
            after=slot.after,
            gimbal=context.task.gimbal,
        )
        self.flow = DrainResult()
        self.tolerates_noise = False
        self.solutions: list[Solution] = list(slot.solved)
        self.judgement: Judgement | None = None  #: None until the unit is judged.
        self.unverified = False
        self.points = 0  #: Number of temperatures completed in the current stage.
        #: Current or last job of the unit's solver in another thread.
        self.job: Future[Any] | None = None
        self._traced: deque[tuple[float, tuple[float, ...]]] = deque(maxlen=_MAX_TRACED)

    def emit(self, event: Event) -> None:
        """Emit an event that concerns this unit."""
        self._context.emit(replace(event, slot=self.slot.name) if self.slot.name else event)

    def ended(self, state: State, error: CalstationError | None) -> RunEnd:
        """Return the end of the run for this unit."""
        return RunEnd(state, tuple(self.solutions), error, self.judgement, self.points)

    def drain(self) -> None:
        """Read the samples received so far.

        Raises DeviceFaultError, or ConfigurationError if the log cannot be written.
        """
        try:
            self.flow = self.acquisition.drain()
        except NoFramesError:
            if not self.tolerates_noise:
                raise
            self.flow = DrainResult()
        newest_time, recent = self.acquisition.newest_time, self.acquisition.recent
        if self.flow.count and newest_time is not None and recent is not None and np.isfinite(recent[0]).all():
            self._traced.append((newest_time, recent[0]))

    def service(self) -> None:
        """Write the log to disk if necessary. Raises ConfigurationError if it cannot be written."""
        error = self._context.log_errors.pop(self.slot.name, None)
        if error is not None:
            raise error
        if self.slot.log is not None:
            self.slot.log.service()

    def trace(self) -> None:
        """Emit the output at the ticks since the last trace."""
        if self._traced:
            times, outputs = zip(*self._traced, strict=True)
            self.emit(Trace(times, tuple(value for output in outputs for value in output)))
            self._traced.clear()

    @property
    def silent(self) -> bool:
        """Whether no sample has arrived for more than `NO_DATA` s."""
        return self._context.clock.now() - self.acquisition.last_arrival > NO_DATA

    @property
    def temperature(self) -> float | None:
        """Latest temperature measured by the unit, °C; None if it is unknown."""
        recent = self.acquisition.recent
        return None if recent is None or self.silent else recent[1]

    @property
    def invalid_reason(self) -> str:
        """Why the last samples are unusable, as a term of the family ``reason``; "" if they are usable."""
        if self.silent:
            return "no_data"
        if self.flow.missing:
            return "gap"
        if self.flow.invalid:
            return "invalid"
        return "saturated" if self.flow.saturated else ""


class StepInvalid(Interruption):
    """Raised if samples of a step are lost or unusable, so that the step must be repeated.

    `reasons` contains a term of the family ``reason`` for each unit concerned.
    """

    def __init__(self, reasons: Mapping[Unit, str]) -> None:
        super().__init__(reasons)
        self.reasons = reasons


class Units:
    """The units that are still in the run, in the order of their slots.

    An error is attributed to the unit that is being processed; this unit leaves the run, and the others continue. An
    error ends the run if no other unit remains, or if it is an error of the table.
    """

    def __init__(self, context: RunContext) -> None:
        self._context = context
        steps = [slot.after.step + 1 for slot in context.slots if slot.after is not None]
        self.tags = SampleTags(max(steps, default=0))
        self._active = [Unit(context, slot, self.tags) for slot in context.slots]
        #: All units on the table, also those that have left the run.
        self.loaded = tuple(self._active)
        self._current: Unit | None = None
        self._table_errors: list[CalstationError] = []
        # Solving, and writing the results of units that leave, happen in threads, because the control loop must feed
        # the watchdog of the table in the meantime.
        self._solver, self._result_writer = ThreadPoolExecutor(1, SOLVER_THREADS), ThreadPoolExecutor(1, "leaving")
        self._ends: list[Future[None]] = []

    def __iter__(self) -> Iterator[Unit]:
        return iter(tuple(self._active))

    def __len__(self) -> int:
        return len(self._active)

    def __contains__(self, unit: Unit) -> bool:
        return unit in self._active

    @property
    def in_batch(self) -> bool:
        """Whether the run began with several units."""
        return len(self._context.slots) > 1

    @property
    def first(self) -> Unit:
        """The first unit, which is the only unit on a manual rig, on a gimbal and in a register operation."""
        return self._active[0]

    def temperatures(self, *, loaded: bool = False) -> dict[str, float]:
        """Return the known temperatures of the units, or of all `loaded` units, by slot, °C."""
        units = self.loaded if loaded else self
        return {unit.slot.name: value for unit in units if (value := unit.temperature) is not None}

    def of(self, units: Iterable[Unit]) -> list[Unit]:
        """Return the given units that are still in the run."""
        return [unit for unit in units if unit in self._active]

    def each(self, work: Callable[[Unit], object], units: Iterable[Unit] | None = None) -> None:
        """Call `work` for all or the given units; a unit that fails leaves. Raises the error of the last unit."""
        for unit in self if units is None else tuple(units):
            if unit in self._active:
                with self.attributing_errors_to(unit):
                    work(unit)

    @contextmanager
    def attributing_errors_to(self, unit: Unit) -> Iterator[None]:
        """Attribute errors in the context to a unit, which then leaves. Raises the error of the last unit."""
        if self._current is unit:
            yield
            return
        before, self._current = self._current, unit
        try:
            yield
        except CalstationError as error:
            if error in self._table_errors:
                raise
            self._current = before
            self.leave(unit, error)
        finally:
            self._current = before

    @contextmanager
    def jobs(self, work: Callable[[Unit], _Result]) -> Iterator[Mapping[Unit, Future[_Result]]]:
        """Run `work` for every unit in another thread; at the end of the context, jobs that wait are cancelled."""
        jobs = {unit: self._solver.submit(work, unit) for unit in self}
        for unit, job in jobs.items():
            unit.job = job
        try:
            yield jobs
        finally:
            for job in jobs.values():
                job.cancel()

    @contextmanager
    def attributing_errors_to_table(self) -> Iterator[None]:
        """Attribute errors in the context to the table, even while a unit is being processed."""
        try:
            yield
        except CalstationError as error:
            self._table_errors.append(error)
            raise

    def leave(self, unit: Unit, error: CalstationError) -> None:
        """Remove a unit with an error, unless it has already left.

        Raises `error` instead if no other unit remains, or while the unit is being processed.
        """
        if unit not in self._active:
            return
        if len(self._active) == 1 or self._current is unit:
            raise error
        if unit.unverified:
            unit.emit(Message("transfer_unproved"))
        unit.emit(Message("unit_left", {"serial": unit.slot.unit.serial, "reason": reason_of(error)}))
        unit.emit(Fault.of(error))
        self.remove(unit, State.FAULT, error)

    def remove(self, unit: Unit, state: State, error: CalstationError | None = None) -> None:
        """Remove a unit from the run and write its result."""
        self._active.remove(unit)
        self._context.inactive.add(unit.slot.name)
        evaluation, ended = unit.slot.evaluation, unit.ended(state, error)

        def end() -> None:
            if unit.job is not None and not unit.job.cancel():
                wait([unit.job])  # the solver must not change data that are being written
            if evaluation is not None:
                evaluation.ended(ended)

        self._ends.append(self._result_writer.submit(end))

    def wait_for_results(self) -> None:
        """Wait until the results of all units that have left have been written."""
        self._solver.shutdown(wait=False)
        self._result_writer.shutdown()

    def close(self, state: State, error: CalstationError | None) -> None:
        """Write the results of all remaining units at the end of the run. Raises the errors of `Evaluation.ended`."""
        with ExitStack() as ends:  # the stack calls all of them, even if one raises
            for unit in reversed(self._active):
                failure = error or self._context.log_errors.get(unit.slot.name)
                ended = unit.ended(state if failure is None else State.FAULT, failure)
                if unit.slot.evaluation is not None:
                    ends.callback(unit.slot.evaluation.ended, ended)
            for end in self._ends:
                ends.callback(end.result)

    @contextmanager
    def taps(self) -> Iterator[Mapping[Unit, list[SampleBlock]]]:
        """Collect the blocks of every unit drained while the context is open."""
        with ExitStack() as stack:
            yield {unit: stack.enter_context(unit.acquisition.tap()) for unit in self}
