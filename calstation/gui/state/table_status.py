"""The state of the table at the end of a run, which is derived from the events of the engine."""

from calstation.sequencer import Event, JointsMoved, StateChanged, TableMoved


class TableStatus:
    """Whether the table is at rest after a safe stop; commands that failed are not considered."""

    def __init__(self) -> None:
        self.stopped = False
        #: Whether the engine has confirmed a stop; after the safe stop, it sends the state of the table once more.
        self._stopping = False
        self._moving = True  #: Whether the table was moving at its last event; True before the first event.

    def handle_event(self, event: Event) -> None:
        """Process an event; the sequencer is ``stopped`` or in ``fault`` only after its safe stop."""
        match event:
            case StateChanged():
                self._stopping = event.state == "stopping"
                self.stopped = event.state in ("stopped", "fault") and not self._moving
            case TableMoved() | JointsMoved():
                self._moving = event.moving
                self.stopped = self._stopping and not self._moving
