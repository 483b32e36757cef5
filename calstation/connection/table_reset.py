"""The operator's reset of a fault that the table has latched; nothing moves and no axis is switched on."""

import math
import time
from dataclasses import dataclass
from typing import Literal

from calstation.connection.devices import open_table, wires
from calstation.connection.identify import identify
from calstation.connection.link_test import LinkTestRequest, link_test_configuration, open_endpoints
from calstation.devices.interfaces import LOCAL_CONTROL, Table, TableIdentity, TableStatus
from calstation.devices.links.modbus_link import ModbusRefusalError
from calstation.devices.links.text_link import TextRefusalError
from calstation.jobs.queue import ProgressCallback

Outcome = Literal["nothing", "cleared", "interlock_open", "moving", "local_control", "refused", "stays"]

#: Host time that a drive is given to clear what it has latched, s.
_CLEARED_WITHIN = 2.0

_LOOK_EVERY = 0.1


@dataclass(frozen=True)
class TableState:
    """How the table of a station stands.

    Attributes
    ----------
    outer_deg, inner_deg : of the joints, None where nothing measures them
    watchdog_s : 0 where it is off, None where the table has none
    fault : what is latched, None where nothing is
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
    """What came of a reset.

    Attributes
    ----------
    outcome : ``nothing`` was latched; ``cleared``; not sent: ``interlock_open``, ``moving``, ``local_control``; sent,
        but ``refused`` by the table, or the fault ``stays`` because its cause does
    latched : the fault found, left : the one that is there now; None for none
    words : of the table's refusal
    """

    outcome: Outcome
    latched: str | None
    left: str | None
    words: str = ""

    @property
    def clear(self) -> bool:
        """Whether nothing is latched now."""
        return self.left is None


def read_table(tell: ProgressCallback, order: LinkTestRequest) -> TableState:
    """Ask the table how it stands; writes nothing. Raises CalstationError."""
    setup = link_test_configuration(order)
    with open_endpoints(tell, setup) as at:
        table = open_table(setup, at.table)
        try:
            tell(0.5, note="asking")
            identity = identify(table, None, wires(setup, at.table, at.imu))
            return _standing(identity, table.status())
        finally:
            table.close()


def reset_table(tell: ProgressCallback, order: LinkTestRequest) -> TableReset:
    """Work for the workshop: reset what the station's table has latched. Raises CalstationError."""
    setup = link_test_configuration(order)
    with open_endpoints(tell, setup) as at:
        table = open_table(setup, at.table)
        try:
            tell(0.5, note="asking")
            identify(table, None, wires(setup, at.table, at.imu))
            return reset(table)
        finally:
            table.close()


def reset(table: Table) -> TableReset:
    """Reset an open table's fault, where there is one and nothing speaks against it.

    Nothing is sent to another model than the profile's, to a table that still turns (the reset drops the drive's
    power), nor while the interlock is open: whoever is inside the guard must not have the table made ready from here.
    """
    table.identify()
    before = table.status()
    latched = before.fault
    if latched is None:
        return TableReset("nothing", None, None)
    if latched == LOCAL_CONTROL:
        return TableReset("local_control", latched, latched)
    if not before.interlock_closed:
        return TableReset("interlock_open", latched, latched)
    if before.moving:
        return TableReset("moving", latched, latched)
    try:
        table.reset_fault()
    except (ModbusRefusalError, TextRefusalError) as exc:
        left = table.status().fault
        return TableReset("refused" if left else "cleared", latched, left, str(exc))
    left = _left(table)
    return TableReset("stays" if left else "cleared", latched, left)


def _left(table: Table) -> str | None:
    """What is latched once the drive has had its time to clear it."""
    deadline = time.monotonic() + _CLEARED_WITHIN
    while (left := table.status().fault) is not None and time.monotonic() < deadline:
        time.sleep(_LOOK_EVERY)
    return left


def _standing(identity: TableIdentity, status: TableStatus) -> TableState:
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
