"""The fault reference lists every fault type, and the tests that it names exist."""

import re
from pathlib import Path

from calstation.simulation.fault_plan import KINDS

ROOT = Path(__file__).parents[2]
MANUAL = (ROOT / "docs" / "reference" / "faults.md").read_text(encoding="utf-8")


def test_reference_lists_every_fault_type() -> None:
    assert [kind for kind in KINDS if f"`{kind}`" not in MANUAL] == []


def test_every_test_named_in_the_reference_exists() -> None:
    named = re.findall(r"`((?:tests/\w+/)?test_\w+\.py)`", MANUAL)
    assert len(named) > 10
    files = [name if "/" in name else f"tests/faults/{name}" for name in named]
    assert [file for file in files if not (ROOT / file).is_file()] == []
