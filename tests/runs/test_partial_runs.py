"""Partial runs start from the current calibration and are as accurate as it allows."""

import json
import shutil
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calstation.bench import BenchConfig
from calstation.cli.app import run_app
from calstation.physics import INDEX
from calstation.records import export_csv, open_log, prior_from_meta
from calstation.results import resolve
from calstation.sequencer import Command, Control, Message, StepStarted
from tests.helpers import convert_log, sampled
from tests.shared_runs import SharedRuns
from tests.site_folder import SiteFolder

GRADES = {"mems_c": "mems", "nav_a": "nav", "tactical_b": "tactical"}
GROUPS = ("azimuth_flip", "rate,six_position", "excitation")


def messages(site_folder: SiteFolder) -> list[str]:
    """Return the messages about the prior."""
    return [m.id for m in site_folder.events_of(Message) if m.id.startswith("prior_")]


@pytest.mark.long
def test_a_partial_run_starts_from_the_current_calibration(site_folder: SiteFolder, shared_runs: SharedRuns) -> None:
    first = shared_runs.passed(site_folder.folder)
    ended = site_folder.run("azimuth_flip")
    result, log = ended.result, open_log(Path(ended.log))
    assert (ended.verdict, result["partial"], messages(site_folder)) == ("partial", True, ["prior_calibration"])
    assert result["registers"]["old"] == first.result["registers"]["new"]
    kept = {name: value for name, value in result["registers"]["new"].items() if "_bias_" not in name}
    assert kept.items() <= first.result["registers"]["new"].items()
    assert result["calibration"]["log"] == Path(first.log).name
    assert log.meta.run is not None
    assert log.meta.run.calibration is not None
    prior, before = prior_from_meta(log.meta), first.result["registers"]["estimate"]
    assert first.result["correlation"] == before["correlation"]  # no registers are applied to the stream
    for name in ("gyro_scale_x", "accel_bias_z"):
        assert prior.mean[INDEX[name]] == before["mean"][name]
        assert before["sigma"][name] < prior.sigma[INDEX[name]] < 1.2 * before["sigma"][name] + 2e-5
        assert result["registers"]["estimate"]["sigma"][name] <= prior.sigma[INDEX[name]] * (1 + 1e-9)
    csv, back = site_folder.folder / "log.csv", site_folder.folder / "back.h5"
    export_csv(log.path, csv)
    convert_log(csv, back)
    for path in (log.path, back):
        assert resolve(path).result.to_json()["parameters"] == result["parameters"]
    begun = next(int(block.seq[0]) for block in log.blocks() if block.stage)
    short = resolve(log.path, last_seq=begun + 2000).result  # ended in the first dwell
    assert short.passed is False
    assert [check.kind for check in short.failed_checks] == ["unobservable"]
    assert short.undetermined == short.unobservable
    assert set(short.unobservable) <= set(short.not_compared)


@pytest.mark.long
def test_unit_with_unknown_registers_starts_from_its_profile(site_folder: SiteFolder, shared_runs: SharedRuns) -> None:
    shared_runs.passed(site_folder.folder)
    shutil.rmtree(site_folder.folder / "runs" / "bench")  # as if another unit had its serial number
    ended = site_folder.run("rate")
    assert messages(site_folder) == ["prior_other_registers"]
    assert "calibration" not in ended.result
    assert not open_log(Path(ended.log)).meta.prior_correlation


@pytest.mark.long
def test_partial_run_of_a_changed_unit_fails(site_folder: SiteFolder, shared_runs: SharedRuns) -> None:
    first = shared_runs.passed(site_folder.folder)
    changed = first.result["parameters"]["gyro_bias_x"]["value"] + 5e-6
    site_folder.write(parameters={"gyro_bias_x": changed})
    ended = site_folder.run("azimuth_flip")
    (changed_since,) = (c for c in ended.result["checks"] if c["name"] == "change since calibration")
    assert (ended.verdict, changed_since["passed"], changed_since["where"]) == ("failed", False, "gyro_bias_x")
    assert changed_since["value"] > 6.0


@pytest.mark.long
def test_re_solving_some_stages_of_a_log_gives_a_partial_result(
    tmp_path: Path, shared_runs: SharedRuns, capsys: pytest.CaptureFixture[str]
) -> None:
    log = shared_runs.passed(tmp_path).log
    assert run_app(["resolve", log, "--stages", "rate,six_position", "--json", str(tmp_path / "some.json")]) == 0
    assert "PARTIAL: rate, six_position within the product's limits" in capsys.readouterr().out
    assert json.loads((tmp_path / "some.json").read_text(encoding="utf-8"))["partial"] is True
    assert run_app(["resolve", log, "--json", str(tmp_path / "all.json")]) == 0
    assert "Within every limit of the product." in capsys.readouterr().out
    assert json.loads((tmp_path / "all.json").read_text(encoding="utf-8"))["partial"] is False


