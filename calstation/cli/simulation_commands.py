"""The commands that only simulate: `record`, `study` and `soak`."""

from pathlib import Path
from typing import Annotated

import typer

from calstation.cli.options import JsonOption

simulation = typer.Typer()


@simulation.command()
def record(
    kind: Annotated[str, typer.Argument(metavar="KIND", help="hand, pair (of IMUs on one body) or gimbal.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Raw log to write.", metavar="LOG")],
    grade: Annotated[str, typer.Option(help="nav, tactical or mems.")] = "mems",
    seed: Annotated[int, typer.Option(min=0, help="Of unit, motion and noise.")] = 1,
) -> None:
    """Make a virtual-bench recording for the methods that need no table."""
    from calstation.cli.logs import record_command

    raise typer.Exit(record_command(kind, out, grade, seed))


@simulation.command()
def study(
    grade: Annotated[str | None, typer.Option(help="nav, tactical or mems; default: all.")] = None,
    seeds: Annotated[
        int | None, typer.Option(help="Monte Carlo runs per grade; default: 30, for the stages of grade nav 100.")
    ] = None,
    json: JsonOption = None,
    method: Annotated[
        str | None, typer.Option(help="multi_position, cross_calibration or gimbal, in place of the stages.")
    ] = None,
) -> None:
    """Run a Monte Carlo study of the whole method against truth and the Cramer-Rao bound."""
    from calstation.cli.studies import method_study_command, study_command

    if method is not None:
        raise typer.Exit(method_study_command(method, grade, seeds, json))
    raise typer.Exit(study_command(grade, seeds, json))


@simulation.command()
def soak(
    runs: Annotated[int, typer.Option(min=1, help="Calibrations.")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="Of units, faults and their moments.")] = 1,
    json: JsonOption = None,
    full: Annotated[bool, typer.Option("--full", help="The product's whole schedule in every run.")] = False,
    keep: Annotated[Path | None, typer.Option(help="Keep logs and results in this folder.", metavar="DIR")] = None,
) -> None:
    """Run calibrations back to back on the virtual bench with random faults, and compare them with its truth."""
    from calstation.cli.studies import soak_command

    raise typer.Exit(soak_command(runs, seed, json, full=full, keep=keep))
