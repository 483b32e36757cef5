"""The engine, a separate process that executes runs and register operations, receives commands and sends events."""

import logging
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Iterator
from multiprocessing.connection import Connection
from queue import Empty
from typing import Any

from calstation import __version__, applog
from calstation.config import RegisterOperation, RunRequest
from calstation.errors import CalstationError, DeviceFaultError
from calstation.jobs import STOP_SIGNALS, ChildProcess, receive_stop_signals
from calstation.messages import Text
from calstation.runs.channel import HEARTBEAT, Channel
from calstation.runs.resume import resumable_after
from calstation.sequencer import (
    SOLVER_THREADS,
    Command,
    Control,
    Event,
    Fault,
    Finalized,
    Message,
    Settled,
    StateChanged,
    StopReason,
    from_json,
)

#: Maximum duration of an uninterruptible wait for a message, s.
_MAX_WAIT = 0.2
#: Largest number of messages read at once, so that a window processes STOP even if it shows messages too slowly.
_MAX_MESSAGES = 500

#: Host time without a message, while the listener polls, after which the engine is considered frozen, s.
FROZEN_AFTER = 2.0

#: The same limit while the solver is compiled on a new computer, which slows all threads; the table is at rest, s.
_COMPILING_FROZEN_AFTER = 30.0

#: Host time without a message after which `events` raises an error, s.
_EVENTS_FROZEN_AFTER = 30.0

#: Limit for the first event, s: a computer that was just started loads hundreds of megabytes of libraries.
_FIRST_EVENT_TIMEOUT = 60.0

#: Host time after which a sequencer that processes no commands is considered stuck, and heartbeats stop, s. It exceeds
#: the delay caused by three lost replies of a slow table together with a slow disk.
STUCK_AFTER = 10.0

#: Maximum time that `close` waits for the engine's safe stop and its result, s.
_CLOSE_TIMEOUT = 60.0

#: Kind of a `Fault` caused by a programming error; its text is the traceback.
INTERNAL = "internal"

logger = logging.getLogger(__name__)


