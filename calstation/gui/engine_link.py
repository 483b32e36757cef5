"""The window's ear at the engine: polls it from a timer and tells every event as a Qt signal."""

from PySide6.QtCore import QObject, QTimer, Signal

from calstation.errors import CalstationError
from calstation.sequencer.control import Command
from calstation.sequencer.events import Event, Fault
from calstation.station.engine import Engine
from calstation.station.request import RunRequest

_EVERY = 30
"""Between two looks at the engine, ms."""


class EngineLink(QObject):
    """Starts runs and re-emits what they tell.

    `event(object)` carries every event; an engine that dies is told as a `Fault`. `running_changed(bool)` says when
    a run's process begins and has ended.
    """

    event = Signal(object)  # type: ignore[assignment] # QObject.event is of no use to a listener
    running_changed = Signal(bool)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._engine: Engine | None = None
        self.request: RunRequest | None = None
        self._timer = QTimer(self)
        self._timer.setInterval(_EVERY)
        self._timer.timeout.connect(self._poll)

    @property
    def running(self) -> bool:
        """Whether a run's process lives."""
        return self._engine is not None

    def start(self, request: RunRequest) -> None:
        """Start a run; only one at a time."""
        assert self._engine is None, "a run is going on"
        self.request = request
        self._engine = Engine.start(request)
        self.running_changed.emit(True)
        self._timer.start()

    def send(self, command: Command) -> None:
        """Ask the run for something; nothing where none is going on."""
        if self._engine is not None:
            self._engine.send(command)

    def close(self) -> None:
        """Hang up: a run that is still going stops safely."""
        if self._engine is not None:
            engine, self._engine = self._engine, None
            self._timer.stop()
            engine.close()

    def _poll(self) -> None:
        engine = self._engine
        if engine is None:
            return
        try:
            events: list[Event] = list(engine.poll())
        except CalstationError as error:
            self.event.emit(Fault(type(error).__name__, str(error), error.exit_code))
            self._ended()
            return
        for event in events:
            self.event.emit(event)
        if not engine.process.is_alive() and not events:
            self._ended()

    def _ended(self) -> None:
        self._timer.stop()
        self._engine = None
        self.running_changed.emit(False)
