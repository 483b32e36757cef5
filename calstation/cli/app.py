"""The commands and their options; each command imports its implementation when called, so that --help is fast."""

import io
import logging
import sys
import traceback
from pathlib import Path
from typing import Annotated

import typer

from calstation import __version__, applog
from calstation.cli.database import database
from calstation.cli.device_commands import registers, table
from calstation.cli.fleet import fleet
from calstation.cli.options import (
    ByOption,
    ConfirmedByOption,
    JsonOption,
    ParametersOnlyOption,
    ProductOption,
    StagesOption,
    StationOption,
    by_name,
    parsed_stages,
)
from calstation.cli.quality_commands import quality
from calstation.cli.simulation_commands import simulation
from calstation.cli.text import say, sentence
from calstation.errors import CalstationError, ConfigurationError

_NAME = "calstation"

logger = logging.getLogger(__name__)

app = typer.Typer(
    name=_NAME,
    help="Calibrates inertial measurement units on a two-axis rate table. Without a command: the window.",
    epilog="--debug with any command shows where an error came from.",
    add_completion=False,
    pretty_exceptions_enable=False,
)


def _show_version(wanted: bool) -> None:
    if wanted:
        sys.stdout.write(f"calstation {__version__}\n")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _program(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", help="Show the version.", callback=_show_version, is_eager=True)
    ] = False,
    log_level: Annotated[applog.Level | None, typer.Option(help="Detail of the application log, default info.")] = None,
) -> None:
    from calstation.config import site_folder

    window = context.invoked_subcommand is None
    applog.configure("window" if window else "cli", site_folder() / "logs", log_level)
    if window:
        from calstation.cli.window import window_command

        raise typer.Exit(window_command(lambda: _run(["run"], debug=bool(context.obj))))


@app.command()
def run(
    context: typer.Context,
    stages: StagesOption = None,
    station: StationOption = None,
    product: ProductOption = None,
    serial: Annotated[
        list[str] | None,
        typer.Option(help="Serial number of the unit in the fixture; once per slot in order, - for an empty slot."),
    ] = None,
    speed: Annotated[
        float | None, typer.Option(help="Virtual bench: multiple of real time, 0 as fast as it goes.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Virtual bench: seed of unit and noise.")] = None,
    out: Annotated[Path, typer.Option(help="Folder for log and result.")] = Path("runs"),
    json: JsonOption = None,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask before the first motion.")] = False,
    resume: Annotated[
        Path | None, typer.Option(help="Resume a run after its last completed stage.", metavar="LOG")
    ] = None,
    beyond_attempts: Annotated[
        bool, typer.Option("--beyond-attempts", help="Accept a unit whose attempts are used up.")
    ] = False,
    override_standard: Annotated[
        str | None,
        typer.Option(
            "--override-standard",
            help="Calibrate although a check standard or a certificate is not in order.",
            metavar="REASON",
        ),
    ] = None,
    faults: Annotated[Path | None, typer.Option(help="Virtual bench: plan of faults.", metavar="FILE.toml")] = None,
    operator: Annotated[
        str | None,
        typer.Option(help="Badge of the operator, or a name where nobody signs in; default: the computer's user."),
    ] = None,
    confirmed_by: ConfirmedByOption = None,
) -> None:
    """Calibrate the unit on the station without opening the window."""
    from calstation.cli.confirmation import confirm_override
    from calstation.cli.run import complete_request, run_command
    from calstation.config import RunRequest

    request = RunRequest(
        "",
        station,
        product,
        parsed_stages(stages),
        out,
        operator,
        serials=tuple(serial or ()),
        speed=speed,
        seed=seed,
        resume=resume,
        beyond_attempts=beyond_attempts,
        override_standard=override_standard,
        faults=faults,
    )
    request = complete_request(request)
    if override_standard is not None:
        request = confirm_override(request, confirmed_by)
    raise typer.Exit(run_command(request, json, yes=yes, debug=bool(context.obj)))


