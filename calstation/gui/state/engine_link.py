"""The link to the engine process, which a timer polls for events."""

from PySide6.QtCore import QObject, QTimer, Signal

from calstation.config import RegisterOperation, RunRequest
from calstation.runs import Engine
from calstation.sequencer import Command


class EngineLink(QObject):
    """The link that starts runs and register operations, and emits the events of their engine process.

    Signals: `event(event)`, with a `Fault` if the engine process dies; `running_changed(False)` when the process has
    ended, and `running_changed(True)` one turn of the event loop after its start. `request` is the request of the last
    run or register operation, and `operation` is the last register operation, or None after a run.
    """

    event = Signal(object)  # type: ignore[assignment] # replaces QObject.event, which is not used
    running_changed = Signal(bool)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._engine: Engine | None = None
        self.request: RunRequest | None = None
        self.operation: RegisterOperation | None = None
        self._timer = QTimer(self, interval=30)
        self._timer.timeout.connect(self._poll)
        self._started = QTimer(self, singleShot=True, interval=0)
        self._started.timeout.connect(self._announce)

    @property
    def running(self) -> bool:
        """Whether the engine process is alive."""
        return self._engine is not None

    def start(self, work: RunRequest | RegisterOperation) -> None:
        """Start a run or a register operation. Raises RuntimeError if the engine is running."""
        if self._engine is not None:
            raise RuntimeError("a run is in progress")
        self.operation = work if isinstance(work, RegisterOperation) else None
        self.request = work if isinstance(work, RunRequest) else work.request
        self._engine = Engine.start(work)
        self._started.start()

    def send(self, command: Command) -> None:
        """Send a command to the engine, if it is running."""
        if self._engine is not None:
            self._engine.send(command)

    def stop_listening(self) -> None:
        """Disconnect from the engine, which stops a run safely; kill it if it does not respond."""
        if self._engine is not None:
            self._engine.stop_listening()
            self._end()

    def close(self) -> None:
        """Disconnect from the engine, and wait until it has stopped the run and stored its result."""
        engine = self._engine
        if engine is not None:
            self._end()
            engine.close()

    def _announce(self) -> None:
        self.running_changed.emit(True)
        self._timer.start()

    def _poll(self) -> None:
        engine = self._engine
        if engine is None:
            return
        for event in engine.poll():
            self.event.emit(event)
        if engine.ended and engine is self._engine and not engine.alive:
            self._end()

    def _end(self) -> None:
        self._started.stop()
        self._timer.stop()
        self._engine = None
        self.running_changed.emit(False)
