"""Execution of the steps of a plan by the table or, with guidance, by the operator of a manual rig.

Each step is repeated from its start after a pause or lost samples.
"""

import logging
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TypeAlias, TypeVar

import numpy as np

from calstation.errors import DeviceFaultError
from calstation.estimation.common import SampleBlock
from calstation.estimation.positions import Guidance, PositionGuide
from calstation.physics import Dwell, GimbalTurn, GimbalZero, ManualMove, Move, Ramp, Soak, move_time
from calstation.sequencer.control import PauseRequested, State
from calstation.sequencer.control_loop import ControlLoop
from calstation.sequencer.events import Message, PositionGuided, StepStarted
from calstation.sequencer.gimbal import GimbalLoop
from calstation.sequencer.guard import check_motion, check_move
from calstation.sequencer.soaking import SoakLoop
from calstation.sequencer.unit_stream import UnitStream
from calstation.sequencer.units import StepInvalid, Unit

_Result = TypeVar("_Result")

#: Largest distance from its target at which a settled joint has arrived, rad.
ARRIVAL_TOLERANCE = np.deg2rad(0.5)

#: Number of repetitions of a step due to invalid samples after which a unit is considered faulty.
MAX_REPETITIONS = 3

#: Duration of the rest before a repeated move, in which the solvers determine the attitude and the angles again, s.
_REST_BEFORE_REPEAT = 5.0

_RETURN_RATE, _RETURN_ACCELERATION = np.deg2rad(10.0), np.deg2rad(10.0)

#: Minimum host time between two events that only refresh a display, s.
_DISPLAY_INTERVAL = 0.2

logger = logging.getLogger(__name__)

DrivenStep: TypeAlias = Move | Dwell | ManualMove | GimbalZero | GimbalTurn | Soak | Ramp