@app.command()
def resolve(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Raw log, or CSV beside its TOML.")],
    first: Annotated[int | None, typer.Option("--from", help="First sequence number.", metavar="SEQ")] = None,
    last: Annotated[int | None, typer.Option("--to", help="Last sequence number.", metavar="SEQ")] = None,
    stages: StagesOption = None,
    json: JsonOption = None,
    residuals: Annotated[bool, typer.Option("--residuals", help="Show the residuals of every rest and move.")] = False,
    states: Annotated[
        list[str] | None,
        typer.Option("--state", help="Add an effect to the error model, for a trial; repeatable.", metavar="NAME"),
    ] = None,
    parameters_only: ParametersOnlyOption = False,
) -> None:
    """Solve a stored log again."""
    from calstation.cli.logs import resolve_command

    chosen, added = parsed_stages(stages), states or ()
    diagnostics = not parameters_only
    raise typer.Exit(
        resolve_command(log, chosen, first, last, json, residuals=residuals, states=added, diagnostics=diagnostics)
    )


@app.command(name="import")
def import_(
    source: Annotated[Path, typer.Argument(metavar="FILE", help="CSV or columns of text, also .gz; or a raw capture.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Raw log to write.", metavar="LOG")],
    meta: Annotated[Path | None, typer.Option(help="TOML of the file; default: beside it.")] = None,
    imu: Annotated[
        Path | None,
        typer.Option(help="Decode a raw capture with this IMU profile; file or name.", callback=by_name("imus")),
    ] = None,
    station: Annotated[
        Path | None,
        typer.Option(
            help="Station whose site a capture without [site] has; default: the virtual bench.",
            callback=by_name("stations"),
        ),
    ] = None,
) -> None:
    """Convert a CSV, or a raw capture of an IMU's bytes, to a raw log."""
    from calstation.cli.logs import import_command

    raise typer.Exit(import_command(source, out, meta, imu, station))


@app.command()
def export(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Raw log.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="CSV to write, its TOML beside it.")],
) -> None:
    """Convert a raw log to a CSV and its TOML."""
    from calstation.cli.logs import export_command

    raise typer.Exit(export_command(log, out))


@app.command()
def apply(
    result: Annotated[Path, typer.Argument(metavar="RESULT.json", help="Result of a run or of a log solved again.")],
    log: Annotated[
        Path | None, typer.Argument(metavar="LOG", help="Recording; without one, 10 s of the station's unit.")
    ] = None,
    station: StationOption = None,
    product: ProductOption = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="CSV of the corrected samples to write.", metavar="FILE.csv")
    ] = None,
    json: JsonOption = None,
) -> None:
    """Apply a result to a recording or to the connected unit, and show every rest before and after. Nothing moves."""
    from calstation.cli.apply import apply_command

    raise typer.Exit(apply_command(result, log, station, product, out, json))


@app.command()
def watch(
    log: Annotated[Path | None, typer.Argument(metavar="LOG", help="Log of IMUs on one body.")] = None,
    station: Annotated[
        Path | None,
        typer.Option(help="Watch the IMUs of this station live; file or name.", callback=by_name("stations")),
    ] = None,
    product: ProductOption = None,
    serial: Annotated[str, typer.Option(help="Serial number of a primary that cannot report it.")] = "",
    seconds: Annotated[float | None, typer.Option(min=0.0, help="Live: end after this device time.")] = None,
    json: JsonOption = None,
    folder: Annotated[
        Path | None, typer.Option("--pairs", help="Folder of the stored pairs; default: the site's own.")
    ] = None,
    command: Annotated[bool, typer.Option("--now", help="Check at the first rest, whatever the triggers.")] = False,
    serve: Annotated[
        str | None, typer.Option(help="Serve corrected data to other programs as JSON lines.", metavar="HOST:PORT")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Write the corrected data to this file.", metavar="FILE.jsonl")
    ] = None,
) -> None:
    """Monitor IMUs on one body: check at rest, calibrate if out of tolerance, store. Live: c and Enter to check."""
    from calstation.cli.watch import Delivery, watch_log_command, watch_station_command
    from calstation.config import RunRequest

    if (log is None) == (station is None):
        raise ConfigurationError("cli.log_or_station")
    if log is not None:
        raise typer.Exit(watch_log_command(log, folder, command, json, Delivery(serve, out)))
    request = RunRequest(serial, station, product)
    raise typer.Exit(watch_station_command(request, folder, command, seconds, json, Delivery(serve, out)))


