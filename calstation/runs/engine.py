"""The engine's one entry: a run, or an errand, in a process of its own that hears commands and tells events."""

import multiprocessing
import signal
import sys
import time
import traceback
from collections.abc import Iterator
from contextlib import suppress
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from queue import Empty
from types import TracebackType
from typing import TYPE_CHECKING, Any

from calstation.config.request import RegisterOperation, RunRequest
from calstation.errors import CalstationError, DeviceFaultError
from calstation.jobs.process import PipeReader, spawn_process
from calstation.runs.channel import BEAT, Channel
from calstation.sequencer.control import Command, Control
from calstation.sequencer.events import Event, Fault, Settled, Verdict, from_json

if TYPE_CHECKING:
    from calstation.runs.hooks import RunHooks

#: Longest uninterruptible wait for a message, s.
_SLICE = 0.2

#: Host time without a sign of life, while somebody listened, after which the engine counts as frozen, s.
FROZEN_AFTER = 2.0

#: The same for `events`, which has nobody beside it to judge and gives the run up, s.
_FROZEN_UNSEEN_AFTER = 30.0

#: The same until its first event: a computer just switched on reads hundreds of megabytes of libraries, s.
_BEGINS_WITHIN = 60.0

#: Host time after which a sequencer that takes no commands lets the heartbeat stop, s: three lost answers of a
#: slow table and a slow disk are shorter.
STUCK_AFTER = 10.0

#: What `close` gives to an engine for its safe stop and its result, s.
_CLOSES_WITHIN = 60.0

_KILLED_WITHIN = 5.0

#: What to do about an engine that has died or is frozen.
MEND = (
    "the table's watchdog stops the table and stays latched, where it has one: look at the table, reset its fault"
    " ('Reset the fault' in the window, or calstation table reset), then start again or resume the run at its last"
    " finished stage"
)

#: Kind of a `Fault` that is a mistake of the program; its text is the traceback.
INTERNAL = "internal"


