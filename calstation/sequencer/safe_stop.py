"""The safe stop: decelerate, wait for rest, switch the axes off; works whatever else has failed."""

import time
from collections.abc import Callable

from calstation.devices.interfaces import Table
from calstation.sequencer.ports import Clock

#: Station and host time allowed for the deceleration, s.
_REST_WITHIN = 30.0

#: Station time for it where the table does not answer, s.
_UNSEEN = 5.0

_TICK = 0.05


def safe_stop(table: Table, clock: Clock) -> list[str]:
    """Bring the table to rest and switch its axes off; returns what failed on the way, never raises.

    A table that no longer answers is left to its own watchdog, which this run has seen switched on. One that has none
    was given a move to an angle only; it gets `_UNSEEN` before its axes are told to switch off.
    """
    failures: list[str] = []
    _attempt(table.stop, failures)
    if failures:  # it may have heard all the same: axes are not switched off while they turn
        _attempt(lambda: clock.sleep(_UNSEEN), failures)
    else:
        _attempt(lambda: _wait_for_rest(table, clock), failures)
    _attempt(table.disable, failures)
    return failures


def _wait_for_rest(table: Table, clock: Clock) -> None:
    deadline, host_deadline = clock.now() + _REST_WITHIN, time.monotonic() + _REST_WITHIN
    while table.status().moving and clock.now() < deadline and time.monotonic() < host_deadline:
        table.heartbeat()
        clock.sleep(_TICK)


def _attempt(action: Callable[[], None], failures: list[str]) -> None:
    try:
        action()
    except Exception as exc:  # noqa: BLE001 - the next step towards rest must be tried whatever failed
        failures.append(str(exc) or type(exc).__name__)
