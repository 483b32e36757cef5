"""Tests outside `tests/gui` are collected on a computer where Qt cannot be used (`tests/without_window.py`)."""

import ast
from pathlib import Path

TESTS = Path(__file__).parent


def imports(file: Path) -> list[str]:
    """Return the modules that a module imports, up to a statement that skips the rest if Qt cannot be used."""
    modules: list[str] = []
    for statement in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(statement, ast.Import):
            modules += [alias.name for alias in statement.names]
        elif isinstance(statement, ast.ImportFrom):
            modules.append(statement.module or "")
        elif "importorskip" in ast.dump(statement):
            break
    return modules


def test_no_module_outside_the_tests_of_the_window_imports_qt() -> None:
    files = [file for file in TESTS.rglob("*.py") if TESTS / "gui" not in file.parents]
    qt = ("PySide6", "calstation.gui")
    assert [file.name for file in files if any(module.startswith(qt) for module in imports(file))] == []
