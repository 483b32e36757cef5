"""`calstation run` with several units: a serial number per slot, a list of results, the largest exit code."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

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
    assert found == [("SN-000001", "passed"), ("SN-000002", "fault")]  # in the order of the slots
    assert "slot 2: " in done.err
    refused = calstation(*where, *(3 * ("--serial", "SN-000001")))
    assert refused.code == 2
    assert calstation(*where, "--serial", "SN-000001", "--serial", "SN-000001").code == 2


def test_a_batch_that_does_not_start_has_no_results(tmp_path: Path, calstation: Callable[..., Any]) -> None:
    site = SiteFolder(tmp_path)
    site.write({"stages": ["six_position"]}, units=2)
    (tmp_path / "runs").write_text("no folder")
    done = calstation(
        *("run", "--station", site.station, "--product", site.product, "--out", tmp_path / "runs", "--json", "-")
    )
    assert done.code == 2, done.err
    assert done.out == ""
