"""`import`: converts a CSV file, or a raw capture of the bytes sent by an IMU, to a raw log."""

from pathlib import Path
from typing import Annotated

import typer

from calstation.cli.options import LogOutOption, StationOption, by_name, command_group
from calstation.cli.show import plain_console, show_line
from calstation.cli.text import say
from calstation.records import open_log, write_log
from calstation.results import recording_faults

app = command_group()


@app.command()
def import_(
    source: Annotated[Path, typer.Argument(metavar="FILE")],
    out: LogOutOption,
    meta: Path | None = None,
    imu: Annotated[Path | None, typer.Option(callback=by_name("imus"))] = None,
    station: StationOption = None,
) -> None:
    """Convert a CSV file, or a raw capture with the profile `imu` and the site of `station`, to a raw log."""
    if imu is None:
        log = open_log(source, meta)
        facts = write_log(out, log.meta, log.blocks())
        notes = [say("cli.import_jitter", jitter=1e3 * log.jitter)] if log.jitter else []
    else:
        from calstation.config import load_station
        from calstation.connection import import_capture

        config = load_station(station)[1]
        capture = import_capture(source, out, imu, meta, config.site.location)
        facts = capture.facts
        notes = [say("cli.import_damaged", packets=capture.failed, bytes=capture.skipped)]
        notes += [] if capture.has_site else [say("cli.import_site", station=config.name)]
    text = say("cli.imported", file=out, samples=facts.samples, gaps=facts.gaps)
    console = plain_console(stderr=True)
    show_line(console, ", ".join([text, *notes]))
    for fault in recording_faults(open_log(out)):
        show_line(console, say("cli.recording_fault", fault=fault))
