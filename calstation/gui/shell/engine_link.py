"""The window's ear at the engine: polls it from a timer and tells every event as a Qt signal."""

from PySide6.QtCore import QObject, QTimer, Signal

from calstation.config.request import RegisterOperation, RunRequest
from calstation.runs.engine import Engine
from calstation.sequencer.control import Command
from calstation.simulation.hooks import BenchHooks

#: Between two looks at the engine, ms.
_EVERY = 30


class EngineLink(QObject):
    """Starts runs, and errands at a unit's registers, and re-emits what they tell.

    `event(object)` carries every event; an engine that dies is told as a `Fault`. `running_changed(bool)` says when
    the process of either begins and has ended.

    Attributes
    ----------
    request : of the last run, or the last errand's place and unit
    errand : the last one, None where a run came behind it
    """

    event = Signal(object)  # type: ignore[assignment] # QObject.event is of no use to a listener
    running_changed = Signal(bool)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._engine: Engine | None = None
        self.request: RunRequest | None = None
        self.errand: RegisterOperation | None = None
        self._timer = QTimer(self)
        self._timer.setInterval(_EVERY)
        self._timer.timeout.connect(self._poll)

    @property
    def running(self) -> bool:
        """Whether the process of a run or an errand lives."""
        return self._engine is not None

    def start(self, order: RunRequest | RegisterOperation) -> None:
        """Start a run or an errand; only one at a time."""
        assert self._engine is None, "a run is going on"
        self.errand = order if isinstance(order, RegisterOperation) else None
        self.request = order if isinstance(order, RunRequest) else order.request
        self._engine = Engine.start(order, BenchHooks)
        self.running_changed.emit(True)
        self._timer.start()

    def send(self, command: Command) -> None:
        """Ask the run for something; nothing where none is going on."""
        if self._engine is not None:
            self._engine.send(command)

    def give_up(self) -> None:
        """Listen no longer: a run that is still going stops safely, an engine that hangs is killed."""
        if self._engine is not None:
            self._engine.hang_up()
            self._end()

    def close(self) -> None:
        """The same, and wait for the safe stop and the result."""
        if self._engine is not None:
            engine = self._engine
            self._end()
            engine.close()

    def _poll(self) -> None:
        engine = self._engine
        if engine is None:
            return
        for event in engine.poll():
            self.event.emit(event)
        if engine.ended and engine is self._engine and not engine.alive:
            self._end()

    def _end(self) -> None:
        self._timer.stop()
        self._engine = None
        self.running_changed.emit(False)
