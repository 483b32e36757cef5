"""The command `quality`, a group of commands."""

from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from calstation.cli.options import JsonOption, ProductOption, StationOption, by_name

quality = typer.Typer(help="Statistics of stored runs: yield, control charts, capability, gauge studies.")

FolderOption = Annotated[Path, typer.Option("--out", help="Folder of the runs.")]
ParameterOption = Annotated[str | None, typer.Option(help="Only this parameter.", metavar="NAME")]


@quality.callback(invoke_without_command=True)
def _quality(
    context: typer.Context,
    product: Annotated[
        Path | None, typer.Option(help="Product file or its name; default: all.", callback=by_name("products"))
    ] = None,
    serial: Annotated[str | None, typer.Option(help="Golden unit, which does not count otherwise.")] = None,
    parameter: ParameterOption = None,
    since: Annotated[
        datetime | None,
        typer.Option(help="Day of the first run.", formats=["%Y-%m-%d"], metavar="DATE"),
    ] = None,
    relative: Annotated[
        bool, typer.Option("--relative", help="In standard deviations, for runs of several schedules.")
    ] = False,
    out: FolderOption = Path("runs"),
    json: JsonOption = None,
) -> None:
    if context.invoked_subcommand is None:
        from calstation.cli.quality import quality_command

        raise typer.Exit(quality_command(product, serial, parameter, since, out, json, relative=relative))


@quality.command()
def gauge(
    path: Annotated[Path, typer.Argument(metavar="PLAN.json", help="Plan of the study.")],
    plan: Annotated[bool, typer.Option("--plan", help="Make the plan, in random order, and show it.")] = False,
    units: Annotated[str | None, typer.Option(help="Plan: serial numbers.", metavar="A,B,...")] = None,
    operators: Annotated[str | None, typer.Option(help="Plan: operators to compare.", metavar="A,B,...")] = None,
    stations: Annotated[str | None, typer.Option(help="Plan: stations to compare.", metavar="A,B,...")] = None,
    trials: Annotated[int, typer.Option(min=2, help="Plan: runs of each unit by each of them.")] = 3,
    seed: Annotated[int, typer.Option(min=0, help="Plan: of the random order.")] = 1,
    product: Annotated[
        Path | None,
        typer.Option(help="Product of the units; later by default that of the plan.", callback=by_name("products")),
    ] = None,
    parameter: ParameterOption = None,
    out: FolderOption = Path("runs"),
    json: JsonOption = None,
) -> None:
    """Plan a study of repeatability and reproducibility (GR&R), or evaluate it from the stored runs."""
    from calstation.cli.quality import plan_command, study_command

    if plan:
        raise typer.Exit(plan_command(path, product, units, operators, stations, trials, seed, json))
    raise typer.Exit(study_command(path, product, parameter, out, json))


@quality.command()
def standards(
    station: StationOption = None,
    product: ProductOption = None,
    out: FolderOption = Path("runs"),
    json: JsonOption = None,
) -> None:
    """List check standards, certificates and table charts; exit code 1 if production is refused or one alarms."""
    from calstation.cli.standards import standards_command

    raise typer.Exit(standards_command(station, product, out, json))
