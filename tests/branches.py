"""Print the lines and branches of each package that the tests of `make coverage` reach, and fail below the limits.

The limits are in pyproject.toml.
"""

import json
import sys
import tomllib
from collections import Counter
from pathlib import Path
from typing import Any


def reached(files: dict[str, Any]) -> dict[str, float]:
    """Return the reached part of lines and branches, %, by package of calstation, from a report of coverage.py."""
    found, possible = Counter[str](), Counter[str]()
    for name, report in files.items():
        package, summary = Path(name).parts[1], report["summary"]
        found[package] += summary["covered_lines"] + summary["covered_branches"]
        possible[package] += summary["num_statements"] + summary["num_branches"]
    return {package: 100.0 * found[package] / possible[package] for package in possible}


def main(report: Path, project: Path = Path("pyproject.toml")) -> int:
    """Print a row for each package with a limit, and return 1 if one is below it."""
    limits = tomllib.loads(project.read_text("utf-8"))["tool"]["calstation"]["coverage"]
    values = reached(json.loads(report.read_text("utf-8"))["files"])
    for package, limit in limits.items():
        value = values.get(package, 0.0)
        sys.stdout.write(f"{package:12} {value:5.1f} % (at least {limit} %){'' if value >= limit else ': too low'}\n")
    return int(any(values.get(package, 0.0) < limit for package, limit in limits.items()))


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
