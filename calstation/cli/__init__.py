"""The command line, which shows the events of the engine and sends it commands; `main` is the `calstation` command."""

import sys


def main() -> None:
    """Run the command line and exit with the exit code of the contract."""
    from calstation.cli.process import STOPPED, prepare

    process = prepare()
    code = STOPPED
    try:
        from calstation.cli.app import run_app

        code = run_app(sys.argv[1:])
    except KeyboardInterrupt:  # while an error was shown
        pass
    process.exit(code)
