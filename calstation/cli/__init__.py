"""The command line, which shows the events of the engine and sends it commands; `main` is the `calstation` command."""

import sys


def main() -> None:
    """Run the command line and exit with the exit code of the contract."""
    from calstation.cli.app import run_app

    sys.exit(run_app(sys.argv[1:]))
