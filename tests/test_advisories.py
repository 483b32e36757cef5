"""The audit of packages finds versions that an advisory affects, and refuses a folder without advisories."""

from pathlib import Path

import pytest
from audit import main, vulnerabilities

ADVISORY = """
id: PYSEC-2026-1
{more}
affected:
- package: {{ecosystem: PyPI, name: numpy}}
  ranges:
  - type: GIT
    events: [{{introduced: "0"}}]
  - type: ECOSYSTEM
    events: {events}
  versions: ["1.9"]
"""
RANGE = "[{introduced: '2.0'}, {fixed: '2.4.7'}, {introduced: '3.0'}, {last_affected: '3.2'}]"


@pytest.mark.parametrize(
    ("version", "affected"),
    [
        ("1.9", True), ("1.10", False), ("2.0", True), ("2.4.6", True), ("2.4.7", False), ("2.10", False),
        ("3.0", True), ("3.2", True), ("3.2.1", False),
    ],
)  # fmt: skip
def test_version_in_a_range_or_list_is_affected(version: str, affected: bool, tmp_path: Path) -> None:
    (tmp_path / "vulns" / "numpy").mkdir(parents=True)
    path = tmp_path / "vulns" / "numpy" / "PYSEC-2026-1.yaml"
    path.write_text(ADVISORY.format(events=RANGE, more=""), encoding="utf-8")
    packages = {"numpy": version, "scipy": "1.17.1"}
    assert [*vulnerabilities(tmp_path, packages)] == [("numpy", "PYSEC-2026-1")] * affected
    path.write_text(ADVISORY.format(events=RANGE, more="withdrawn: 2026-01-01"), encoding="utf-8")
    assert [*vulnerabilities(tmp_path, packages)] == []


def test_folder_without_advisories_is_refused(tmp_path: Path) -> None:
    assert main([str(tmp_path)]) == 2
