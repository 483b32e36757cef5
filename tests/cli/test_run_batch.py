"""`calstation run` with several units: a serial number per slot, a list of results, the largest exit code."""

import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from calstation.config import library
from tests.site_folder import SiteFolder


def test_units_are_calibrated_together(tmp_path: Path, calstation: Callable[..., Any]) -> None:
    site = SiteFolder(tmp_path)
    site.write({"stages": ["six_position"]}, units=3)
    where = ("run", "--station", site.station, "--product", site.product, "--out", tmp_path / "runs")
    units = ("--serial", "SN-000101", "--serial", "-", "--serial", "SN-000103")
    done = calstation(*where, *units, "--json", "-")
    assert done.code == 0, done.err
    found = [(result["unit"]["serial"], result["slot"], result["outcome"]) for result in done.json]
    assert found == [("SN-000101", "1", "passed"), ("SN-000103", "3", "passed")]
    (batch,) = {result["batch"] for result in done.json}
    assert batch in done.err
    assert "slot 3: six_position: " in done.err


def test_the_exit_code_is_that_of_the_worst_unit(tmp_path: Path, calstation: Callable[..., Any]) -> None:
    site = SiteFolder(tmp_path)
    site.write({"stages": ["six_position"]}, units=2, orders=[{"order": "freeze_channel", "at": 40.0, "unit": 2}])
    where = ("run", "--station", site.station, "--product", site.product, "--out", tmp_path / "runs")
    results = tmp_path / "results.json"
    done = calstation(*where, "--json", results)  # the serial numbers of the bench
    assert done.code == 3, done.err
    found = [(result["unit"]["serial"], result["outcome"]) for result in json.loads(results.read_text())]
    assert sorted(found) == [("SN-000001", "passed"), ("SN-000002", "fault")]
    assert "slot 2: " in done.err
    refused = calstation(*where, *(3 * ("--serial", "SN-000001")))
    assert refused.code == 2
    assert calstation(*where, "--serial", "SN-000001", "--serial", "SN-000001").code == 2


@pytest.fixture
def hardware(tmp_path: Path) -> Path:
    """A station with two slots and no virtual bench."""
    ports = ("/dev/ttyUSB1", "/dev/ttyUSB2")
    data = tomllib.loads(library.find("stations", "virtual_bench").read_text(encoding="utf-8"))
    data = {name: value for name, value in data.items() if name != "bench"}
    data["table"] = {"profile": "bench", "port": "tcp://127.0.0.1:502"}
    data["slots"] = [{"name": name, "port": port} for name, port in zip(("A1", "A2"), ports, strict=True)]
    path = tmp_path / "line.toml"
    path.write_text(tomli_w.dumps(data), encoding="utf-8")
    return path


def test_a_load_without_a_unit_is_refused(tmp_path: Path, hardware: Path, calstation: Callable[..., Any]) -> None:
    empty = ("--serial", "-", "--serial", "-", "--out", tmp_path / "runs")
    for station in (hardware, "virtual_batch", "virtual_bench"):
        refused = calstation("run", "--station", station, *empty)
        assert refused.code == 2
        assert "No slot has a unit. Give the serial number of at least one unit." in refused.err
    missing = calstation("run", "--station", hardware, "--out", tmp_path / "runs")
    assert (missing.code, "--serial is missing" in missing.err) == (2, True)
    assert not (tmp_path / "runs").exists()


def test_a_station_without_slots_takes_one_unit(tmp_path: Path, calstation: Callable[..., Any]) -> None:
    two = ("--serial", "SN-000001", "--serial", "SN-000002", "--out", tmp_path / "runs")
    refused = calstation("run", "--station", "virtual_bench", *two)
    assert refused.code == 2
    assert "The station takes one unit; it has no slots. Give one serial number, or choose" in refused.err