class OperatorGuide:
    """Guides the operator through the positions of each stage; an interrupted position is requested again.

    Invalid samples and samples around a gap are not part of a rest. `requested` contains the rail angles of the
    last completed position, rad.
    """

    def __init__(self, control_loop: ControlLoop) -> None:
        self._control_loop = control_loop
        self._context = control_loop.context
        self._last_shown = ("", 0, -1e9)
        self.requested = (0.0, 0.0)
        self._blocks: list[SampleBlock] = []
        self.begin()

    def begin(self) -> None:
        """Begin a stage, in which no position is completed yet."""
        self._guide = PositionGuide(self._context.slot.unit.model, 0.0)

    @property
    def done(self) -> bool:
        """Whether the operator has ended the stage and the completed positions are sufficient."""
        return self._context.control.ending_stage and self._guide.now.suffices

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Collect all samples for the guidance while the context is open, even during a pause."""
        with self._control_loop.units.first.acquisition.tap() as self._blocks:
            yield
        self._blocks = []

    def follow(self, step: ManualMove) -> None:
        """Wait, within `listening`, until the position of the step is completed or the operator ends the stage."""
        guide = self._guide
        guide.set_required_rest(step.rest)
        while len(guide.now.positions) < step.index and not self.done:
            self._show(step, guide.now)
            self._control_loop.tick()
            for block in self._blocks:
                guide.feed(block)
            self._blocks.clear()
        self._show(step, guide.now)
        if len(guide.now.positions) >= step.index:
            self.requested = (step.outer, step.inner)

    def _show(self, step: ManualMove, now: Guidance) -> None:
        """Emit changes immediately, and other updates a few times per second."""
        state, index, shown_at = self._last_shown
        moment = time.monotonic()
        if (state, index) == (now.state, step.index) and moment - shown_at < _DISPLAY_INTERVAL:
            return
        self._last_shown = (now.state, step.index, moment)
        self._context.emit(
            PositionGuided(
                self._control_loop.tags.stage,
                step.index,
                step.count,
                now.state,
                now.rest,
                now.required,
                step.outer,
                step.inner,
                *self.requested,
                tuple(float(v) for v in now.up),
                tuple(float(v) for v in now.positions.ravel()),
                now.suffices,
            )
        )


def manual_move_label(step: ManualMove) -> tuple[str | float, ...]:
    """Return the label of a manual move: requested angles, degrees, rest, s, index, and number of positions."""
    outer, inner = (float(np.rad2deg(angle)) for angle in (step.outer, step.inner))
    return ("carry", outer, inner, step.rest, float(step.index), float(step.count))


class StepRunner:
    """Executes the steps on the table or gimbal, or guides the operator of a manual rig.

    The step number is incremented by every move and every repetition. Samples between the interruption of a step and
    its repetition are tagged as invalid.
    """

    def __init__(
        self,
        control_loop: ControlLoop,
        streams: Mapping[Unit, UnitStream],
        gimbal: GimbalLoop,
        on_state: Callable[[State], None],
    ) -> None:
        self.control_loop = control_loop
        self.streams = streams
        self.units = control_loop.units
        self.tags = control_loop.tags
        self.guiding = OperatorGuide(control_loop)
        self.gimbal = gimbal
        self.soaking = SoakLoop(control_loop)
        self._context = control_loop.context
        self._limits = self._context.task.geometry.limits
        self._on_state = on_state
        #: Commanded joint angles at which the table has arrived, rad; None if unknown.
        self.target: tuple[float, float] | None = None
        self._last_move: tuple[tuple[float, float], Move] | None = None

    def run(self, step: DrivenStep) -> None:
        """Execute a step to its end, and repeat it if it is interrupted.

        A dwell is repeated together with the move before it, because every turn must end in a rest. Raises
        DeviceFaultError, also after too many repetitions, ConfigurationError if a move is outside the limits, or
        StopRequested.
        """
        if isinstance(step, ManualMove):
            with self.guiding.listening():
                self._run(step)
        else:
            self._run(step)

    def _run(self, step: DrivenStep) -> None:
        start = self.target or self.position()
        moves = isinstance(step, Move)
        parts: list[DrivenStep] = [step]
        repetition = parts
        if isinstance(step, Dwell) and self._last_move is not None:
            start, move = self._last_move
            moves, repetition = True, [move, step]
        repeats: Counter[Unit] = Counter()
        while True:
            try:
                self.control_loop.pausable = self.control_loop.watchful = True
                for part in parts:
                    self._execute(part)
                if isinstance(step, Move):
                    self._last_move = (start, step)
                return
            except PauseRequested:
                self._pause()
            except StepInvalid as invalid:
                for unit, reason in invalid.reasons.items():
                    repeats[unit] += 1
                    if repeats[unit] > MAX_REPETITIONS:
                        self.units.leave(unit, DeviceFaultError(f"stream.repeated_{reason}"))
                        continue
                    logger.warning("step %d repeated: %s %s", self.tags.step, unit.slot.unit.serial, reason)
                    unit.emit(Message("step_repeated", {"reason": reason, "attempt": repeats[unit]}))
                self._come_to_rest()
            finally:
                self.control_loop.pausable = self.control_loop.watchful = False
            self._recover(start, moves)
            parts = [Dwell(_REST_BEFORE_REPEAT), *repetition] if moves else repetition

    def pausable(self, work: Callable[[], _Result]) -> _Result:
        """Perform `work` outside a stage, again from its beginning after every pause, and return its result."""
        while True:
            self.control_loop.pausable = True
            try:
                return work()
            except PauseRequested:
                self._pause()
            finally:
                self.control_loop.pausable = False
            self._recover(self.position(), moves=False)

    def begin_stage(self) -> None:
        """Begin a stage, after which the moves of the previous stage are no longer repeated."""
        self._last_move = None
        self.guiding.begin()
        self.gimbal.begin()

    def drive(self, move: Move) -> None:
        """Move both joints and wait until they have arrived and settled.

        Raises DeviceFaultError, also if this takes too long, ConfigurationError if the move is outside the limits, or
        the interruptions of `ControlLoop.update`.
        """
        check_move(self.control_loop.status, self._limits, move)
        start = self.position()
        self.tags.step += 1
        self.target = None
        self._emit_step("move", move.label)
        self._context.table.move(move.outer, move.inner, move.rate, move.acceleration)
        self.control_loop.wait(
            lambda: self.arrived((move.outer, move.inner)),
            1.5 * move_time(start, move) + 15.0,
            lambda: self._arrival_error((move.outer, move.inner)),
        )
        self.target = (move.outer, move.inner)

    def arrived(self, target: tuple[float, float]) -> bool:
        """Return whether the table is at rest and settled at `target` (rad)."""
        status = self.control_loop.status
        return status.settled and not status.moving and self._distance(target) < ARRIVAL_TOLERANCE

    def _distance(self, target: tuple[float, float]) -> float:
        """Return the larger distance of the two joints from `target`, rad."""
        return float(max(abs(a - b) for a, b in zip(self.control_loop.status.angles, target, strict=True)))

    def _arrival_error(self, target: tuple[float, float]) -> DeviceFaultError:
        status, distance = self.control_loop.status, self._distance(target)
        target_deg = {"outer_deg": float(np.rad2deg(target[0])), "inner_deg": float(np.rad2deg(target[1]))}
        if distance < ARRIVAL_TOLERANCE:
            return DeviceFaultError("motion.not_settled", **target_deg)
        if status.settled and not status.moving:
            return DeviceFaultError("motion.off_target", away_deg=float(np.rad2deg(distance)), **target_deg)
        return DeviceFaultError("motion.not_reached", **target_deg)

    def position(self) -> tuple[float, float]:
        """Return the joint angles at the latest poll, rad."""
        outer, inner = self.control_loop.status.angles
        return float(outer), float(inner)

    def _execute(self, step: DrivenStep) -> None:
        if isinstance(step, Move):
            self.drive(step)
        elif isinstance(step, Dwell):
            self._emit_step("dwell")
            self.control_loop.rest(step.duration)
        elif isinstance(step, GimbalZero):
            self.gimbal.zero(step)
        elif isinstance(step, GimbalTurn):
            self.gimbal.turn(step)
        elif isinstance(step, Soak):
            self.soaking.soak(step)
        elif isinstance(step, Ramp):
            self.soaking.ramp(step)
        else:
            self.tags.step += 1
            self._emit_step("carry", manual_move_label(step))
            self.guiding.follow(step)

    def _pause(self) -> None:
        """Stop the table and wait until the operator resumes the run."""
        self._on_state(State.PAUSING)
        self._come_to_rest()
        self._on_state(State.PAUSED)
        while self._context.control.pausing:
            self.control_loop.tick()
        self._on_state(State.RUNNING)

    def _come_to_rest(self) -> None:
        self.tags.valid = False
        self.control_loop.pausable = self.control_loop.watchful = False
        self._context.table.stop()
        self.control_loop.tick()
        self.control_loop.wait(
            lambda: not self.control_loop.status.moving, 30.0, DeviceFaultError("motion.not_stopped")
        )

    def _recover(self, start: tuple[float, float], moves: bool) -> None:
        """Return to the start of a step that moves the table, restore all streams, and increment the step number."""
        if moves and not self.arrived(start):
            check_motion(self.control_loop.status)
            speeds = self._limits.limited(_RETURN_RATE, _RETURN_ACCELERATION)
            outer, inner = (float(v) for v in np.clip(start, self._limits.low, self._limits.high))
            self.drive(Move(outer, inner, *speeds, ("return",)))
        self.units.each(lambda unit: self.streams[unit].restore())
        self.tags.step += 1
        self.tags.valid = True

    def _emit_step(self, kind: str, label: tuple[str | float, ...] = ()) -> None:
        self._context.emit(StepStarted(self.tags.stage, self.tags.step, kind, label))
