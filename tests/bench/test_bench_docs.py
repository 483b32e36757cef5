"""docs/reference/bench.md and docs/reference/faults.md describe every setting, effect, fault command and fault type."""

import re
import subprocess
import sys
from pathlib import Path
from typing import get_args

from calstation.bench import BenchConfig, FaultName
from calstation.bench.truth import Effects
from calstation.simulation.fault_plan import HOST_FAULTS, INITIAL_FAULTS, KINDS

DOCS = Path(__file__).parents[2] / "docs" / "reference"
BENCH, FAULTS = ((DOCS / name).read_text(encoding="utf-8") for name in ("bench.md", "faults.md"))


def rows(text: str) -> str:
    """Return the rows of the tables of a document."""
    return "\n".join(line for line in text.splitlines() if line.startswith("|"))


def test_every_setting_effect_and_fault_command_is_documented() -> None:
    documented = set(re.findall(r"`(\w+)`", rows(BENCH)))
    assert set(BenchConfig.model_fields) <= documented
    assert set(Effects.model_fields) <= documented
    assert set(get_args(FaultName)) <= documented


def test_every_fault_type_is_documented_and_marked() -> None:
    table = rows(FAULTS.split("## One by one")[1])
    marks = dict(re.findall(r"`(\w+)`([¹²]?)", table))
    assert set(KINDS) <= set(marks)
    for kind in KINDS:
        assert marks[kind] == ("¹" if kind in INITIAL_FAULTS else "²" if kind in HOST_FAULTS else ""), kind


def test_misspelled_setting_is_reported_with_the_closest_name() -> None:
    command = [sys.executable, "-m", "calstation.bench", "--config", '{"bench_grade": "mems"}']
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == "bench configuration: bench_grade: The entry is unknown. Did you mean 'grade'?\n"
