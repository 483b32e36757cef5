"""The workshop's other side: a process that takes jobs from a pipe and does them one after another."""

import pickle
import signal
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from typing import Any, Protocol

from calstation.errors import CalstationError

#: Progress told more often than this, s, is left out: a listener that is late must not slow the work down.
_TELL_EVERY = 0.05

#: Host time after which kernels are made ready, s: while the window opens the computer has enough to do.
_WARM_AFTER = 2.0

READY = ("ready",)


class ProgressCallback(Protocol):
    """How a work says how far it is; also where it learns that nobody wants it any more."""

    def __call__(self, fraction: float, remaining_s: float | None = None, note: str = "") -> None:
        """`fraction` 0..1 done, `remaining_s` s left where known, `note` what is being done."""


class _HungUp(BaseException):
    """The workshop has gone; no work catches this."""


def serve(connection: "Connection[Any, Any]") -> None:
    """Entry of the worker's process: ends when the workshop hangs up."""
    with suppress(ValueError, OSError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the listener
    import calstation.results.resolve  # noqa: F401 - what most jobs need, before the first of them

    warm = threading.Timer(_WARM_AFTER, _warm)
    warm.daemon = True
    warm.start()
    with suppress(_HungUp, EOFError, OSError):
        connection.send(READY)
        while True:
            _do(connection, connection.recv_bytes())


def _warm() -> None:
    from calstation.estimation.navigation.stage import warm_up

    with suppress(Exception):  # a job that needs it meets the same error, and its listener is told
        warm_up()


def _do(connection: "Connection[Any, Any]", job: bytes) -> None:
    """Do one job and answer with its result or one sentence."""
    try:
        work, args, kwargs = pickle.loads(job)
        result = work(_teller(connection), *args, **kwargs)
        answer = bytes(ForkingPickler.dumps(("done", result)))
    except CalstationError as error:
        answer = bytes(ForkingPickler.dumps(("failed", str(error))))
    except Exception as error:  # noqa: BLE001 - told to the listener, whose process this is not
        answer = bytes(ForkingPickler.dumps(("failed", internal(error))))
    connection.send_bytes(answer)


def internal(error: BaseException) -> str:
    """The one sentence of an error that is a mistake of the program."""
    text = " ".join(str(error).split())
    return f"internal error: {type(error).__name__}" + (f": {text}" if text else "")


def _teller(connection: "Connection[Any, Any]") -> Callable[..., None]:
    last = float("-inf")

    def tell(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
        nonlocal last
        now = time.monotonic()
        if now - last < _TELL_EVERY:
            return
        last = now
        try:
            connection.send(("progress", float(fraction), remaining_s, note))
        except OSError:
            raise _HungUp from None

    return tell
