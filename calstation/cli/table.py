"""`table`: how a station's table stands, and the operator's reset of what it has latched."""

import sys
from dataclasses import asdict
from pathlib import Path

from rich.console import Console

from calstation.cli.show import check_json, emit_json
from calstation.cli.wording import RESETS
from calstation.config.station import load_station
from calstation.connection.link_test import Order
from calstation.connection.table_reset import TableStanding, read_table, reset_table
from calstation.errors import DeviceFaultError


def status_command(station: Path | None, product: Path | None, json: str | None) -> int:
    """Show how the table stands; the code of a device fault where one is latched."""
    check_json(json)
    order = _order(station, product)
    standing = read_table(_tell, order)
    emit_json({"station": order.station.name, **asdict(standing)}, json)
    if json != "-":
        _say("\n".join([f"station    {order.station.name}", *_lines(standing)]))
    return 0 if standing.fault is None else DeviceFaultError.exit_code


def reset_command(station: Path | None, product: Path | None, json: str | None) -> int:
    """Reset what the table has latched; the code of a device fault where it stays."""
    check_json(json)
    order = _order(station, product)
    result = reset_table(_tell, order)
    emit_json({"station": order.station.name, **asdict(result)}, json)
    if json != "-":
        said = RESETS[result.outcome].format(latched=result.latched, left=result.left, words=result.words)
        _say(f"Table of '{order.station.name}': {said}")
    return 0 if result.clear else DeviceFaultError.exit_code


def _order(station: Path | None, product: Path | None) -> Order:
    return Order(load_station(station)[1], product)


def _lines(standing: TableStanding) -> list[str]:
    watchdog = {None: "none", 0.0: "OFF"}.get(standing.watchdog_s, f"{standing.watchdog_s} s")
    lines = [
        f"{standing.model}, serial number {standing.serial}",
        f"fault      {standing.fault or 'none'}",
        f"interlock  {'closed' if standing.interlock_closed else 'OPEN'}",
        f"axes       {'on' if standing.enabled else 'off'}, {'homed' if standing.homed else 'not homed'},"
        f" {'moving' if standing.moving else 'at rest'}",
        f"watchdog   {watchdog}",
    ]
    if standing.outer_deg is not None and standing.inner_deg is not None:
        lines.append(f"angles     outer {standing.outer_deg:.3f}°, inner {standing.inner_deg:.3f}°")
    return lines


def _say(text: str) -> None:
    Console(file=sys.stdout, soft_wrap=True).print(text, highlight=False, markup=False)


def _tell(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
    """Nothing is shown of works that take seconds."""
