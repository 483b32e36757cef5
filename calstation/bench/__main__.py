"""Command `python -m calstation.bench --config FILE_OR_JSON`, which runs a virtual bench and prints its ports."""

import argparse
import os
import sys
from pathlib import Path
from typing import Any

from calstation import applog
from calstation.bench.config import BenchConfig
from calstation.bench.process import serve
from calstation.errors import ConfigurationError
from calstation.parsing import parse_json, parse_toml
from calstation.schema import validate


def read_config(text: str) -> dict[str, Any]:
    """Read the configuration from JSON text, or from a .json or .toml file. Raises ValueError or OSError."""
    path, is_json = Path(text), text.lstrip().startswith("{")
    content = text if is_json else path.read_text(encoding="utf-8")
    values = parse_toml(content) if not is_json and path.suffix == ".toml" else parse_json(content)
    if not isinstance(values, dict):
        raise ValueError("the configuration is not a table of names and values")
    return values


def main() -> int:
    """Run the command; return exit code 0, or 2 if the configuration is not valid."""
    about = "Virtual calibration bench, which prints its ports and runs until its standard input closes."
    parser = argparse.ArgumentParser(prog="calstation.bench", description=about)
    parser.add_argument("--config", default="{}", help="JSON text, or a .json or .toml file")
    argument = parser.parse_args().config
    applog.configure("bench")
    try:
        config = validate(BenchConfig, read_config(argument), "bench configuration")
    except ConfigurationError as exc:
        print(exc, file=sys.stderr)
        return 2
    except (OSError, ValueError) as exc:
        print(f"bench configuration: {exc}", file=sys.stderr)
        return 2
    serve(config)
    sys.stdout.flush()
    # The thread that reads standard input may be blocked, so the process must exit without waiting for it.
    os._exit(0)


if __name__ == "__main__":
    sys.exit(main())