@app.command()
def design(
    out: Annotated[
        Path, typer.Option("-o", "--out", help="Write the product with the schedule to this file.", metavar="FILE.toml")
    ],
    product: ProductOption = None,
    station: StationOption = None,
    margin: Annotated[float, typer.Option(min=0.05, max=1.0, help="Fraction of its limit for every sigma.")] = 0.8,
    duration: Annotated[
        float | None, typer.Option(min=20.0, help="Find the best sigmas for this time of the stage, s.")
    ] = None,
    as_present: Annotated[
        bool, typer.Option("--as-present", help="Reach the sigmas of the present stages, not the limits.")
    ] = False,
    keep_stages: Annotated[
        bool, typer.Option("--keep-stages", help="Shorten the present stages instead of replacing them.")
    ] = False,
    rate: Annotated[float | None, typer.Option(min=1.0, help="Rate of moves, deg/s; default: from the table.")] = None,
    acceleration: Annotated[
        float | None, typer.Option(min=1.0, help="Acceleration of moves, deg/s2; default: from the table.")
    ] = None,
    time_limit: Annotated[float | None, typer.Option(min=1.0, help="Time for the search, s.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the search.")] = 0,
    json: JsonOption = None,
) -> None:
    """Find the shortest schedule that meets the limits of a product. Ctrl-C: the best so far."""
    from calstation.cli.design import design_command, shorten_command
    from calstation.design import DesignRequest

    request = DesignRequest(station, product, margin, duration, as_present, time_limit, seed, rate, acceleration)
    command = shorten_command if keep_stages else design_command
    if duration is not None and as_present:
        raise ConfigurationError("design.one_goal")
    for option, value in (("--duration", duration), ("--time-limit", time_limit)) if keep_stages else ():
        if value is not None:
            raise ConfigurationError("design.with_stages", option=option)
    raise typer.Exit(command(request, product, out, json))


@app.command(name="test")
def try_link(
    device: Annotated[str, typer.Argument(metavar="DEVICE", help="table or imu.")],
    station: StationOption = None,
    product: ProductOption = None,
    json: JsonOption = None,
) -> None:
    """Test a link: open it, identify the device, receive. Nothing moves; exit code 3 if a run would not start."""
    from calstation.cli.devices import link_command

    raise typer.Exit(link_command(device, station, product, json))


@app.command()
def check(
    file: Annotated[
        Path | None,
        typer.Argument(
            metavar="[FILE]",
            help="Station, table, IMU or product file, or its name; a recording; or audit*.jsonl, default the site's.",
        ),
    ] = None,
    json: JsonOption = None,
) -> None:
    """Show all errors in a file, or the contents of a recording and how it can be solved; exit code 2 if invalid."""
    from calstation.cli.audit import check_audit_command
    from calstation.cli.devices import check_command

    if file is None or file.match("audit*.jsonl"):
        raise typer.Exit(check_audit_command(file, json))
    raise typer.Exit(check_command(file, json))


@app.command()
def audit(
    event: Annotated[str | None, typer.Option(help="Only this event, e.g. file_saved.")] = None,
    by: Annotated[str | None, typer.Option(help="Only what this person did or confirmed.")] = None,
    since: Annotated[str | None, typer.Option(help="Only from this day on.", metavar="YYYY-MM-DD")] = None,
    file: Annotated[Path | None, typer.Option(help="Another audit trail than the site's.")] = None,
    json: JsonOption = None,
) -> None:
    """List the audit trail: changed files and PINs, register writes outside runs, released units, certificates."""
    from calstation.cli.audit import audit_command

    raise typer.Exit(audit_command(file, event, by, since, json))


