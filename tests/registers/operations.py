"""Execution of register operations in tests, which records their events."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from calstation import errors
from calstation.config import RegisterOperation, RunRequest
from calstation.registers import run_operation
from calstation.sequencer import Control, Event, Fault, Message, Settled, StepStarted


@dataclass
class RegisterOperations:
    """Executes register operations at one site; `events` and `control` belong to the last operation.

    on_event : called with every event
    """

    request: RunRequest
    on_event: Callable[["RegisterOperations", Event], None] = lambda operations, event: None
    events: list[Event] = field(default_factory=list)
    control: Control = field(default_factory=Control)

    def do(self, what: Any, values: Mapping[str, float] | None = None, **more: Any) -> Settled:
        """Run one operation and return its result; raise its fault."""
        self.events, self.control = [], Control()

        def emit(event: Event) -> None:
            self.events.append(event)
            self.on_event(self, event)

        run_operation(RegisterOperation(self.request, what, values or {}, **more), emit, self.control)
        last = self.events[-1]
        if isinstance(last, Settled):
            return last
        (fault,) = [event for event in self.events if isinstance(event, Fault)]
        raise getattr(errors, fault.kind)(fault.code or fault.text, **fault.values)

    def write(self, values: Mapping[str, float], *, at_rest: bool = False) -> Settled:
        """Write values manually."""
        return self.do("write", values, source="x.h5", at_rest=at_rest)

    def message_ids(self) -> list[str]:
        """Return the ids of the messages."""
        return [event.id for event in self.events if isinstance(event, Message)]

    def moves(self) -> list[str]:
        """Return the purposes of the moves."""
        return [str(event.label[0]) for event in self.events if isinstance(event, StepStarted)]