@pytest.mark.long
def test_a_stopped_partial_run_is_resumed_with_its_prior(
    site_folder: SiteFolder, shared_runs: SharedRuns, capsys: pytest.CaptureFixture[str]
) -> None:
    shared_runs.passed(site_folder.folder)
    stages = ("excitation", "azimuth_flip")

    def watch(event: object) -> None:
        if isinstance(event, StepStarted) and event.stage == "azimuth_flip":
            site_folder.control.send(Command.STOP)

    before = site_folder.run(*stages, on_event=watch)
    assert before.verdict == "stopped"
    site_folder.control = Control()
    where = ("--station", site_folder.station, "--product", site_folder.product, "--resume", before.log)
    into = site_folder.folder / "resumed.json"
    assert run_app([str(word) for word in ("run", *where, "--json", into)]) == 0
    assert "PARTIAL: excitation, azimuth_flip within the limits" in capsys.readouterr().out
    done = json.loads(into.read_text(encoding="utf-8"))
    assert done["calibration"]["log"] == before.result["calibration"]["log"]
    old, new = (open_log(Path(log)).meta for log in (before.log, done["log"]["file"]))
    assert (new.prior, new.prior_correlation) == (old.prior, old.prior_correlation)


@pytest.mark.long
def test_partial_run_on_corrected_output_starts_from_the_residual_errors(corrected_site: SiteFolder) -> None:
    first = corrected_site.run()
    corrected_site.events.clear()
    second = corrected_site.run("azimuth_flip")
    assert (first.verdict, second.verdict) == ("passed", "partial")
    assert second.result["registers"]["old"] == first.result["registers"]["new"]
    before, after = (run.result["registers"]["estimate"] for run in (first, second))
    for name, value in after["mean"].items():
        sigma = np.hypot(before["sigma"][name], after["sigma"][name]) + 2e-5
        assert abs(value - before["mean"][name]) < 6.0 * sigma or name.startswith("outer_lever")
    config = {"grade": "nav", "seed": zlib.crc32(b"5 SN-000042"), "after_registers": True}
    truth = BenchConfig.model_validate(config).truth(1).parameters
    errors = [(after["mean"][n] - truth[INDEX[n]]) / after["sigma"][n] for n in second.result["parameters"]]
    assert np.abs(errors).max() < 4.5


def command(folder: Path, product: str, seed: int, stages: str | None = None) -> tuple[int, dict[str, Any]]:
    """Run the command line for a unit; return exit code and result."""
    into = folder / "result.json"
    chosen = ("--stages", stages) if stages else ()
    words = (
        "run",
        "--again",
        "--product",
        product,
        "--serial",
        "S-1",
        "--seed",
        seed,
        "--out",
        folder / "runs",
        *chosen,
    )
    code = run_app([str(word) for word in (*words, "--json", into)])
    return code, json.loads(into.read_text(encoding="utf-8"))


@pytest.mark.exhaustive
@pytest.mark.parametrize("product", GRADES)
@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_each_stage_group_passes_alone_on_a_calibrated_unit(tmp_path: Path, product: str, seed: int) -> None:
    code, result = command(tmp_path, product, seed)
    assert (code, result["partial"]) == (0, False)
    bench = BenchConfig.model_validate({"grade": GRADES[product], "seed": zlib.crc32(f"{seed} S-1".encode())})
    for number, stages in enumerate((*GROUPS, "azimuth_flip"), 1):
        before = result["registers"]["new"]
        code, result = command(tmp_path, product, seed, stages)
        assert code == 0, [check for check in result["checks"] if not check["passed"]]
        assert (result["outcome"], result["partial"]) == ("passed", True)
        assert result["registers"]["old"] == before
        truth = bench.truth(number).parameters
        rows = result["parameters"].items()
        errors = {name: (row["value"] - truth[INDEX[name]]) / row["sigma"] for name, row in rows}
        assert np.abs(list(errors.values())).max() < 4.5, errors
    assert resolve(Path(result["log"]["file"])).result.to_json()["parameters"] == result["parameters"]


@pytest.mark.long
@pytest.mark.parametrize(("product", "stages"), sampled(3, GRADES, GROUPS[:2]))
def test_single_stage_group_fails_on_an_uncalibrated_unit(
    tmp_path: Path, product: str, stages: str, capfd: pytest.CaptureFixture[str]
) -> None:
    code, result = command(tmp_path, product, 1, stages)
    assert (code, result["outcome"]) == (1, "failed")
    failed = [c["name"] for c in result["checks"] if not c["passed"]]
    assert any(name == "unobservable parameters" or name.endswith((" sigma", " sigma below")) for name in failed), (
        failed
    )
    assert result["advice"] == "full_calibration"
    printed = capfd.readouterr()
    assert "no calibration of S-1" in printed.err
    assert "Without a current calibration of the unit" in printed.out
