"""`table`: shows the state of the table, or resets a latched fault."""

from dataclasses import asdict

from calstation.cli.options import JsonOption, ProductOption, StationOption, command_group
from calstation.cli.show import emit, ignore_progress
from calstation.cli.text import say
from calstation.config import load_station
from calstation.connection import LinkTestRequest, TableState, read_table, reset_table
from calstation.errors import DeviceFaultError

app = command_group()


@app.command()
def status(station: StationOption = None, product: ProductOption = None, json: JsonOption = None) -> int:
    """Show the state of the table; return the exit code of a device fault if one is latched."""
    request = LinkTestRequest(load_station(station)[1], product)
    state, name = read_table(ignore_progress, request), request.station.name
    emit({"station": name, **asdict(state)}, json, [say("cli.table_station", name=name), *_state_lines(state)])
    return 0 if state.fault is None else DeviceFaultError.exit_code


@app.command("reset")
def reset_fault(station: StationOption = None, product: ProductOption = None, json: JsonOption = None) -> int:
    """Reset a latched fault of the table; return the exit code of a device fault if it persists."""
    request = LinkTestRequest(load_station(station)[1], product)
    reset, name = reset_table(ignore_progress, request), request.station.name
    words = say(f"reset.{reset.outcome}", **asdict(reset))
    emit({"station": name, **asdict(reset)}, json, [say("cli.table_reset", station=name, words=words)])
    return 0 if reset.clear else DeviceFaultError.exit_code


def _state_lines(state: TableState) -> list[str]:
    watchdog = {None: say("cli.none"), 0.0: say("cli.switched_off")}.get(state.watchdog_s, f"{state.watchdog_s} s")
    axes = (
        say("cli.axes_on" if state.enabled else "cli.axes_off"),
        say("cli.axes_homed" if state.homed else "cli.axes_not_homed"),
        say("cli.axes_moving" if state.moving else "cli.axes_at_rest"),
    )
    lines = [
        say("cli.table_model", model=state.model, serial=state.serial),
        say("cli.table_fault", fault=state.fault or say("cli.none")),
        say("cli.interlock_closed" if state.interlock_closed else "cli.interlock_open"),
        say("cli.table_axes", axes=axes),
        say("cli.table_watchdog", watchdog=watchdog),
    ]
    if state.outer_deg is not None and state.inner_deg is not None:
        lines.append(say("cli.table_angles", outer=state.outer_deg, inner=state.inner_deg))
    return lines
