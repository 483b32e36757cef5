"""Guidance of the operator at a manual rig, until the unit has rested long enough at each position."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from calstation.estimation.common import SampleBlock
from calstation.estimation.positions import Guidance, PositionGuide
from calstation.physics import ManualMove
from calstation.sequencer.control_loop import ControlLoop
from calstation.sequencer.events import PositionGuided

#: Minimum host time between two events that only refresh a display, s.
_SHOW = 0.2


class Guiding:
    """Guides the operator through the positions of each stage; an interrupted position is requested again.

    Invalid samples and samples around a gap are not part of a rest. `requested` contains the rail angles requested
    last, rad.
    """

    def __init__(self, control_loop: ControlLoop) -> None:
        self._control_loop = control_loop
        self._context = control_loop.context
        self._shown = ("", 0, -1e9)
        self.requested = (0.0, 0.0)
        self._blocks: list[SampleBlock] = []
        self.begin()

    def begin(self) -> None:
        """Begin a stage, without completed positions."""
        self._guide = PositionGuide(self._context.slot.unit.model, 0.0)

    @property
    def done(self) -> bool:
        """Whether the operator has ended the stage and the completed positions suffice."""
        return self._context.control.ending_stage and self._guide.now.suffices

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Collect all samples for the guide while the context is open, even while the run is paused."""
        with self._control_loop.units.first.acquisition.tap() as self._blocks:
            yield
        self._blocks = []

    def follow(self, step: ManualMove) -> None:
        """Wait until the step's position is completed or the operator ends the stage; call it within `listening`."""
        guide = self._guide
        guide.ask(step.rest)
        while len(guide.now.positions) < step.index and not self.done:
            self._show(step, guide.now)
            self._control_loop.tick()
            for block in self._blocks:
                guide.feed(block)
            self._blocks.clear()
        self._show(step, guide.now)
        self.requested = (step.outer, step.inner)

    def _show(self, step: ManualMove, now: Guidance) -> None:
        """Emit changes immediately, and other updates a few times per second."""
        state, index, shown = self._shown
        moment = time.monotonic()
        if (state, index) == (now.state, step.index) and moment - shown < _SHOW:
            return
        self._shown = (now.state, step.index, moment)
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
    """Return the label of a manual move: requested angles, degrees, rest, s, index and number of positions."""
    outer, inner = (float(np.rad2deg(angle)) for angle in (step.outer, step.inner))
    return ("carry", outer, inner, step.rest, float(step.index), float(step.count))
