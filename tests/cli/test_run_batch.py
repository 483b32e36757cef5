"""`calstation run` with several units: a serial number per slot, a list of results, the worst exit code."""

import json
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from calstation.cli.run import _show_batch
from calstation.config import RunRequest, library
from calstation.errors import ConfigurationError
from calstation.records import Verdict
from calstation.runs import RunStart
from calstation.sequencer import Finalized
from tests.helpers import raises_code
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
    last = tmp_path / "runs" / done.json[1]["log"]["file"]
    with raises_code(ConfigurationError, "run.ended"):
        RunStart(RunRequest("", site.station, site.product, resume=last), "engineer")
    assert "slot 3: six_position: " in done.err


@pytest.mark.long
def test_exit_code_is_the_code_of_the_worst_unit(tmp_path: Path, calstation: Callable[..., Any]) -> None:
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


def test_batch_that_does_not_start_writes_no_results(tmp_path: Path, calstation: Callable[..., Any]) -> None:
    site = SiteFolder(tmp_path)
    site.write({"stages": ["six_position"]}, units=2)
    (tmp_path / "runs").write_text("no folder")
    done = calstation(
        *("run", "--station", site.station, "--product", site.product, "--out", tmp_path / "runs", "--json", "-")
    )
    assert done.code == 2, done.err
    assert done.out == ""


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


def test_batch_without_units_is_refused(tmp_path: Path, hardware: Path, calstation: Callable[..., Any]) -> None:
    empty = ("--serial", "-", "--serial", "-", "--out", tmp_path / "runs")
    for station in (hardware, "virtual_batch", "virtual_bench"):
        refused = calstation("run", "--station", station, *empty)
        assert refused.code == 2
        assert "No slot has a unit. Give the serial number of at least one unit." in refused.err
    missing = calstation("run", "--station", hardware, "--out", tmp_path / "runs")
    assert (missing.code, "--serial is missing" in missing.err) == (2, True)
    assert not (tmp_path / "runs").exists()


def test_station_without_slots_accepts_only_one_unit(tmp_path: Path, calstation: Callable[..., Any]) -> None:
    two = ("--serial", "SN-000001", "--serial", "SN-000002", "--out", tmp_path / "runs")
    refused = calstation("run", "--station", "virtual_bench", *two)
    assert refused.code == 2
    assert "The station takes one unit; it has no slots. Give one serial number, or choose" in refused.err


def test_registers_commands_require_the_slot_of_the_unit(
    tmp_path: Path, hardware: Path, calstation: Callable[..., Any]
) -> None:
    for what in ("read", "finish", "restore"):
        refused = calstation("registers", what, "SN-000001", "--station", hardware, "--out", tmp_path / "runs")
        assert refused.code == 2
        assert "--slot is missing; " in refused.err
        assert "Give the slot of the unit: A1, A2." in refused.err
    where = ("--station", "virtual_batch", "--out", tmp_path / "runs")
    unknown = calstation("registers", "read", "SN-000003", *where, "--slot", "17")
    assert (unknown.code, "The station has no slot “17”" in unknown.err) == (2, True)
    read = calstation("registers", "read", "SN-000003", *where, "--slot", "3", "--json", "-")
    assert read.code == 0, read.err
    assert read.json["serial"] == "SN-000003"


def verdict(slot: str, outcome: str, seconds: float, **more: Any) -> Finalized:
    """Return the verdict of a unit whose stages took this time."""
    head = {"schema": "calstation.result/1", "unit": {"serial": f"SN-{slot}"}, "log": {"file": f"{slot}.h5"}}
    cycle = [{"phase": "stage", "stage": "rate", "seconds": seconds}]
    result = {**head, "stages": ["rate"], "outcome": outcome, "parameters": {}, "cycle": cycle, "batch": "B1", **more}
    return Finalized(Verdict(outcome), f"runs/{slot}.h5", f"runs/{slot}.json", result, slot=slot)


def test_summary_lists_the_units_of_a_batch(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").mkdir()
    for written_file in ("2.json", "4.json"):
        (tmp_path / "runs" / written_file).touch()
    written = {"registers": {"new": {"gyro_bias_x": 1e-5}, "verified": False}}
    verdicts = (
        verdict("1", "fault", 20.0, error="no answer", **written),
        verdict("2", "stopped", 50.0, stop_reason="operator", advice="resume"),
        verdict("3", "stopped", 40.0, stop_reason="listener_lost"),
        verdict("4", "passed", 45.0, registers={**written["registers"], "verified": True}),
    )
    _show_batch(verdicts, None, RunRequest("SN-1", Path("my line.toml"), serials=("SN-1",)))
    said = " ".join(capsys.readouterr().out.split())
    assert "1 SN-1 FAULT no answer; registers written, not verified" in said
    assert "2 SN-2 STOPPED stopped by the operator 2.json" in said
    assert "3 SN-3 STOPPED the window or terminal that monitored the run has ended" in said
    assert "4 SN-4 PASSED 4.json" in said
    assert "1.json" not in said
    assert said.count("50.0 s") == 2, "the longest cycle, and its stages"
    assert "20.0 s" not in said
    assert said.count("to resume: ") == 1
    assert "to resume: calstation run --resume runs/2.h5 --station 'my line.toml'" in said


@pytest.mark.long
def test_resumed_run_keeps_its_product(tmp_path: Path) -> None:
    site = SiteFolder(tmp_path)
    site.write({"stages": ["six_position"]})
    log = Path(site.run().log)
    request = RunRequest("", site.station, resume=log)
    for product in (None, site.product):
        with raises_code(ConfigurationError, "run.ended" if product else "run.resume_product"):
            RunStart(replace(request, product=product), "engineer")
    folder = library.site_folder() / "products"
    folder.mkdir(parents=True, exist_ok=True)
    kept = folder / site.product.name
    kept.write_text(site.product.read_text(encoding="utf-8"), encoding="utf-8")
    with raises_code(ConfigurationError, "run.ended"):
        RunStart(request, "engineer")
