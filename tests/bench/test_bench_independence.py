"""The bench shares no equations with the estimators: it may import only the listed names of `calstation.physics`.

An import contract cannot state this, because the package's public names are all imported from the package itself.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

import calstation.bench

SHARED = {
    *("BoolArray", "FloatArray", "IntArray"),
    *("COUNT", "INDEX", "PARAMETERS", "group_indices", "group_matrix", "group_vector"),
    *("Dwell", "Move", "RoundEnd", "Step"),
    "kernel",
}

MODULES = sorted(Path(calstation.bench.__file__).parent.rglob("*.py"))


def imported_from_physics(tree: ast.Module) -> Iterator[str]:
    """Return the names that a module imports from physics, or the full name of an imported module."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.startswith("calstation.physics"))
        elif isinstance(node, ast.ImportFrom):
            names = [alias.name for alias in node.names]
            if node.module == "calstation.physics" and not node.level:
                yield from names
            elif "physics" in (node.module or "").split(".") or "physics" in names:
                yield f"{node.module}: {', '.join(names)}"


def test_the_bench_imports_only_parameter_names_steps_and_array_types_from_physics() -> None:
    found = {str(path): set(imported_from_physics(ast.parse(path.read_text(encoding="utf-8")))) for path in MODULES}
    assert any(found.values())
    assert not {name: more for name, names in found.items() if (more := names - SHARED)}


def test_import_of_an_equation_or_a_physics_module_is_detected() -> None:
    for line in (
        "from calstation.physics import rotation_matrix",
        "from calstation.physics.rotation import rotation_matrix",
        "from calstation import physics",
        "import calstation.physics",
        "import calstation.physics.rotation as rotation",
        "from ...physics import FloatArray",
    ):
        assert not set(imported_from_physics(ast.parse(line))) <= SHARED, line
