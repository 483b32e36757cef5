"""Reading of the state of a table and reset of a latched fault; nothing moves and no axis is switched on."""

import math
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Literal

from calstation.connection.devices import link_settings, open_table
from calstation.connection.identify import identify
from calstation.connection.link_test import LinkTestRequest, link_test_configuration, open_endpoints
from calstation.devices import LOCAL_CONTROL, Table, TableIdentity
from calstation.devices.links import ModbusRefusalError, TextRefusalError
from calstation.jobs import ProgressCallback

Outcome = Literal["nothing", "cleared", "still_moving", "interlock_open", "moving", "local_control", "refused", "stays"]

#: Timeout for a drive to clear a latched fault, host time, s.
_CLEAR_TIMEOUT = 2.0

_POLL_INTERVAL = 0.1


@dataclass(frozen=True)
class TableState:
    """The state of a table; the angles are None if they are not measured.

    The watchdog timeout `watchdog_s` is 0 if the watchdog is off, and None if there is no watchdog.
    """

    model: str
    serial: str
    fault: str | None
    interlock_closed: bool
    enabled: bool
    homed: bool
    moving: bool
    watchdog_s: float | None
    outer_deg: float | None
    inner_deg: float | None


@dataclass(frozen=True)
class TableReset:
    """The result of a reset.

    outcome : without a latched fault, ``nothing`` for a table at rest or ``still_moving``; ``cleared``;
        ``interlock_open``, ``moving`` or ``local_control`` if this prevented the reset; ``refused`` by the table;
        ``stays`` if the fault remains because its cause persists
    latched : latched fault before the reset, or None
    left : latched fault after the reset, or None
    words : message of the table if it refused the reset
    """

    outcome: Outcome
    latched: str | None
    left: str | None
    words: str = ""

    @property
    def clear(self) -> bool:
        """Whether no fault is latched any longer and the table is at rest."""
        return self.left is None and self.outcome != "still_moving"


def read_table(progress: ProgressCallback, request: LinkTestRequest) -> TableState:
    """Read the table's state without writing anything. Raises CalstationError."""
    with _identified(progress, request) as (table, identity):
        status = table.status()
    outer, inner = (math.degrees(angle) if math.isfinite(angle) else None for angle in status.angles)
    return TableState(
        model=identity.model,
        serial=identity.serial,
        fault=status.fault,
        interlock_closed=status.interlock_closed,
        enabled=status.enabled,
        homed=status.homed,
        moving=status.moving,
        watchdog_s=status.watchdog if math.isfinite(status.watchdog) else None,
        outer_deg=outer,
        inner_deg=inner,
    )


def reset_table(progress: ProgressCallback, request: LinkTestRequest) -> TableReset:
    """Reset a latched fault of the station's table. Raises CalstationError."""
    with _identified(progress, request) as (table, _):
        return reset(table)


@contextmanager
def _identified(progress: ProgressCallback, request: LinkTestRequest) -> Iterator[tuple[Table, TableIdentity]]:
    setup = link_test_configuration(request)
    with open_endpoints(progress, setup) as ports:
        table = open_table(setup, ports.table)
        with closing(table):
            progress(0.5, note="asking")
            yield table, identify(table, None, link_settings(setup, ports))


def reset(table: Table) -> TableReset:
    """Reset the latched fault of an open table if this is safe.

    No reset is sent to a table whose model differs from the profile, to a moving table, because a reset removes the
    power from the drives, or while the interlock is open, because a person may be inside the guard.
    """
    table.identify()
    before = table.status()
    latched = before.fault
    if latched is None:
        return TableReset("still_moving" if before.moving else "nothing", None, None)
    if latched == LOCAL_CONTROL:
        return TableReset("local_control", latched, latched)
    if not before.interlock_closed:
        return TableReset("interlock_open", latched, latched)
    if before.moving:
        return TableReset("moving", latched, latched)
    try:
        table.reset_fault()
    except (ModbusRefusalError, TextRefusalError) as exc:
        remaining = table.status().fault
        return TableReset("refused" if remaining else "cleared", latched, remaining, str(exc))
    deadline = time.monotonic() + _CLEAR_TIMEOUT
    while (remaining := table.status().fault) is not None and time.monotonic() < deadline:
        time.sleep(_POLL_INTERVAL)
    return TableReset("stays" if remaining else "cleared", latched, remaining)