@app.command()
def override(
    result: Annotated[Path, typer.Argument(metavar="RESULT.json", help="Result of a run that failed.")],
    reason: Annotated[str, typer.Option(help="Why the unit may be used although it failed.")],
    by: ByOption = None,
    confirmed_by: ConfirmedByOption = None,
    json: JsonOption = None,
) -> None:
    """Release a unit that failed; the result remains FAIL and states who released it. Asks for PINs."""
    from calstation.cli.confirmation import override_command

    raise typer.Exit(override_command(result, reason, by, confirmed_by, json))


@app.command()
def pin(
    badge: Annotated[str, typer.Option(help="Badge of an engineer; default: the PIN of the site.")] = "",
) -> None:
    """Set or change the site's engineering PIN, or the personal PIN of an engineer."""
    from calstation.cli.confirmation import pin_command

    raise typer.Exit(pin_command(badge))


@app.command()
def report(
    source: Annotated[Path, typer.Argument(metavar="RESULT.json|LOG", help="Result of a run, its log, or any log.")],
    out: Annotated[
        Path,
        typer.Option("-o", "--out", help="PDF to write, or folder for one named after it.", metavar="FILE.pdf"),
    ],
    language: Annotated[str, typer.Option(help="en or zh.")] = "en",
    issued: Annotated[
        str | None, typer.Option(help="Date of issue; default: the day of the result.", metavar="YYYY-MM-DD")
    ] = None,
    received: Annotated[
        str | None, typer.Option(help="Date on which the unit was received.", metavar="YYYY-MM-DD")
    ] = None,
    revise: Annotated[
        str | None, typer.Option(help="Issue the next revision, for this reason.", metavar="REASON")
    ] = None,
    templates: Annotated[
        Path | None, typer.Option(help="Folder with templates in place of the site's.", metavar="DIR")
    ] = None,
    dcc: Annotated[
        Path | None, typer.Option(help="Digital calibration certificate to write besides.", metavar="FILE.xml")
    ] = None,
    sign: Annotated[
        Path | None,
        typer.Option(help="Certificate to sign PDF and XML with.", metavar="FILE.p12"),
    ] = None,
    by: ByOption = None,
    confirmed_by: ConfirmedByOption = None,
) -> None:
    """Write the calibration certificate of a result as a PDF."""
    from calstation.cli.report import report_command

    raise typer.Exit(
        report_command(source, out, language, issued, received, revise, templates, dcc, sign, by, confirmed_by)
    )


app.add_typer(simulation)
app.add_typer(database, name="database")
app.add_typer(fleet, name="fleet")
app.add_typer(quality, name="quality")
app.add_typer(registers, name="registers")
app.add_typer(table, name="table")


def run_app(arguments: list[str]) -> int:
    """Run a command and return the exit code. Errors are shown as one line on standard error."""
    debug = "--debug" in arguments
    arguments = [argument for argument in arguments if argument != "--debug"]
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a redirected Windows console cannot show ≤ or °
            stream.reconfigure(errors="replace")
    try:
        return _run(arguments, debug)
    except (CalstationError, typer.TyperException) as error:
        logger.error("%s: %s", type(error).__name__, error)
        if debug:
            traceback.print_exc()
        from calstation.cli.errors import complain, usage_error

        if not isinstance(error, CalstationError):
            error = usage_error(error, arguments)
        complain(sentence(error.as_text))
        return error.exit_code
    except (typer.Abort, KeyboardInterrupt):
        from calstation.cli.errors import complain

        complain(say("cli.aborted"))
        return 4
    except BrokenPipeError:
        return 2
    except Exception as error:  # last resort: show one line instead of a traceback
        logger.exception("the command ended by a mistake of the program")
        if debug:
            traceback.print_exc()
        from calstation.cli.errors import complain

        complain(say("cli.internal", words=f"{type(error).__name__}: {error}"))
        return 2 if isinstance(error, OSError) else 3


def _run(arguments: list[str], debug: bool) -> int:
    code = app(arguments, prog_name=_NAME, standalone_mode=False, obj=debug)
    return code if isinstance(code, int) else 0
