"""The program `calstation`, which imports the module of a command, runs the command and shows its errors."""

import logging
import os
import subprocess
import sys
import traceback
from collections.abc import Sequence
from importlib import import_module
from keyword import iskeyword
from pkgutil import iter_modules
from typing import Annotated, Any, cast

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from calstation import applog
from calstation.cli import commands
from calstation.cli.process import STOPPED, interruption
from calstation.cli.text import say, sentence
from calstation.errors import CalstationError, ConfigurationError, system_error
from calstation.escaping import surrogates
from calstation.messages import known

_NAME = "calstation"

#: Exit code that Typer returns after Ctrl-C.
_INTERRUPTED = 130

logger = logging.getLogger(__name__)


class _Program(TyperGroup):
    """The program, in which each command is a placeholder until it is called."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        names = (module.name.rstrip("_") for module in iter_modules(commands.__path__))
        self.commands = {name: TyperCommand(name, short_help=say(f"command.{name}")) for name in names}

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Find the command that the arguments name, and import it."""
        name, _, rest = super().resolve_command(ctx, args)
        command = None if name is None else load_command(name)
        if (process := interruption()) is not None:
            process.command_begins()
        return name, command, rest


def load_command(name: str) -> TyperCommand | TyperGroup:
    """Import the module of a command or a group, and return it with its help from the catalogue."""
    module = import_module(f"{commands.__name__}.{name}{'_' * iskeyword(name)}")
    command = cast(TyperCommand | TyperGroup, get_command(module.app))
    _with_help(command, [name])
    return command


def _with_help(command: Any, path: Sequence[str]) -> None:
    """Set the help of a command or group at `path`, of its options and of its commands."""
    command.help = command.short_help = say(f"command.{'_'.join(path)}")
    for parameter in command.params:
        codes = [f"option.{'_'.join((*path[:count], parameter.name))}" for count in range(len(path), -1, -1)]
        parameter.help = say(next(filter(known, codes), codes[0]))
    for name, member in getattr(command, "commands", {}).items():
        _with_help(member, [*path, name])


def _show_version(chosen: bool) -> None:
    if chosen:
        from calstation import __version__  # the import loads importlib.metadata

        sys.stdout.write(f"calstation {__version__}\n")
        raise typer.Exit


app = typer.Typer(cls=_Program, name=_NAME, epilog=say("command.debug"), add_completion=False, rich_markup_mode=None)


@app.callback(invoke_without_command=True, help=say("command.program"))
def _program(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", help=say("option.version_shown"), callback=_show_version, is_eager=True)
    ] = False,
    log_level: Annotated[applog.Level | None, typer.Option(help=say("option.log_level"))] = None,
) -> int | None:
    from calstation.config import site_folder

    window = context.invoked_subcommand is None
    applog.configure("window" if window else "cli", site_folder() / "logs", log_level)
    if not window:
        return None
    screen = screen_size()
    if screen is not None:
        from calstation.gui import main

        return main(screen)
    from calstation.cli.errors import print_error

    print_error(say("cli.no_screen"))
    return _run(["run"], debug=bool(context.obj))


#: Prints the available width and height of the screen. It runs in a separate process, because without a library or a
#: screen Qt aborts the process, and the scale of the window must be known before its application is created.
_SCREEN_SCRIPT = (
    "from PySide6.QtWidgets import QApplication\n"
    "size = QApplication([]).primaryScreen().availableSize()\n"
    "print(size.width(), size.height())"
)


def screen_size() -> tuple[int, int] | None:
    """Return the available width and height of the screen, logical px, or None if no window can be opened."""
    always = sys.platform in ("win32", "darwin")
    if not always and not any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")):
        return None
    command = [sys.executable, "-c", _SCREEN_SCRIPT]
    try:
        probe = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=True)
        width, height = map(int, probe.stdout.split())
    except (subprocess.SubprocessError, ValueError):
        return None
    return width, height


def run_app(arguments: list[str]) -> int:
    """Run a command and return the exit code; an error is shown as one line on standard error."""
    debug = "--debug" in arguments
    arguments = [argument for argument in arguments if argument != "--debug"]
    try:
        code = _run(arguments, debug)
        sys.stdout.flush()
    except BrokenPipeError:
        return 2
    except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001
        return _report(error, arguments, debug)
    return code


def _report(error: BaseException, arguments: list[str], debug: bool) -> int:
    """Show the error that ended a command and return the exit code."""
    from calstation.cli.errors import print_error, usage_error

    process = interruption()
    if isinstance(error, typer.Abort | KeyboardInterrupt) or (process is not None and process.received):
        print_error(say("cli.aborted"))
        return STOPPED
    if debug:
        traceback.print_exception(error)
    if isinstance(error, typer.TyperException):
        error = usage_error(error, arguments)
    if isinstance(error, CalstationError):
        logger.error("%s: %s", type(error).__name__, error)
        print_error(sentence(error.as_text))
        return error.exit_code
    logger.error("%s: %s", type(error).__name__, error, exc_info=error)
    if isinstance(error, OSError) and (known_error := system_error(error)):
        print_error(sentence(known_error.as_text))
        return known_error.exit_code
    print_error(say("cli.internal", words=f"{type(error).__name__}: {error}"))
    return 2 if isinstance(error, OSError) else 3


def _run(arguments: list[str], debug: bool) -> int:
    for argument in arguments:
        if surrogates(argument):
            raise ConfigurationError("cli.not_utf8", argument=argument)
    try:
        code = app(arguments, prog_name=_NAME, standalone_mode=False, obj=debug)
    except SystemExit as exit_:  # Typer exits with 1, the code of a unit outside its limits, if the output was closed
        if isinstance(exit_.__context__, BrokenPipeError):
            raise exit_.__context__ from None
        raise
    if code == _INTERRUPTED:
        raise KeyboardInterrupt
    return code if isinstance(code, int) else 0
