"""How to extend: the worked example runs in a copy of the program, and all names in the page exist."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "how-to" / "extend.md").read_text(encoding="utf-8")
#: The files of the example: path and content.
FILES = re.findall(r"```(?:python|toml)\n# (\S+)\n(.*?)```", PAGE, flags=re.DOTALL)

RUN = """
import sys
from importlib import import_module
from calstation.config import library
import calstation
assert calstation.__file__.startswith(sys.argv[1])
for name in sys.argv[2:]:
    module = import_module(name)
    for function in [value for key, value in vars(module).items() if key.startswith("test_")]:
        function()
        print("passed", function.__name__)
"""


@pytest.mark.long
def test_method_and_driver_written_from_nothing_run(tmp_path: Path) -> None:
    for package in ("calstation", "procedures", "data"):
        shutil.copytree(
            ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__", "*.nbi", "*.nbc")
        )
    shutil.copytree(ROOT / "tests", tmp_path / "tests", ignore=shutil.ignore_patterns("__pycache__", "gui"))
    for name, content in FILES:
        assert not (ROOT / name).exists(), name
        (tmp_path / name).write_text(content, encoding="utf-8")
    modules = [name.removesuffix(".py").replace("/", ".") for name, _ in FILES if name.startswith("tests/")]
    assert len(modules) == 2
    environment = {**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{tmp_path / 'tests' / 'devices'}"}
    done = subprocess.run(
        [sys.executable, "-c", RUN, str(tmp_path), *modules],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("passed") == 2


def test_every_file_and_name_in_the_page_exists() -> None:
    prose = re.sub(r"```.*?```", "", PAGE, flags=re.DOTALL)
    quoted = set(re.findall(r"`([^`\n]+)`", prose))
    paths = {name for name in quoted if re.fullmatch(r"[\w/.-]+\.(py|toml|md)|[\w/-]+/", name) and "NAME" not in name}
    bases = [ROOT, ROOT / "calstation"]
    names = {file.name for base in ("calstation", "procedures", "tests", "data") for file in (ROOT / base).rglob("*.*")}
    missing = {name for name in paths if not any((base / name).exists() for base in bases)}
    assert sorted(name for name in missing if "/" in name or name not in names) == []
    sources = [file for folder in ("calstation", "procedures", "tests", "data") for file in (ROOT / folder).rglob("*")]
    text = "\n".join(f.read_text("utf-8") for f in [*sources, ROOT / "pyproject.toml"] if f.suffix in (".py", ".toml"))
    words = set(re.findall(r"\w+", text))
    names = {name for name in quoted if re.fullmatch(r"[A-Za-z_]\w*(\.\w+)*", name) and "NAME" not in name}
    unknown = {name for name in names - paths for part in name.split(".") if part not in words}
    assert sorted(unknown - {"Makefile", "about_FIELD"}) == []
