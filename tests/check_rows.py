"""Rows of the checks in a result JSON."""

from typing import Any

from calstation.records import CheckId, CheckKind


def check_row(
    kind: CheckKind, subject: str, value: float, limit: Any, *, passed: bool, unit: str = "", **more: Any
) -> dict[str, Any]:
    """Return a row without margin and near miss; `more` are its other entries."""
    row = {"name": CheckId(kind, subject).name, "kind": kind, "subject": subject, "value": value, "limit": limit}
    return {**row, "unit": unit, "passed": passed, **more}
