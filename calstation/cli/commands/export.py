"""`export`: converts a raw log or a folder of runs to a file, or a calibration to the format of another program."""

from pathlib import Path
from typing import Annotated

import typer

from calstation.cli.options import command_group, output_file
from calstation.cli.show import ignore_progress, plain_console, show_line
from calstation.cli.text import say
from calstation.errors import ConfigurationError
from calstation.records import export_csv

app = command_group()


@app.command()
def export(
    source: Annotated[Path, typer.Argument(metavar="RESULT.json|LOG|RUNS")],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="FILE", parser=output_file)],
    to: Annotated[str | None, typer.Option("--to", metavar="FORMAT")] = None,
    log: Annotated[Path | None, typer.Option("--log", metavar="LOG")] = None,
    allow_loss: Annotated[bool, typer.Option("--allow-loss")] = False,
) -> None:
    """Write a raw log as CSV and TOML, a folder of runs as a table, or a result for another program with its check."""
    if to is not None:
        _export_calibration(source, to, out, log, allow_loss)
        return
    if source.suffix == ".json" or log is not None or allow_loss:
        raise ConfigurationError("export.no_format", file=source)
    if source.is_dir():
        _export_runs(source, out)
        return
    facts = export_csv(source, out)
    code = "cli.exported_damaged" if facts.damaged else "cli.exported"
    show_line(plain_console(stderr=True), say(code, file=out, samples=facts.samples, damaged=facts.damaged))


def _export_runs(folder: Path, out: Path) -> None:
    from calstation.records import RunFilter
    from calstation.results import History, export_runs

    history = History(folder)
    history.refresh()
    export_runs(ignore_progress, folder, RunFilter(), out)
    show_line(plain_console(stderr=True), say("cli.runs_exported", file=out, count=history.count(RunFilter())))


def _export_calibration(source: Path, to: str, out: Path, log: Path | None, allow_loss: bool) -> None:
    from calstation.exports import ExportSource, export_calibration
    from calstation.records import open_log
    from calstation.results import result_of

    result = result_of(source)
    recording = log if log is not None or source.suffix == ".json" else source
    stored = None if recording is None else open_log(recording)
    check = export_calibration(ExportSource.of(result, stored, source), to, out, allow_loss=allow_loss)
    console = plain_console(stderr=True)
    differences = {"gyro": check.gyro, "accel": check.accel}
    sigmas = {"gyro_sigmas": check.gyro_sigmas, "accel_sigmas": check.accel_sigmas}
    show_line(console, say("cli.calibration_exported", file=out, samples=check.samples, **differences, **sigmas))
    if check.not_expressed:
        names = [
            say("export.of_limit", name=name, share=check.of_limit[name]) if name in check.of_limit else name
            for name in check.not_expressed
        ]
        show_line(console, say("cli.not_expressed", format=to, names=names))
