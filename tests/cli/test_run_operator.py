"""`calstation run` asks for the badge of the operator and shows the summary of the cycle."""

import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from tests.site_folder import SiteFolder


def test_run_requires_the_badge_of_its_operator(tmp_path: Path, calstation: Callable[..., Any]) -> None:
    site_folder = SiteFolder(tmp_path)
    site_folder.write({"stages": ["six_position"]})
    station = tomllib.loads(site_folder.station.read_text(encoding="utf-8"))
    sign_in = {"badge_pattern": r"B\d{4}", "names": {"B1234": "Li Na"}}
    site_folder.station.write_text(tomli_w.dumps({**station, "sign_in": sign_in}), encoding="utf-8")
    where = ("run", "--station", site_folder.station, "--product", site_folder.product, "--out", tmp_path / "runs")
    done = calstation(*where, "--json", "-")
    assert done.code == 2
    assert "signs in with a badge. Give the badge with --operator." in done.err
    assert calstation(*where, "--operator", "Li Na").code == 2
    assert not (tmp_path / "runs").exists()
    done = calstation(*where, "--operator", "B1234", "--json", "-")
    assert done.code == 0, done.err
    assert done.json["operator"] == "Li Na"

    found = re.search(r"^Cycle (\S+) s: stages (\S+) s, (.*)\.$", done.err, re.MULTILINE)
    assert found is not None, done.err
    assert "preparation" in found[3]
    seconds = [phase["seconds"] for phase in done.json["cycle"]]
    assert float(found[1]) == pytest.approx(sum(seconds), abs=0.06)
    (stage,) = (phase for phase in done.json["cycle"] if phase["phase"] == "stage")
    assert float(found[2]) == pytest.approx(stage["seconds"], abs=0.06)
