"""Packages use each other through their faces; the layers are contracts of import-linter in pyproject.toml."""

import ast
from collections.abc import Iterator
from pathlib import Path

import calstation

ROOT = Path(calstation.__file__).parents[1]
FILES = {
    ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): file
    for folder in ("calstation", "procedures")
    for file in sorted((ROOT / folder).rglob("*.py"))
}
PACKAGES = {name for name, file in FILES.items() if file.name == "__init__.py"}


def package_of(module: str) -> str:
    return module if module in PACKAGES else module.rpartition(".")[0]


def imported_modules(tree: ast.Module) -> Iterator[str]:
    """Yield every module that is imported anywhere in a file, also as a name of its package."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in FILES)
        elif isinstance(node, ast.ImportFrom) and node.module in FILES:
            yield node.module
            yield from (name for alias in node.names if (name := f"{node.module}.{alias.name}") in FILES)


def trespasses(importer: str, tree: ast.Module, public: dict[str, set[str]]) -> list[str]:
    """Return the modules of other packages that a module imports past their faces.

    A module may import modules of its own package and of the packages that contain it, any package, and a module that
    a face names. The driver of an IMU may import the section of its protocol, a module of the same name, so that a
    protocol need not be added to a face.
    """
    home = package_of(importer)
    section = importer.replace(".imu.drivers.", ".profiles.imu_protocols.")
    return sorted(
        f"{importer} -> {module}"
        for module in imported_modules(tree)
        if module not in PACKAGES
        and not f"{home}.".startswith(f"{package_of(module)}.")
        and module not in public.get(package_of(module), set())
        and package_of(module) != "calstation"
        and module != section
    )


def face(package: str) -> set[str]:
    """Return the modules of a package that its face imports as names, such as `theme`."""
    tree = ast.parse(FILES[package].read_text(encoding="utf-8"))
    return {module for module in imported_modules(tree) if module.rpartition(".")[2] in named(tree)}


def named(tree: ast.Module) -> set[str]:
    return {alias.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for alias in node.names}


def test_packages_use_each_other_through_their_faces() -> None:
    public = {package: face(package) for package in PACKAGES}
    found = []
    for name, file in FILES.items():
        if file.name not in ("__init__.py", "__main__.py"):
            found += trespasses(name, ast.parse(file.read_text(encoding="utf-8")), public)
    assert found == []


def test_import_past_a_face_is_detected() -> None:
    past = "from calstation.records.log import Log\nfrom calstation.records import meta, Check\n"
    expected = ["calstation.runs.run -> calstation.records.log", "calstation.runs.run -> calstation.records.meta"]
    assert trespasses("calstation.runs.run", ast.parse(past), {}) == expected
    assert trespasses("calstation.records.limits", ast.parse(past), {}) == []
    protocols = "calstation.devices.profiles.imu_protocols"
    tree = ast.parse(f"from {protocols}.framed import OPS\nfrom {protocols}.modbus import ModbusProtocol\n")
    assert trespasses("calstation.devices.imu.drivers.framed", tree, {}) == [
        f"calstation.devices.imu.drivers.framed -> {protocols}.modbus"
    ]


def test_every_package_says_what_belongs_in_it() -> None:
    for package in sorted(PACKAGES - {"calstation.database.migrations", "calstation.database.migrations.versions"}):
        assert ast.get_docstring(ast.parse(FILES[package].read_text(encoding="utf-8"))), package
