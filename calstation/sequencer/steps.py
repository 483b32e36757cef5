"""Executes a plan's steps: each is a checkpoint, repeated from its start after a pause or lost samples."""

from collections.abc import Callable

import numpy as np

from calstation.devices.interfaces import Table
from calstation.errors import DeviceFaultError
from calstation.physics.motion import Carry, Dwell, Move
from calstation.physics.table import JointLimits
from calstation.sequencer.acquisition import Acquisition
from calstation.sequencer.control import Control, PauseRequested, SpoiltStep
from calstation.sequencer.control_loop import ControlLoop
from calstation.sequencer.events import Message, StepStarted
from calstation.sequencer.guard import check_motion, check_move
from calstation.sequencer.guiding import Guiding, carry_label
from calstation.sequencer.ports import Emit
from calstation.sequencer.preview import move_time
from calstation.sequencer.states import State
from calstation.sequencer.unit_stream import UnitStream

#: A joint this close to its target, at rest and settled, has arrived, rad.
ARRIVED = np.deg2rad(0.5)

#: How often a step with spoilt samples is repeated before the run is a fault.
REPEATS = 3

#: Rest before a move is repeated, s: what solvers need to find attitude and angle again.
_REST_BEFORE_REPEAT = 5.0

_RETURN_RATE, _RETURN_ACCELERATION = np.deg2rad(10.0), np.deg2rad(10.0)


