"""Table and unit in one hand: prepared, moved and looked at; every way out leaves the table at rest, axes off."""

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from calstation.devices.interfaces import Imu, Table
from calstation.errors import CalstationError, DeviceFaultError
from calstation.estimation.common.samples import SampleBlock
from calstation.physics.arrays import FloatArray
from calstation.physics.motion import Move
from calstation.sequencer import states
from calstation.sequencer.acquisition import Acquisition, LastSample, to_si
from calstation.sequencer.capture import Restarted, VerificationData, verification_data
from calstation.sequencer.carried_data import carried_data
from calstation.sequencer.control import Control, StopRequested
from calstation.sequencer.control_loop import ControlLoop
from calstation.sequencer.events import Fault, Message, StateChanged
from calstation.sequencer.guard import check_limits, check_travel
from calstation.sequencer.guiding import Guiding
from calstation.sequencer.ports import Clock, Emit
from calstation.sequencer.preflight import Preflight, check_unit
from calstation.sequencer.safe_stop import safe_stop
from calstation.sequencer.states import State
from calstation.sequencer.steps import StepRunner
from calstation.sequencer.task import Output, Task
from calstation.sequencer.unit_stream import UnitStream
from calstation.sequencer.verification_moves import VerificationPath, verification_path

#: Of what a gyro can show, the rate of the turns that prove its registers.
_SHARE = 0.5

#: After a move too short to be seen, s.
_SETTLED = 1.0

#: At a unit that restarts meanwhile, each from the beginning.
_LOOKS = 3

#: Host time between looks while something else is done, s.
LOOK = 0.05

#: Does a work in a thread of its own, to its end, and returns what it returns or raises.
RunInBackground = Callable[[Callable[[], Any]], Any]


