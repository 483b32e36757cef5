"""The examples of a calibration within another test sequence run as they stand in the documentation."""

import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.site_folder import SiteFolder

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "test-sequences.md"
EXAMPLES = re.findall(r"```(?:python|sh)\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
PROCESS, PYTEST, OPENHTF = EXAMPLES


@pytest.fixture
def site(tmp_path: Path) -> SiteFolder:
    """A site whose files replace those of the examples by a quick calibration."""
    site = SiteFolder(tmp_path)
    site.write(product={"stages": ["six_position"]})
    for kind, file, name in (
        ("stations", site.station, "virtual_bench"),
        ("products", site.product, "mems_c_fast"),
    ):
        (tmp_path / "home" / kind).mkdir(parents=True)
        file.rename(tmp_path / "home" / kind / f"{name}.toml")
    return site


def run(site: SiteFolder, *command: str) -> subprocess.CompletedProcess[str]:
    tools = site.folder / "bin"
    tools.mkdir()
    program = tools / "calstation"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m calstation "$@"\n', encoding="utf-8")
    program.chmod(0o755)
    environment = {
        **{name: value for name, value in os.environ.items() if not name.startswith("PYTEST")},
        "CALSTATION_HOME": str(site.folder / "home"),
        "PATH": f"{tools}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": os.pathsep.join([str(PAGE.parents[2]), os.environ.get("PYTHONPATH", "")]),
    }
    return subprocess.run(
        command, cwd=site.folder, env=environment, capture_output=True, text=True, check=False, timeout=200
    )


def test_examples_are_short() -> None:
    assert [len(example.splitlines()) < 40 for example in EXAMPLES] == [True] * 3


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="a shell script")
@pytest.mark.parametrize(("serial", "ending"), [("SN-000042", "Passed"), ("no serial", "Error")])
def test_process_and_exit_code(site: SiteFolder, serial: str, ending: str) -> None:
    (site.folder / "step.sh").write_text(PROCESS, encoding="utf-8")
    done = run(site, "sh", "step.sh", serial)
    assert done.stdout.splitlines()[-1] == ending, done.stderr
    assert (site.folder / "result.json").is_file() == (ending == "Passed")


@pytest.mark.long
def test_pytest(site: SiteFolder) -> None:
    (site.folder / "test_calibration.py").write_text(PYTEST, encoding="utf-8")
    done = run(site, sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_calibration.py")
    assert "4 passed" in done.stdout, done.stdout


@pytest.mark.exhaustive
@pytest.mark.skipif(find_spec("openhtf") is None, reason="OpenHTF is not installed")
def test_openhtf(site: SiteFolder) -> None:
    (site.folder / "sequence.py").write_text(OPENHTF, encoding="utf-8")
    done = run(site, sys.executable, "sequence.py")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "PASS" in done.stdout + done.stderr
