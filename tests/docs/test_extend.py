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
#: Its entries of existing files: path and content.
ADDED = re.findall(r"```toml\n# (\S+), added\n(.*?)```", PAGE, flags=re.DOTALL)
#: A name, or several, in a file: `name` in `file.py`, `name` and `other` of `file.toml`, `name` (`file.py`).
PAIRS = re.compile(r"((?:`[\w.]+`(?:, | and )?)+)(?:(?: in| of) |\s\()`([\w/.-]+\.(?:py|toml))`")

RUN = """
import sys
from importlib import import_module
from calstation.config import library
import calstation
from calstation.devices.profiles import PROTOCOLS
from calstation.messages import catalogue
assert calstation.__file__.startswith(sys.argv[1])
assert set(catalogue.family("protocol")) == {f"protocol.{name}" for name in ("stream", *PROTOCOLS)}
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
    for name, content in ADDED:
        with (tmp_path / name).open("a", encoding="utf-8") as file:
            file.write(content)
    modules = [name.removesuffix(".py").replace("/", ".") for name, _ in FILES if name.startswith("tests/")]
    assert len(modules) == 2
    modules.append("tests.test_architecture")  # the example imports packages through their faces
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
    assert "passed test_packages_use_each_other_through_their_faces" in done.stdout


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


@pytest.mark.parametrize("page", ["how-to/extend.md", "explanation/architecture.md", "explanation/verdict.md"])
def test_a_name_is_in_the_file_that_the_page_states(page: str) -> None:
    text = re.sub(r"```.*?```", "", (ROOT / "docs" / page).read_text(encoding="utf-8"), flags=re.DOTALL)
    pairs = PAIRS.findall(re.sub(r"\s+", " ", text))
    assert len(pairs) > 5
    missing = []
    for names, path in pairs:
        files = [file for file in (ROOT / path, ROOT / "calstation" / path) if file.exists()]
        files = files or [file for base in ("calstation", "tests", "procedures") for file in (ROOT / base).rglob(path)]
        texts = [file.read_text(encoding="utf-8") for file in files]
        for name in re.findall(r"`([\w.]+)`", names):
            if "NAME" not in path and not any(all(part in text for part in name.split(".")) for text in texts):
                missing.append(f"{name} in {path}")
    assert missing == []
