"""`verify`: compares a certificate with an independent solution of its log."""

from pathlib import Path
from typing import Annotated

import typer

from calstation.cli.options import JsonOption, command_group

app = command_group()


@app.command()
def verify(
    source: Annotated[Path, typer.Argument(metavar="CERTIFICATE.pdf|DCC.xml|RESULT.json|LOG")],
    log: Annotated[Path | None, typer.Option(metavar="LOG")] = None,
    json: JsonOption = None,
) -> None:
    """Compare a certificate with the solution of its log by the independent program; exit with that program's code."""
    from calstation.verify import main

    options = [*(("--log", str(log)) if log else ()), *(("--json", json) if json else ())]
    raise typer.Exit(main([*options, "--", str(source)]))
