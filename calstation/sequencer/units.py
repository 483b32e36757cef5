"""The units of a run: data of each, and how a failed unit leaves without stopping the others."""

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
from calstation.sequencer.acquisition import Acquisition, Flow, Stamps
from calstation.sequencer.context import Ended, RunContext, Slot
from calstation.sequencer.control import Interruption, State
from calstation.sequencer.events import Event, Fault, Message, Trace
from calstation.sequencer.guard import reason_of

_Result = TypeVar("_Result")

#: Station time without a sample after which the unit counts as silent, s.
NO_DATA = 1.0

#: Maximum number of ticks kept for a trace; if the listener is too slow, only the latest are shown.
_MAX_TRACED = 400


class Unit:
    """A unit in a run, with its samples.

    If `patient` is set, bytes outside frames are treated as silence; otherwise they are an immediate fault. If
    `unproved` is set, the unit's registers are written but not verified.
    """

    def __init__(self, context: RunContext, slot: Slot, stamps: Stamps) -> None:
        self._context = context
        self.slot = slot
        self.acquisition = Acquisition(
            slot.imu,
            slot.unit,
            context.clock,
            stamps,
            slot.take,
            latency=context.task.latency,
            after=slot.after,
            gimbal=context.task.gimbal,
        )
        self.flow = Flow()
        self.patient = False
        self.solutions: list[Solution] = list(slot.solved)
        self.judgement: Judgement | None = None  #: None until it is judged.
        self.unproved = False
        #: Current or last job of its solver in another thread.
        self.job: Future[Any] | None = None
        self._traced: deque[tuple[float, tuple[float, ...]]] = deque(maxlen=_MAX_TRACED)

    def emit(self, event: Event) -> None:
        """Emit an event that concerns this unit."""
        self._context.emit(replace(event, slot=self.slot.name) if self.slot.name else event)

    def ended(self, state: State, error: CalstationError | None) -> Ended:
        """Return how the run ended for this unit."""
        return Ended(state, tuple(self.solutions), error, self.judgement)

    def drain(self) -> None:
        """Drain the samples received so far. Raises DeviceFaultError, or ConfigurationError of the log."""
        try:
            self.flow = self.acquisition.drain()
        except NoFramesError:
            if not self.patient:
                raise
            self.flow = Flow()
        newest, recent = self.acquisition.newest, self.acquisition.recent
        if self.flow.count and newest is not None and recent is not None and np.isfinite(recent[0]).all():
            self._traced.append((newest, recent[0]))

    def service(self) -> None:
        """Service the log. Raises ConfigurationError if it cannot be written."""
        error = self._context.log_errors.pop(self.slot.name, None)
        if error is not None:
            raise error
        if self.slot.journal is not None:
            self.slot.journal.service()

    def trace(self) -> None:
        """Emit the output of the ticks since the last trace."""
        if self._traced:
            times, outputs = zip(*self._traced, strict=True)
            self.emit(Trace(times, tuple(value for output in outputs for value in output)))
            self._traced.clear()

    @property
    def silent(self) -> bool:
        """Whether no sample has arrived for more than `NO_DATA` s."""
        return self._context.clock.now() - self.acquisition.last_arrival > NO_DATA

    @property
    def spoilt(self) -> str:
        """Reason why the samples of the last drain are unusable, a term of the family ``reason``; "" if usable."""
        if self.silent:
            return "no_data"
        if self.flow.missing:
            return "gap"
        if self.flow.invalid:
            return "invalid"
        return "saturated" if self.flow.saturated else ""


class StepInvalid(Interruption):
    """Samples of the step are lost or unusable; it must be repeated.

    `reasons` contains the units concerned, each with a term of the family ``reason``.
    """

    def __init__(self, reasons: Mapping[Unit, str]) -> None:
        super().__init__(reasons)
        self.reasons = reasons


