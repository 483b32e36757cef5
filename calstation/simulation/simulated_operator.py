"""Who stands at the virtual bench's rig: hears what the operator is asked for, and has the bench's hands do it."""

from collections.abc import Callable
from math import radians

from calstation.sequencer.events import Event, StepStarted
from calstation.sequencer.ports import Emit

#: Asks for rail angles outer and inner, rad, and a rest there, s.
Carry = Callable[[float, float, float], None]


class SimulatedOperator:
    """Listens to a run's events.

    Attributes
    ----------
    carry : the bench's hands, None until it lives and where the rig is a real one
    """

    def __init__(self) -> None:
        self.carry: Carry | None = None

    def listening(self, emit: Emit) -> Emit:
        """An `emit` that lets the hands hear first."""

        def check_cancelled(event: Event) -> None:
            if self.carry is not None and isinstance(event, StepStarted) and event.kind == "carry":
                outer, inner, rest = (float(value) for value in event.label[1:4])
                self.carry(radians(outer), radians(inner), rest)
            emit(event)

        return check_cancelled
