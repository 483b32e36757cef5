"""The gate of `make coverage` fails if a package is below its limit or was not measured."""

import json
from pathlib import Path

import pytest
from branches import main

LIMITS = "[tool.calstation.coverage]\nrecords = 90\n"


def summary(lines: int, branches: int) -> dict[str, dict[str, int]]:
    row = {"num_statements": 80, "num_branches": 20, "covered_lines": lines, "covered_branches": branches}
    return {"summary": row}


@pytest.mark.parametrize(
    ("files", "code"),
    [
        ({"calstation/records/a.py": summary(80, 20), "calstation/records/b/c.py": summary(70, 10)}, 0),
        ({"calstation/records/a.py": summary(80, 9)}, 1),
        ({"calstation/records_other/a.py": summary(80, 20)}, 1),
        ({}, 1),
    ],
)
def test_package_below_its_limit_fails(files: dict[str, object], code: int, tmp_path: Path) -> None:
    report, project = tmp_path / "report.json", tmp_path / "pyproject.toml"
    report.write_text(json.dumps({"files": files}), encoding="utf-8")
    project.write_text(LIMITS, encoding="utf-8")
    assert main(report, project) == code
