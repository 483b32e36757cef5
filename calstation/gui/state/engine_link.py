"""Polls the engine process from a timer and emits its events as Qt signals."""

from PySide6.QtCore import QObject, QTimer, Signal

from calstation.config import RegisterOperation, RunRequest
from calstation.runs import Engine
from calstation.sequencer import Command


class EngineLink(QObject):
    """Starts runs and register operations and emits their events.

    `event(object)` : an event from the engine; if the engine process dies, a `Fault`. `running_changed(bool)` : the
    engine process has started or ended. `request` describes the last run or register operation. `operation` is the
    last register operation, or None after a run.
    """

    event = Signal(object)  # type: ignore[assignment] # hides QObject.event, which is not used
    running_changed = Signal(bool)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._engine: Engine | None = None
        self.request: RunRequest | None = None
        self.operation: RegisterOperation | None = None
        self._timer = QTimer(self, interval=30)
        self._timer.timeout.connect(self._poll)

    @property
    def running(self) -> bool:
        """Whether the engine process is alive."""
        return self._engine is not None

    def start(self, order: RunRequest | RegisterOperation) -> None:
        """Start a run or a register operation; only one can be in progress."""
        if self._engine is not None:
            raise RuntimeError("a run is in progress")
        self.operation = order if isinstance(order, RegisterOperation) else None
        self.request = order if isinstance(order, RunRequest) else order.request
        self._engine = Engine.start(order)
        self.running_changed.emit(True)
        self._timer.start()

    def send(self, command: Command) -> None:
        """Send a command to the engine, if it is running."""
        if self._engine is not None:
            self._engine.send(command)

    def hang_up(self) -> None:
        """Disconnect; a run in progress stops safely, and an engine that does not respond is killed."""
        if self._engine is not None:
            self._engine.stop_listening()
            self._end()

    def close(self) -> None:
        """Disconnect and wait for the safe stop and the result of the run."""
        engine = self._engine
        if engine is not None:
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
