"""The process of a command: signals end it with the exit code of a stop, and its standard streams may fail."""

import _thread
import atexit
import io
import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NoReturn

#: Time after which an interruption that Python ignored is repeated, s.
_REPEAT_AFTER = 0.01

#: Exit code of a command that the operator stopped.
STOPPED = 4

#: Signals of a terminal, a service manager or a person that stop a command.
_SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGBREAK") if hasattr(signal, name)
)


class Interruption:
    """Stops the command after a signal.

    Before `command_begins`, nothing is open, and the process ends at once, because an exception during an import may be
    lost or become another error. Afterwards, a command receives a KeyboardInterrupt or handles the signals itself.
    """

    def __init__(self) -> None:
        self.received = False  #: Whether the command was interrupted.
        self._begun = False
        self._handle(self._interrupt)
        sys.unraisablehook = self._repeat

    def command_begins(self) -> None:
        """Raise KeyboardInterrupt for signals from now on."""
        self._begun = True

    def command_completed(self, code: int) -> None:
        """Let signals end the process at once with an exit code from now on, because the command's result is known."""
        self._handle(lambda _: os._exit(code))

    def exit(self, code: int) -> NoReturn:
        """End the process with an exit code."""
        self.command_completed(code)
        with suppress(Exception):  # the error was handled; Python would raise it again at exit
            sys.stdout.flush()
        sys.exit(code)

    def _interrupt(self, number: int) -> None:
        self.received = True
        if self._begun:
            raise KeyboardInterrupt(number)
        with suppress(OSError):
            os.write(2, b"calstation: stopped\n")
        os._exit(STOPPED)

    def _repeat(self, ignored: "sys.UnraisableHookArgs") -> None:
        """Repeat a KeyboardInterrupt that was raised in a destructor or callback, where Python ignores it.

        After an interruption, other errors in destructors are its consequences and are not shown.
        """
        if isinstance(ignored.exc_value, KeyboardInterrupt):
            timer = threading.Timer(_REPEAT_AFTER, _thread.interrupt_main, ignored.exc_value.args)
            timer.daemon = True
            timer.start()
        elif not self.received:
            sys.__unraisablehook__(ignored)

    def _handle(self, action: Callable[[int], object]) -> None:
        for number in _SIGNALS:
            if signal.getsignal(number) != signal.SIG_IGN:  # nohup ignores SIGHUP
                signal.signal(number, lambda received, _: action(received))


#: Interruption of this process, if the process runs a command.
_interruptions: list[Interruption] = []


def interruption() -> Interruption | None:
    """Return the interruption of this process, or None if the process does not run a command."""
    return _interruptions[0] if _interruptions else None


def prepare() -> Interruption:
    """Handle signals and the failures of standard streams for a command in this process."""
    _interruptions[:] = [Interruption()]
    if sys.platform != "win32":  # the first function registered is called last, before Python restores the handlers
        atexit.register(signal.pthread_sigmask, signal.SIG_BLOCK, _SIGNALS)
    for descriptor, flags in enumerate((os.O_RDONLY, os.O_RDONLY, os.O_RDWR)):
        try:
            os.fstat(descriptor)
        except OSError:  # closed; a file that is opened later must not receive this descriptor
            os.open(os.devnull, flags)
    sys.stdin = sys.stdin or open(0, encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stdout = _stream(sys.stdout, _StandardOutput, 1)
    sys.stderr = _stream(sys.stderr, _StandardError, 2)
    return _interruptions[0]


def _stream(stream: Any, kind: type[io.TextIOWrapper], descriptor: int) -> io.TextIOWrapper:
    if stream is None:
        raw = io.FileIO(descriptor, "w", closefd=False)
        return kind(io.BufferedWriter(raw), "utf-8", "replace")
    buffering = {name: getattr(stream, name) for name in ("line_buffering", "write_through")}
    encoding = stream.encoding
    return kind(stream.detach(), encoding, "replace", **buffering)  # a Windows console cannot show ≤ or °


def _discard(descriptor: int) -> None:
    """Discard everything that is written to a descriptor from now on."""
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, descriptor)
    os.close(null)


class _StandardError(io.TextIOWrapper):
    """Standard error, whose failure does not affect the command: later text is discarded."""

    def write(self, text: str) -> int:
        try:
            return super().write(text)
        except OSError:
            _discard(2)
            return len(text)

    def flush(self) -> None:
        try:
            super().flush()
        except OSError:
            _discard(2)


class _StandardOutput(io.TextIOWrapper):
    """Standard output, whose first failure raises BrokenPipeError or ConfigurationError; later text is discarded.

    The writer may ignore the failure; the next flush therefore raises it again.
    """

    _unseen: Exception | None = None

    def write(self, text: str) -> int:
        try:
            return super().write(text)
        except OSError as error:
            self._unseen = _failure(error)
            raise self._unseen from error

    def flush(self) -> None:
        unseen, self._unseen = self._unseen, None
        if unseen is not None:
            raise unseen
        try:
            super().flush()
        except OSError as error:
            raise _failure(error) from error


def _failure(error: OSError) -> Exception:
    from calstation.errors import ConfigurationError
    from calstation.messages import os_reason

    _discard(1)
    if isinstance(error, BrokenPipeError):
        return error
    return ConfigurationError("cli.output_not_written", reason=os_reason(error))
