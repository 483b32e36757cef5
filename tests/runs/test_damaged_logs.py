"""A damaged log of a run: readable samples are solved, exported and plotted, and the gaps are reported."""

import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from calstation.cli.app import run_app
from calstation.errors import InsufficientDataError
from calstation.messages import Text
from calstation.records import export_csv
from calstation.results import resolve
from calstation.results.plots import log_index, samples
from tests.helpers import ignore_progress, raises_code
from tests.shared_runs import SharedRuns

#: Rows on a page of 4 kB.
HURT = 43


@pytest.fixture(scope="module")
def run_log(tmp_path_factory: pytest.TempPathFactory, shared_runs: SharedRuns) -> Path:
    """The log of a run that passed."""
    return Path(shared_runs.passed(tmp_path_factory.mktemp("run"), "rate", "six_position").log)


class Damaged:
    """A copy of the log that can be damaged."""

    def __init__(self, source: Path, folder: Path) -> None:
        self.path = folder / "hurt.h5"
        shutil.copyfile(source, self.path)
        with h5py.File(self.path, "r") as file:
            names = np.array([name.decode() for name in file["stages"][:]])
            rows = file["samples"][:]
        self.seq, self.steps, self.stages = rows["seq"], rows["step"], names[rows["stage"]]

    def damage(self, start: int, count: int = HURT) -> None:
        """Damage rows as a disk error does."""
        with h5py.File(self.path, "r+", libver="latest") as file:
            rows = file["samples"][start : start + count]
            rows["counts"][:, 0] += 1e6
            file["samples"][start : start + count] = rows

    def rest(self, stage: str) -> int:
        """Return a row in the middle of the longest step of a stage."""
        steps = self.steps[self.stages == stage]
        step = int(np.bincount(steps).argmax())
        return int(np.median(np.flatnonzero((self.stages == stage) & (self.steps == step)))) - HURT // 2


@pytest.fixture
def log(run_log: Path, tmp_path: Path) -> Damaged:
    return Damaged(run_log, tmp_path)


@pytest.mark.long
def test_damaged_rows_are_treated_as_a_gap_and_reported(log: Damaged, run_log: Path) -> None:
    row = log.rest("six_position")
    log.damage(row)
    whole, solved = resolve(run_log).result.to_json(), resolve(log.path)
    missing = f"{log.seq[row]}…{log.seq[row + HURT - 1]}"
    assert solved.result.to_json()["log"]["damaged"] == [{"rows": HURT, "seq": missing}]
    assert solved.result.to_json()["log"]["gaps"] == whole["log"]["gaps"] + 1
    assert solved.messages[0] == (
        "log_damaged",
        {"file": "hurt.h5", "rows": HURT, "where": missing},
    )
    for name, parameter in whole["parameters"].items():
        found = solved.result.to_json()["parameters"][name]
        assert abs(found["value"] - parameter["value"]) < 4.0 * found["sigma"]
    assert "damaged" not in whole["log"]


@pytest.mark.long
def test_only_stages_with_missing_samples_are_refused(log: Damaged) -> None:
    rate = np.flatnonzero(log.stages == "rate")
    for row in rate[:: len(rate) // 25]:
        log.damage(int(row), 2)
    with raises_code(InsufficientDataError, "solution.in_log") as refused:
        resolve(log.path, ("rate",))
    in_stage = refused.value.values["what"]
    assert (in_stage.code, in_stage.values["stage"]) == ("solution.in_stage", "rate")
    assert in_stage.values["what"].code == "solve.no_whole_turn"
    assert in_stage.values["what"].values["gaps_note"].code == "solve.gaps_cost_turns"
    solved = resolve(log.path)
    assert (solved.result.to_json()["stages"], list(solved.result.to_json()["lacking"])) == (["six_position"], ["rate"])
    assert solved.missing_data[0].values["stage"] == "rate"
    assert solved.result.to_json()["passed"] is not True
    alone = resolve(log.path, ("six_position",)).result.to_json()
    assert solved.result.to_json()["parameters"] == alone["parameters"]
    assert solved.messages[0][0] == "log_damaged"
    assert str(solved.messages[0][1]["where"]).endswith(", …")


@pytest.mark.long
def test_stage_without_readable_samples_is_not_skipped(log: Damaged) -> None:
    rows = np.flatnonzero(log.stages == "six_position")
    log.damage(int(rows[0]), len(rows))
    with raises_code(InsufficientDataError, "solution.in_log") as refused:
        resolve(log.path)
    assert refused.value.values["what"] == Text.of("solution.stage_damaged", stage="six_position")
    assert resolve(log.path, ("rate",)).result.to_json()["stages"] == ["rate"]


@pytest.mark.long
def test_command_line_reports_missing_samples(log: Damaged, capsys: pytest.CaptureFixture[str]) -> None:
    log.damage(log.rest("six_position"))
    assert run_app(["resolve", str(log.path), "--json", "-"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["log"]["damaged"][0]["rows"] == HURT
    assert f"hurt.h5: {HURT} damaged rows treated as a gap (samples " in " ".join(err.split())
    target = log.path.with_suffix(".csv")
    assert run_app(["export", str(log.path), "-o", str(target)]) == 0
    assert f"{len(log.seq) - HURT} samples, {HURT} damaged rows left out" in " ".join(capsys.readouterr().err.split())


@pytest.mark.long
def test_export_contains_all_readable_samples(log: Damaged) -> None:
    log.damage(log.rest("six_position"))
    target = log.path.with_suffix(".csv")
    assert export_csv(log.path, target).damaged == HURT
    assert resolve(target).result.to_json()["parameters"] == resolve(log.path).result.to_json()["parameters"]


@pytest.mark.long
def test_samples_after_damaged_rows_are_plotted_at_their_time(log: Damaged, tmp_path: Path) -> None:
    row = log.rest("rate")
    log.damage(row)

    seen = log_index(ignore_progress, log.path, tmp_path / "picture")
    assert seen.facts.damaged == HURT
    assert seen.gaps.ranges.tolist() == [[log.seq[row - 1], log.seq[row + HURT]]]
    drawn = samples(ignore_progress, log.path, seen.folder, seen.scale, row - 5, row + 5, 100)
    assert drawn.seq.tolist() == [*log.seq[row - 5 : row], *log.seq[row + HURT : row + HURT + 5]]
