"""The engine's one entry: a run in a process of its own that hears commands and tells events."""

import multiprocessing
import signal
import sys
import time
import traceback
from collections.abc import Iterator
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from types import TracebackType
from typing import Any

from calstation.errors import CalstationError, DeviceFaultError
from calstation.sequencer.control import Command, Control
from calstation.sequencer.events import Event, Fault, from_json
from calstation.station.interrupts import deaf_to_interrupts
from calstation.station.request import RunRequest

_SLICE = 0.2
"""Longest uninterruptible wait for a message, s."""

INTERNAL = "internal"
"""Kind of a `Fault` that is a mistake of the program; its text is the traceback."""


class Engine:
    """A running engine as its listener sees it."""

    def __init__(self, process: BaseProcess, connection: "Connection[Any, Any]") -> None:
        self.process = process
        self._connection = connection

    @classmethod
    def start(cls, request: RunRequest) -> "Engine":
        """Start a run in a new process."""
        context = multiprocessing.get_context("spawn")
        here, there = context.Pipe()
        process = context.Process(target=_engine, args=(there, request), name="calstation engine")
        with deaf_to_interrupts():
            process.start()
        there.close()
        return cls(process, here)

    def events(self, timeout: float | None = None) -> Iterator[Event]:
        """Events as they come, until the engine has ended or `timeout` s pass without one.

        Raises DeviceFaultError where the engine dies without a word.
        """
        while True:
            try:
                if not self._wait(timeout):
                    return
                yield from_json(self._connection.recv())
            except (EOFError, OSError):
                break
        self.process.join()
        if self.process.exitcode != 0:
            raise DeviceFaultError(
                f"engine: its process ended unexpectedly (exit code {self.process.exitcode}); "
                "the table's watchdog stops the table; look at the table, then start again"
            )

    def _wait(self, timeout: float | None) -> bool:
        """Wait for a message in slices, so that Ctrl-C is heard on every system."""
        deadline = None if timeout is None else time.monotonic() + timeout
        while not self._connection.poll(_SLICE):
            if deadline is not None and time.monotonic() > deadline:
                return False
        return True

    def send(self, command: Command) -> None:
        """Ask for something; an engine that has ended does not mind."""
        try:
            self._connection.send(str(command))
        except OSError:
            return

    def close(self) -> None:
        """Hang up, which stops a run that is still going, and wait for the engine's end."""
        self._connection.close()
        self.process.join()

    def __enter__(self) -> "Engine":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _engine(connection: "Connection[Any, Any]", request: RunRequest) -> None:
    """Entry of the engine's process: no signal that it can hear ends it without a safe stop."""
    control = Control()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda number, frame: control.send(Command.STOP))
    if sys.platform != "win32":
        signal.signal(
            signal.SIGHUP, signal.SIG_IGN
        )  # a closed terminal ends the listener, and that is a stop
    from calstation.station.channel import Channel
    from calstation.station.run import execute

    channel = Channel(connection, control.send, lambda: control.send(Command.STOP))
    try:
        execute(request, channel.emit, control)
    except CalstationError as error:
        channel.emit(Fault(type(error).__name__, str(error), error.exit_code))
    except Exception:  # noqa: BLE001 - told to the listener, whose process this is not
        channel.emit(Fault(INTERNAL, traceback.format_exc(), 3))
    finally:
        channel.close()
