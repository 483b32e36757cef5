"""Guides who carries the unit by hand: follows the stream until it has rested long enough at the next position."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from calstation.estimation.common.context import ImuModel
from calstation.estimation.common.samples import SampleBlock
from calstation.estimation.positions.guidance import Guidance, PositionGuide
from calstation.physics.motion import Carry
from calstation.sequencer.acquisition import Acquisition
from calstation.sequencer.control import Control
from calstation.sequencer.control_loop import ControlLoop
from calstation.sequencer.events import PositionGuided
from calstation.sequencer.ports import Emit

#: Host time between two events that only refresh the picture, s.
_SHOW = 0.2


class Guiding:
    """Carries of one stage after another. Nothing is driven, so an interruption asks for the same position again.

    What is stamped not valid, or lies around missing samples, is no rest: the guide sees that in the samples.

    Attributes
    ----------
    asked : rail angles asked for last, rad
    """

    def __init__(
        self,
        model: ImuModel,
        control_loop: ControlLoop,
        acquisition: Acquisition,
        control: Control,
        emit: Emit,
    ) -> None:
        self._model = model
        self._control_loop = control_loop
        self._acquisition = acquisition
        self._control = control
        self._emit = emit
        self._shown = ("", 0, -1e9)
        self.asked = (0.0, 0.0)
        self._blocks: list[SampleBlock] = []
        self.begin()

    def begin(self) -> None:
        """No position is done yet."""
        self._guide = PositionGuide(self._model, 0.0)

    @property
    def done(self) -> bool:
        """Whether the operator has said that it is enough, and it is."""
        return self._control.enough and self._guide.now.suffices

    @contextmanager
    def listening(self) -> Iterator[None]:
        """While this is open no sample escapes the guide, also while the run pauses."""
        with self._acquisition.tap() as self._blocks:
            yield
        self._blocks = []

    def follow(self, step: Carry) -> None:
        """Return when as many positions are done as the step's index, or when it is enough; within `listening`."""
        guide = self._guide
        guide.ask(step.rest)
        while len(guide.now.positions) < step.index and not self.done:
            self._show(step, guide.now)
            self._control_loop.tick()
            for block in self._blocks:
                guide.feed(block)
            self._blocks.clear()
        self._show(step, guide.now)
        self.asked = (step.outer, step.inner)

    def _show(self, step: Carry, now: Guidance) -> None:
        """Tell every change at once, and the rest a few times a second."""
        state, index, shown = self._shown
        moment = time.monotonic()
        if (state, index) == (now.state, step.index) and moment - shown < _SHOW:
            return
        self._shown = (now.state, step.index, moment)
        self._emit(
            PositionGuided(
                self._acquisition.stage,
                step.index,
                step.count,
                now.state,
                now.rest,
                now.wanted,
                step.outer,
                step.inner,
                *self.asked,
                tuple(float(v) for v in now.up),
                tuple(float(v) for v in now.positions.ravel()),
                now.suffices,
            )
        )


def carry_label(step: Carry) -> tuple[str | float, ...]:
    """What a carry is called: the angles asked for, degrees, its rest, s, its place and how many there are."""
    outer, inner = (float(np.rad2deg(angle)) for angle in (step.outer, step.inner))
    return ("carry", outer, inner, step.rest, float(step.index), float(step.count))