class Driving:
    """What moves a table does so inside `run`, after `begin` and `preflight`.

    Parameters
    ----------
    control : takes the operator's commands from any thread
    emit : is told everything
    take : is given every sample that is not taken aside
    service : called at every tick; on_show : when a display is due
    after : where a run that is resumed had come to

    Attributes
    ----------
    state : where it stands
    acquisition : of the samples; pulse, stream, runner, guiding : there from `begin` on
    """

    control_loop: ControlLoop
    stream: UnitStream
    runner: StepRunner
    guiding: Guiding

    def __init__(
        self,
        task: Task,
        table: Table,
        imu: Imu,
        clock: Clock,
        control: Control,
        emit: Emit,
        *,
        take: Callable[[SampleBlock], None] = lambda block: None,
        service: Callable[[], None] = lambda: None,
        on_show: Callable[[], None] = lambda: None,
        after: LastSample | None = None,
    ) -> None:
        self.state = State.IDLE
        self._task = task
        self._table = table
        self._imu = imu
        self._clock = clock
        self._control = control
        self._emit = emit
        self._service = service
        self._on_show = on_show
        self._path: VerificationPath | None = None
        self._reference: VerificationData | None = None
        self._left = threading.Event()
        self.acquisition = Acquisition(
            imu,
            task.imu,
            clock,
            take,
            latency=task.latency,
            masks=task.masks,
            span=task.span,
            wrap=task.wrap,
            after=after,
        )

    def run(self, work: Callable[[], State]) -> CalstationError | None:
        """Do a work and go to the state that it ends in. Every way out leaves the table at rest, axes off.

        Errors of devices, configuration and input end in the state fault and are returned; a mistake of
        the program stops the table as well and is raised.
        """
        try:
            with self._control.ticking():
                end = work()
        except StopRequested:
            try:
                self.go(State.STOPPING)
                if self._control.stop_reason != "operator":
                    self._emit(Message("stopped_because", {"reason": self._control.stop_reason}))
            finally:
                self._stop_safely()
            self.go(State.STOPPED)
            return None
        except CalstationError as error:
            self._stop_safely()
            self.go(State.FAULT)
            self._emit(Fault.of(error))
            return error
        except BaseException:
            self._stop_safely()
            raise
        self.go(end)
        return None

    def go(self, state: State) -> None:
        """To another state."""
        previous, self.state = self.state, states.step(self.state, state)
        self._emit(StateChanged(self.state, previous))

    def begin(self) -> None:
        """Look at the table for the first time; nothing moves. Raises DeviceFaultError where it does not answer."""
        task = self._task
        self.control_loop = ControlLoop(
            self._table,
            self._imu,
            self.acquisition,
            self._clock,
            self._control,
            self._emit,
            self._service,
            self._on_show,
        )
        self.guiding = Guiding(task.imu, self.control_loop, self.acquisition, self._control, self._emit)
        self.stream = UnitStream(
            self._imu,
            self.control_loop,
            self.acquisition,
            self._clock,
            self.run_in_background,
            self._hear_aside,
            lambda identity: check_unit(identity, task.preflight.serial),
        )
        self.runner = StepRunner(
            self._table,
            self.control_loop,
            self.acquisition,
            self._control,
            self._emit,
            task.geometry.limits,
            self.go,
            self.guiding,
            self.stream,
        )

    def preflight(self) -> None:
        """Make sure of everything, axes on, at home. Raises DeviceFaultError or ConfigurationError."""
        Preflight(
            self._table,
            self._imu,
            self.control_loop,
            self.acquisition,
            self.runner,
            self._clock,
            self._task.geometry,
            self._scale,
            self._task.preflight,
            self._emit,
        ).run()
        # From here on a unit that restarted by itself, and sends what nobody asked for, is asked again.
        self.control_loop.patient = True

    def check_turns(self) -> None:
        """The way of `fresh_data` from here against the limits. Raises ConfigurationError."""
        geometry, own = self._task.geometry, self.control_loop.status.limits
        for leg in self._path_from_here().legs:
            check_limits(geometry.limits, leg.move)
            check_travel(own, leg.move)

    def reference(self) -> None:
        """Rest and turn the unit as it is now, to compare what `fresh_data` brings with. Rails by hand have none.

        Raises DeviceFaultError, ConfigurationError, StopRequested.
        """
        if self._task.by_hand or self._task.corrected is Output.NEVER:
            return
        self._path = None
        with self._apart():
            self.stream.mend()
            self._reference = self._on_path(
                "IMU: it restarted while its output was looked at; check its supply, plug and cable, then start again"
            )

    def verification_data(self, *, restarted: bool = True) -> VerificationData:
        """The unit's corrected output at rest and in turns, to be judged; in no log. Behind it the raw stream is on.

        Raises DeviceFaultError, ConfigurationError, StopRequested.
        """
        asked = self._task.corrected is Output.ASKED
        if restarted:
            self.acquisition.run_in_background = True  # its counter has begun again, until the end
        with self._apart():
            if restarted or asked:
                self.stream.start(corrected=asked)
            else:
                self.stream.mend()
            if self._task.by_hand:
                data = carried_data(
                    self.control_loop, self.acquisition, self.runner, self._task.geometry, self._scale
                )
            else:
                data = self._on_path(
                    "IMU: it restarted while its new registers were looked at; check its supply, plug and cable, then"
                    " start again and finish or restore them"
                )
            if asked:
                self.stream.start(corrected=False)
        # The next look begins where the table then stands.
        reference, self._reference, self._path = self._reference, None, None
        return replace(data, corrected=self._task.corrected is not Output.NEVER, reference=reference)

    @contextmanager
    def _apart(self) -> Iterator[None]:
        """What comes meanwhile goes to no log."""
        before, self.acquisition.run_in_background = self.acquisition.run_in_background, True
        try:
            yield
        finally:
            self.acquisition.run_in_background = before

    def _path_from_here(self) -> VerificationPath:
        span, scale = self._task.span, self._scale
        ends = np.concatenate([span.high[:3], -span.low[:3]]) * scale[0]
        own = self.control_loop.status.limits
        return verification_path(self.runner.position(), self._task.geometry, own, _SHARE * float(ends.min()))

    def _on_path(self, restless: str) -> VerificationData:
        """Fresh data of one power-on of the unit: one that restarts meanwhile is looked at from the beginning.

        `restless` : told of one that does so again and again.
        """
        there, path = self._path is not None, self._path or self._path_from_here()
        self._path = path
        for _ in range(_LOOKS):
            if not there:
                # An angle that was read is not the one that the table was sent to; so short a move is over before it
                # shows.
                self.runner.drive(path.to_start)
                self.control_loop.rested(_SETTLED)
                if self.stream.broken:
                    self.stream.mend()
            try:
                return verification_data(
                    self.control_loop, self.acquisition, self.runner, self.stream, path, self._scale
                )
            except Restarted:
                self._emit(Message("look_repeated"))
                there = False
        raise DeviceFaultError(restless)

    @property
    def _scale(self) -> FloatArray:
        """From counts to rad/s and m/s², shape (6,)."""
        return to_si(self._task.imu)

    def run_in_background(self, work: Callable[[], Any]) -> Any:
        """Do what must not be interrupted, the table's watchdog fed meanwhile; whatever happens, it is done then."""
        self._left.clear()
        with ThreadPoolExecutor(1, "aside") as worker:
            job = worker.submit(work)
            try:
                while not job.done():
                    self._clock.idle(LOOK)
                    self.control_loop.feed_watchdog()
                    self._control.take()
            except BaseException:
                self._left.set()
                raise
            return job.result()

    def _hear_aside(self) -> None:
        """For a work aside that may be broken off: raises StopRequested where nobody wants its end any more."""
        if self._control.stopping or self._left.is_set():
            raise StopRequested

    def finish(self) -> None:
        """To the load angle, axes off."""
        self._emit(Message("finishing"))
        outer, inner = self._task.load_angle
        limits = self._task.geometry.limits
        rate = min(self._task.travel_rate, *limits.rate)
        acceleration = min(self._task.travel_acceleration, *limits.acceleration)
        if not self.runner.arrived((outer, inner)):
            self.runner.drive(Move(outer, inner, rate, acceleration, ("load",)))
        self.control_loop.powered = False
        self._table.disable()

    def _stop_safely(self) -> None:
        self.acquisition.stage, self.acquisition.valid = "", False
        for failure in safe_stop(self._table, self._clock):
            self._emit(Message("safe_stop_incomplete", {"text": failure}))
        try:
            self.acquisition.drain()
        except DeviceFaultError as error:
            self._emit(Message("safe_stop_incomplete", {"text": str(error)}))
