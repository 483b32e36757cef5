"""Every fragment of the changelog is a sentence of one kind, and the changelog is a list."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FRAGMENTS = sorted((ROOT / "docs" / "changes").iterdir())
NAME = re.compile(r"[a-z0-9-]+\.(added|changed|fixed)\.md")


@pytest.mark.parametrize("fragment", FRAGMENTS, ids=lambda path: path.name)
def test_fragment_is_one_sentence_of_one_kind(fragment: Path) -> None:
    assert NAME.fullmatch(fragment.name)
    (line,) = fragment.read_text(encoding="utf-8").splitlines()
    assert line.endswith(".")
    assert len(line) <= 140


def test_changelog_lists_changes_by_kind_with_the_newest_first() -> None:
    lines = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").splitlines()
    headings = [line for line in lines if line.startswith("#")]
    assert headings[:5] == ["# Changelog", "## Unreleased", "### Added", "### Changed", "### Fixed"]
    start, end = lines.index("### Added"), lines.index("## 0.1.0")
    entries = [line for line in lines[start:end] if line and not line.startswith("#")]
    assert all(line.startswith("- ") and line.endswith(".") and len(line) <= 140 for line in entries)