class StepRunner:
    """Drives the table through moves and dwells, and guides who carries the unit where nothing drives it.

    Every move and every repetition raises the step number by one. From the moment a step is
    interrupted until it is repeated, samples are stamped not valid.
    """

    def __init__(
        self,
        table: Table,
        control_loop: ControlLoop,
        acquisition: Acquisition,
        control: Control,
        emit: Emit,
        limits: JointLimits,
        on_state: Callable[[State], None],
        guiding: Guiding,
        stream: UnitStream,
    ) -> None:
        self._table = table
        self._control_loop = control_loop
        self._acquisition = acquisition
        self._control = control
        self._emit = emit
        self._limits = limits
        self._on_state = on_state
        self._guiding = guiding
        self._stream = stream
        self._target: tuple[float, float] | None = None
        self._last_move: tuple[tuple[float, float], Move] | None = None

    def run(self, step: Move | Dwell | Carry) -> None:
        """Execute a step to its end, repeating it where it was interrupted.

        A rest is repeated together with the move before it: a turn is worth nothing without the rest that ends it.
        Raises DeviceFaultError after too many repetitions, StopRequested on the operator's word.
        """
        if isinstance(step, Carry):
            with self._guiding.listening():
                self._run(step)
        else:
            self._run(step)

    def _run(self, step: Move | Dwell | Carry) -> None:
        start = self._target or self.position()
        moved = isinstance(step, Move)
        todo: list[Move | Dwell | Carry] = [step]
        again = todo
        if isinstance(step, Dwell) and self._last_move is not None:
            start, move = self._last_move
            moved, again = True, [move, step]
        repeats = 0
        while True:
            try:
                self._control_loop.pausable = self._control_loop.watchful = True
                for part in todo:
                    self._execute(part)
                if isinstance(step, Move):
                    self._last_move = (start, step)
                return
            except PauseRequested:
                self._hold()
            except SpoiltStep as spoilt:
                repeats += 1
                if repeats > REPEATS:
                    raise DeviceFaultError(_explain(spoilt.reason)) from None
                self._emit(Message("step_repeated", {"reason": spoilt.reason, "attempt": repeats}))
                self._come_to_rest()
            finally:
                self._control_loop.pausable = self._control_loop.watchful = False
            self._recover(start, moved)
            todo = [Dwell(_REST_BEFORE_REPEAT), *again] if moved else again

    @property
    def asked(self) -> tuple[float, float]:
        """Where rails that are carried by hand were asked to be brought last, rad."""
        return self._guiding.asked

    def begin_stage(self) -> None:
        """What was moved before belongs to another stage and is not repeated in this one."""
        self._last_move = None
        self._guiding.begin()

    def drive(self, move: Move) -> None:
        """Move both joints and wait until they have arrived and settled."""
        check_move(self._control_loop.status, self._limits, move)
        start = self.position()
        self._acquisition.step += 1
        self._target = None
        self._started("move", move.label)
        self._table.move(move.outer, move.inner, move.rate, move.acceleration)
        self._control_loop.wait(
            lambda: self.arrived((move.outer, move.inner)),
            1.5 * move_time(start, move) + 15.0,
            lambda: self._why_not((move.outer, move.inner)),
        )
        self._target = (move.outer, move.inner)

    def arrived(self, target: tuple[float, float]) -> bool:
        """Whether the table rests, settled, at `target` (rad)."""
        status = self._control_loop.status
        away = max(abs(a - b) for a, b in zip(status.angles, target, strict=True))
        return status.settled and not status.moving and away < ARRIVED

    def _why_not(self, target: tuple[float, float]) -> str:
        """What is to be said of a table that has not arrived in time."""
        status = self._control_loop.status
        wanted = f"outer {np.rad2deg(target[0]):.1f}°, inner {np.rad2deg(target[1]):.1f}°"
        away = max(abs(a - b) for a, b in zip(status.angles, target, strict=True))
        if away < ARRIVED:
            return f"table: does not settle at {wanted}; look at the drive's tuning and for what shakes the table"
        if status.settled and not status.moving:
            away_deg = np.rad2deg(away)
            return (
                f"table: stands {away_deg:.1f}° away from {wanted}; look for an obstacle, at encoder and drive, then"
                " home the table"
            )
        return f"table: did not reach {wanted} in time; look for an obstacle or a stalled drive"

    def position(self) -> tuple[float, float]:
        """Joint angles as last polled, rad."""
        outer, inner = self._control_loop.status.angles
        return float(outer), float(inner)

    def _execute(self, step: Move | Dwell | Carry) -> None:
        if isinstance(step, Move):
            self.drive(step)
        elif isinstance(step, Dwell):
            self._started("dwell")
            self._control_loop.rest(step.duration)
        else:
            self._acquisition.step += 1
            self._started("carry", carry_label(step))
            self._guiding.follow(step)

    def _hold(self) -> None:
        """Decelerate, wait for the operator's resume."""
        self._on_state(State.PAUSING)
        self._come_to_rest()
        self._on_state(State.PAUSED)
        while self._control.pausing:
            self._control_loop.tick()
        self._on_state(State.RUNNING)

    def _come_to_rest(self) -> None:
        self._acquisition.valid = False
        self._control_loop.pausable = self._control_loop.watchful = False
        self._table.stop()
        self._control_loop.tick()
        self._control_loop.wait(
            lambda: not self._control_loop.status.moving,
            30.0,
            "table: does not come to rest after a stop command",
        )

    def _recover(self, start: tuple[float, float], moved: bool) -> None:
        """Back to the start of the step, with data of a unit that is ready, so that it can be repeated as its own."""
        if moved and not self.arrived(start):
            check_motion(self._control_loop.status)
            rate = min(_RETURN_RATE, *self._limits.rate)
            acceleration = min(_RETURN_ACCELERATION, *self._limits.acceleration)
            outer, inner = (float(v) for v in np.clip(start, self._limits.low, self._limits.high))
            self.drive(Move(outer, inner, rate, acceleration, ("return",)))
        self._stream.mend()
        self._acquisition.step += 1
        self._acquisition.valid = True

    def _started(self, kind: str, label: tuple[str | float, ...] = ()) -> None:
        self._emit(StepStarted(self._acquisition.stage, self._acquisition.step, kind, label))


def _explain(reason: str) -> str:
    return {
        "no_data": "IMU: no data any more; check cable, power and port",
        "gap": "IMU: samples are lost again and again; check cable, baud and the load of this computer",
        "invalid": "IMU: the output is no number again and again; switch the unit off and on, check the IMU profile",
        "saturated": "IMU: the output saturates in this step; lower the rate in the product's schedule",
    }[reason]