class Engine:
    """A running engine as its listener sees it: by `poll` from a timer, or by `events` in a loop.

    A listener must look at least every few seconds: one that does not counts as frozen and its run is stopped
    safely.
    """

    def __init__(self, process: BaseProcess, connection: "Connection[Any, Any]") -> None:
        self.process = process
        self._connection = connection
        self._pipe_reader = PipeReader(connection)
        self._begun = False
        self._told_end = False
        self._ended = False
        self._frozen = False
        self._silence = 0.0
        self._looked = time.monotonic()

    @classmethod
    def start(
        cls, request: RunRequest | RegisterOperation, hooks: "type[RunHooks] | None" = None
    ) -> "Engine":
        """Start a run, which `hooks` accompany, or a register operation in a new process."""
        context = multiprocessing.get_context("spawn")
        here, there = context.Pipe()
        process = context.Process(target=_engine, args=(there, request, hooks), name="calstation engine")
        spawn_process(process)
        there.close()
        return cls(process, here)

    @property
    def alive(self) -> bool:
        """Whether the engine's process lives; it may do so for a moment after its last event."""
        return self.process.is_alive()

    @property
    def ended(self) -> bool:
        """Whether nothing more will come from `poll`."""
        return self._ended

    def poll(self) -> list[Event]:
        """Everything told since the last call, possibly nothing. Never waits.

        An engine that ended without a word, or has been silent for `FROZEN_AFTER` s, is told as one `Fault`
        of kind DeviceFaultError. A frozen engine may come back: its events are then told on.
        """
        return self._read(FROZEN_AFTER)

    def events(self, timeout: float | None = None) -> Iterator[Event]:
        """Events as they come, until the engine has ended or `timeout` s pass without one.

        Raises DeviceFaultError where the engine dies without a word or stays frozen.
        """
        last = time.monotonic()
        while not self._ended:
            for event in self._read(_FROZEN_UNSEEN_AFTER, _SLICE):
                if isinstance(event, Fault) and not self._told_end:
                    raise DeviceFaultError(event.text)
                yield event
                last = time.monotonic()
            if timeout is not None and time.monotonic() - last > timeout:
                return
        self.process.join(_CLOSES_WITHIN)

    def send(self, command: Command) -> None:
        """Ask for something; an engine that has ended does not mind."""
        self._say(str(command))

    def hang_up(self) -> None:
        """Listen no longer: a run that is still going stops safely by itself, a frozen engine is killed.

        Never waits; `alive` tells when the process is gone.
        """
        self._ended = True
        self._pipe_reader.close()
        if self._frozen:
            self.process.kill()

    def close(self, within: float = _CLOSES_WITHIN) -> None:
        """Hang up and wait at most `within` s for the safe stop and the result; then end the process."""
        self.hang_up()
        self.process.join(within)
        if self.process.is_alive():
            self.process.kill()
            self.process.join(_KILLED_WITHIN)

    def __enter__(self) -> "Engine":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _read(self, frozen_after: float, wait: float = 0.0) -> list[Event]:
        """What has come whole, waiting at most `wait` s for the first: a slice, so that Ctrl-C is heard everywhere."""
        events: list[Event] = []
        heard = False
        while not self._ended:
            try:
                message = self._pipe_reader.take(0.0 if heard else wait)
            except Empty:
                break
            except EOFError:
                self._ended = True
                if not self._told_end:
                    events.append(self._fault(f"its process ended unexpectedly{self._exit_code()}"))
                break
            heard = True
            if message == BEAT:
                self._say(BEAT)
            else:
                events.append(self._take(message))
        if not self._ended and self._falls_silent(heard, frozen_after):
            events.append(self._fault("it gives no sign of life any more"))
        return events

    def _say(self, word: str) -> None:
        if not self._ended:
            with suppress(OSError):
                self._connection.send(word)

    def _take(self, message: dict[str, Any]) -> Event:
        event = from_json(message)
        self._begun = True
        self._told_end = self._told_end or isinstance(event, Verdict | Settled | Fault)
        return event

    def _falls_silent(self, heard: bool, frozen_after: float) -> bool:
        """Whether the engine has just become frozen; only time in which this listener looked itself counts."""
        now = time.monotonic()
        if heard:
            self._silence, self._frozen = 0.0, False
        else:
            self._silence += min(now - self._looked, _SLICE)
        self._looked = now
        if self._frozen or self._silence <= (frozen_after if self._begun else _BEGINS_WITHIN):
            return False
        self._frozen = True
        return True

    def _exit_code(self) -> str:
        self.process.join(0.02)
        code = self.process.exitcode
        return "" if code is None else f" (exit code {code})"

    def _fault(self, what: str) -> Fault:
        return Fault(DeviceFaultError.__name__, f"engine: {what}; {MEND}", DeviceFaultError.exit_code)


def _engine(
    connection: "Connection[Any, Any]",
    request: RunRequest | RegisterOperation,
    hooks: "type[RunHooks] | None",
) -> None:
    """Entry of the engine's process: no signal that it can hear ends it without a safe stop."""
    control = Control()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda number, frame: control.send(Command.STOP, "signal"))
    if sys.platform != "win32":
        signal.signal(
            signal.SIGHUP, signal.SIG_IGN
        )  # a closed terminal ends the listener, and that is a stop
    channel = Channel(
        connection,
        control.send,
        lambda: control.send(Command.STOP, "listener_lost"),
        lambda: control.send(Command.STOP, "listener_silent"),
        lambda: not control.stuck(STUCK_AFTER),
    )
    try:
        if isinstance(request, RunRequest):
            from calstation.runs.hooks import RunHooks
            from calstation.runs.run import execute

            execute(request, channel.emit, control, hooks or RunHooks)
        else:
            from calstation.registers.operation import run_operation

            run_operation(request, channel.emit, control)
    except CalstationError as error:
        channel.emit(Fault.of(error))
    except Exception:  # noqa: BLE001 - told to the listener, whose process this is not
        channel.emit(Fault(INTERNAL, traceback.format_exc(), 3))
    finally:
        channel.close()
