"""`export`: converts a raw log to a CSV file."""

from pathlib import Path
from typing import Annotated

import typer

from calstation.cli.options import command_group
from calstation.cli.show import plain_console, show_line
from calstation.cli.text import say
from calstation.records import export_csv

app = command_group()


@app.command()
def export(
    log: Annotated[Path, typer.Argument(metavar="LOG")],
    out: Annotated[Path, typer.Option("-o", "--out")],
) -> None:
    """Write a raw log as a CSV file and a TOML file."""
    facts = export_csv(log, out)
    code = "cli.exported_damaged" if facts.damaged else "cli.exported"
    show_line(plain_console(stderr=True), say(code, file=out, samples=facts.samples, damaged=facts.damaged))