class Engine:
    """The listener's interface to a running engine, whose events it reads with `poll` in a timer or `events` in a loop.

    A listener must read events every few seconds; otherwise it is considered frozen, and the run is stopped safely.
    When `ended` is True, `poll` returns no more events.
    """

    def __init__(self, child: ChildProcess, work: RunRequest | RegisterOperation | None = None) -> None:
        self._child, self.process = child, child.process
        self._has_event = False
        #: Whether the work can be resumed if the process ends now.
        self._resumable = isinstance(work, RunRequest) and work.resume is not None
        self._pending_units = sum(map(bool, work.serials)) or 1 if isinstance(work, RunRequest) else 1
        self.ended = False
        self._frozen = self._compiling = False
        self._silence = 0.0
        self._polled = time.monotonic()

    @classmethod
    def start(cls, request: RunRequest | RegisterOperation) -> "Engine":
        """Start a run or a register operation in a new process."""
        return cls(ChildProcess("engine", _engine, request), request)

    @property
    def _has_ended(self) -> bool:
        """Whether every unit has a verdict, or the run has a fault."""
        return self._pending_units <= 0

    @property
    def alive(self) -> bool:
        """Whether the engine's process is alive, which it may be for a short time after its last event."""
        return self.process.is_alive()

    def poll(self) -> list[Event]:
        """Return the events since the last call without waiting; at most `_MAX_MESSAGES` are read at once.

        If the engine ended without a final event or is frozen (see `FROZEN_AFTER`), a `Fault` of kind DeviceFaultError
        is returned once. If a frozen engine recovers, its events follow.
        """
        return self._read(FROZEN_AFTER)

    def events(self, timeout: float | None = None) -> Iterator[Event]:
        """Yield events as they arrive, until the engine has ended or `timeout` s pass without one.

        Raises DeviceFaultError if the engine dies without a final event or stays frozen.
        """
        last = time.monotonic()
        while not self.ended:
            for event in self._read(_EVENTS_FROZEN_AFTER, _MAX_WAIT):
                if isinstance(event, Fault) and not event.slot and not self._has_ended:
                    raise DeviceFaultError(event.code, **event.values)
                yield event
                last = time.monotonic()
            if timeout is not None and time.monotonic() - last > timeout:
                return
        self.process.join(_CLOSE_TIMEOUT)

    def send(self, command: Command) -> None:
        """Send a command to the engine, unless it has ended."""
        self._send(str(command))

    def stop_listening(self) -> None:
        """Stop listening without waiting; a run in progress then stops safely, and a frozen engine is killed.

        `alive` becomes False when the process has ended.
        """
        self.ended = True
        self._child.close()
        if self._frozen:
            self.process.kill()

    def close(self, within: float = _CLOSE_TIMEOUT) -> None:
        """Stop listening; if the safe stop and the result take more than `within` s, kill the process."""
        self.stop_listening()
        self._child.end(within)

    def __enter__(self) -> "Engine":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _read(self, frozen_after: float, wait: float = 0.0) -> list[Event]:
        """Return at most `_MAX_MESSAGES` complete messages, after waiting at most `wait` s for the first one."""
        events: list[Event] = []
        received = False
        for _ in range(0 if self.ended else _MAX_MESSAGES):
            try:
                message = self._child.take(0.0 if received else wait)
            except Empty:
                break
            except EOFError:
                self.ended = True
                if not self._has_ended:
                    self.process.join(0.02)  # its exit code is not known before
                    events.append(self._fault("run.engine_ended", exit_code=self.process.exitcode))
                break
            received = True
            if message == HEARTBEAT:
                self._send(HEARTBEAT)
            else:
                event = from_json(message)
                self._has_event = True
                self._resumable = resumable_after(event, self._resumable)
                if isinstance(event, Finalized | Settled):
                    self._pending_units -= 1
                elif isinstance(event, Fault) and not event.slot:
                    self._pending_units = 0
                elif isinstance(event, Message | StateChanged):
                    self._compiling = isinstance(event, Message) and event.id == "preparing_solver"
                events.append(event)
        if not self.ended and self._has_become_frozen(received, frozen_after):
            events.append(self._fault("run.engine_silent"))
        return events

    def _send(self, text: str) -> None:
        if not self.ended:
            self._child.send(text)

    def _has_become_frozen(self, received: bool, frozen_after: float) -> bool:
        """Return whether the engine has just become frozen; time in which the listener did not poll does not count."""
        now = time.monotonic()
        if received:
            self._silence, self._frozen = 0.0, False
        else:
            self._silence += min(now - self._polled, _MAX_WAIT)
        self._polled = now
        limit = max(frozen_after, _COMPILING_FROZEN_AFTER) if self._compiling else frozen_after
        if self._frozen or self._silence <= (limit if self._has_event else _FIRST_EVENT_TIMEOUT):
            return False
        self._frozen = True
        return True

    def _fault(self, code: str, **values: Any) -> Fault:
        then = Text("run.then_resume" if self._resumable else "run.then_again")
        fault = Fault.of(DeviceFaultError(code, then=then, **values))
        logger.error("%s", fault.text)
        return fault


def _engine(connection: "Connection[Any, Any]", request: RunRequest | RegisterOperation) -> None:
    """Run the engine in its process, which ends after a signal only when the safe stop is complete."""
    applog.configure("engine")
    logger.info("engine begins, calstation %s", __version__)
    control = Control()
    for stop_signal in STOP_SIGNALS:
        signal.signal(stop_signal, lambda number, frame: control.send(Command.STOP, StopReason.SIGNAL))
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the listener handles Ctrl-C
    if sys.platform != "win32":  # without replies of the listener, a closed or suspended terminal stops the run
        for number in (signal.SIGHUP, signal.SIGTSTP, signal.SIGTTIN):
            signal.signal(number, signal.SIG_IGN)
    receive_stop_signals()

    def send(command: Command, reason: StopReason = StopReason.OPERATOR) -> None:
        logger.info("command %s (%s)", command, reason)
        control.send(command, reason)

    channel = Channel(
        connection,
        send,
        lambda: send(Command.STOP, StopReason.LISTENER_LOST),
        lambda: send(Command.STOP, StopReason.LISTENER_SILENT),
        lambda: not control.stuck(STUCK_AFTER),
    )
    try:
        if isinstance(request, RunRequest):
            from calstation.runs.run import execute

            execute(request, channel.emit, control)
        else:
            from calstation.registers import run_operation

            run_operation(request, channel.emit, control)
    except CalstationError as error:
        logger.error("fault %s: %s", error.code, error)
        channel.emit(Fault.of(error))
    except Exception as error:
        logger.exception("the engine ended with a programming error")
        values = {"detail": f"{type(error).__name__}: {error}"}
        channel.emit(Fault(INTERNAL, traceback.format_exc(), 3, "program.internal", values))
    finally:
        channel.close()
        logger.info("engine ends")
        if any(thread.name.startswith(SOLVER_THREADS) for thread in threading.enumerate()):
            os._exit(0)  # without waiting for the solver of a stopped run, which may compile for minutes
