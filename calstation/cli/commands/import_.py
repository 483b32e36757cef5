"""`import`: converts a recording, or a raw capture of the bytes sent by an IMU, to a raw log."""

from pathlib import Path
from typing import Annotated

import typer

from calstation.cli.commands.check import show_recording
from calstation.cli.options import StationOption, by_name, command_group, output_file
from calstation.cli.show import plain_console, show_line
from calstation.cli.text import say
from calstation.errors import ConfigurationError
from calstation.records import Log, damage_summary, open_log, write_log
from calstation.results import inspect_log, recording_faults

app = command_group()


@app.command()
def import_(
    source: Annotated[Path, typer.Argument(metavar="FILE")],
    out: Annotated[Path | None, typer.Option("-o", "--out", metavar="LOG", parser=output_file)] = None,
    meta: Annotated[Path | None, typer.Option("--meta", "--map")] = None,
    imu: Annotated[Path | None, typer.Option(callback=by_name("imus"))] = None,
    station: StationOption = None,
    topic: Annotated[str | None, typer.Option(metavar="NAME")] = None,
    look: Annotated[bool, typer.Option("--look")] = False,
) -> int:
    """Convert a recording, or a raw capture with the profile `imu` and the site of `station`, to a raw log.

    With `look`, show how the recording is interpreted, and write nothing.
    """
    if look and imu is None:
        return show_recording(source, inspect_log(open_log(source, meta, topic)), None)
    if out is None:
        raise ConfigurationError("cli.needs", command="import", name="-o LOG", program="calstation import")
    if imu is None:
        log = open_log(source, meta, topic)
        facts = write_log(out, log.meta, log.blocks())
        notes = _notes(log)
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
    return 0


def _notes(log: Log) -> list[str]:
    """Return notes on losses and irregularities in a recording that has been read."""
    notes = [say("cli.import_jitter", jitter=1e3 * log.times.jitter)] if log.times.jitter else []
    notes += [say("cli.import_topics", topics=log.topics)] if log.topics else []
    notes += [say("cli.import_lost", **damage_summary(log.damaged_rows))] if log.damaged_rows else []
    return notes + [say(text.code, **text.values) for text in log.times.irregularities]
