"""The command line: shows events and sends commands; `main` is the `calstation` command."""

import sys


def main() -> None:
    """Run the command line and leave with the contract's exit code."""
    from calstation.cli.app import run_app

    sys.exit(run_app(sys.argv[1:]))