class Units:
    """The units that are still in the run, in the order of their slots.

    An error that occurs while a unit is being served is attributed to that unit: it leaves the run, and the others
    continue. The error ends the run if no other unit is left, or if it is an error of the table.
    """

    def __init__(self, context: RunContext) -> None:
        self._context = context
        steps = [slot.after.step + 1 for slot in context.slots if slot.after is not None]
        self.stamps = Stamps(max(steps, default=0))
        self._active = [Unit(context, slot, self.stamps) for slot in context.slots]
        self._served: Unit | None = None
        self._table_errors: list[CalstationError] = []
        # Units are solved, and the results of leaving units are written, in threads in parallel with the control loop,
        # which feeds the table's watchdog.
        self._solver, self._leaving = ThreadPoolExecutor(1, "solver"), ThreadPoolExecutor(1, "leaving")
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
        """The first unit, which is the only one on a manual rig, on a gimbal and in a register operation."""
        return self._active[0]

    def of(self, units: Iterable[Unit]) -> list[Unit]:
        """Return the given units that are still in the run."""
        return [unit for unit in units if unit in self._active]

    def each(self, work: Callable[[Unit], object], units: Iterable[Unit] | None = None) -> None:
        """Call `work` for every unit, or for some units; those that fail leave. Raises the error of the last one."""
        for unit in self if units is None else tuple(units):
            if unit in self._active:
                with self.serving(unit):
                    work(unit)

    @contextmanager
    def serving(self, unit: Unit) -> Iterator[None]:
        """Make a unit leave if an error occurs while the context is open. Raises the error of the last unit."""
        if self._served is unit:
            yield
            return
        before, self._served = self._served, unit
        try:
            yield
        except CalstationError as error:
            if error in self._table_errors:
                raise
            self._served = before
            self.leave(unit, error)
        finally:
            self._served = before

    @contextmanager
    def jobs(self, work: Callable[[Unit], _Result]) -> Iterator[Mapping[Unit, Future[_Result]]]:
        """Run `work` for every unit in another thread; leaving the context cancels jobs that have not started."""
        jobs = {unit: self._solver.submit(work, unit) for unit in self}
        for unit, job in jobs.items():
            unit.job = job
        try:
            yield jobs
        finally:
            for job in jobs.values():
                job.cancel()

    @contextmanager
    def of_table(self) -> Iterator[None]:
        """Attribute an error while the context is open to the table, regardless of the unit being served."""
        try:
            yield
        except CalstationError as error:
            self._table_errors.append(error)
            raise

    def leave(self, unit: Unit, error: CalstationError) -> None:
        """Remove a unit that has an error. Raises `error` if no other unit is left, or while the unit is served.

        If the unit has already left, nothing happens.
        """
        if unit not in self._active:
            return
        if len(self._active) == 1 or self._served is unit:
            raise error
        if unit.unproved:
            unit.emit(Message("transfer_unproved"))
        unit.emit(Message("unit_left", {"serial": unit.slot.unit.serial, "reason": reason_of(error)}))
        unit.emit(Fault.of(error))
        self.remove(unit, State.FAULT, error)

    def remove(self, unit: Unit, state: State, error: CalstationError | None = None) -> None:
        """Remove a unit from the run and write its result."""
        self._active.remove(unit)
        self._context.left.add(unit.slot.name)
        evaluation, ended = unit.slot.evaluation, unit.ended(state, error)

        def end() -> None:
            if unit.job is not None and not unit.job.cancel():
                wait([unit.job])  # the solver must not change what is being written
            if evaluation is not None:
                evaluation.ended(ended)

        self._ends.append(self._leaving.submit(end))

    def wait_for_results(self) -> None:
        """Wait until the results of all units that have left are written."""
        self._solver.shutdown(wait=False)
        self._leaving.shutdown()

    def close(self, state: State, error: CalstationError | None) -> None:
        """Write the results of all remaining units at the end of the run in `state`. Raises like `Evaluation.ended`."""
        with ExitStack() as ends:  # calls all of them, in reverse order, even if one raises
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
