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
    """Solve the log of a certificate by the independent program and compare them; exit with its code."""
    from calstation.verify import main

    options = [*(("--log", str(log)) if log else ()), *(("--json", json) if json else ())]
    raise typer.Exit(main([*options, "--", str(source)]))
