"""A finished run is loaded from its result or its log, together with earlier values of the unit."""

import json
from pathlib import Path

import pytest

from calstation.errors import InputError
from calstation.records import export_csv
from calstation.results import load_finished_run
from tests.helpers import ignore_progress
from tests.shared_runs import SharedRuns
from tests.site_folder import SiteFolder


@pytest.mark.long
def test_result_and_log_give_the_same_run_with_earlier_values(site_folder: SiteFolder, shared_runs: SharedRuns) -> None:
    runs = site_folder.folder / "runs"
    first = shared_runs.passed(site_folder.folder, "six_position")
    site_folder.write(seed=6)
    second = site_folder.run("six_position")
    by_result = load_finished_run(ignore_progress, Path(second.result_file), runs)
    by_log = load_finished_run(ignore_progress, Path(second.log), runs)
    assert by_result.result.to_json() == by_log.result.to_json() == second.result
    text = (Path(second.result_file)).read_text(encoding="utf-8")
    assert json.dumps(by_result.result.to_json(), indent=1, ensure_ascii=False) + "\n" == text
    assert by_result.log == by_log.log == Path(second.log)
    earlier = {name: row["value"] for name, row in first.result["parameters"].items()}
    assert {name: row.value for name, row in by_result.previous.items()} == earlier
    assert load_finished_run(ignore_progress, Path(first.result_file), runs).previous == {}


@pytest.mark.long
def test_a_log_without_a_result_is_solved(tmp_path: Path, shared_runs: SharedRuns) -> None:
    ended = shared_runs.passed(tmp_path, "six_position")
    csv = tmp_path / "foreign.csv"
    export_csv(Path(ended.log), csv)
    finished = load_finished_run(ignore_progress, csv, tmp_path / "nowhere")
    assert finished.previous == {}
    assert finished.result.to_json()["parameters"] == ended.result["parameters"]


@pytest.mark.long
def test_result_with_a_damaged_or_missing_log_is_shown(site_folder: SiteFolder) -> None:
    ended = site_folder.run("six_position")
    result, runs = Path(ended.result_file), site_folder.folder / "runs"
    labels = load_finished_run(ignore_progress, result, runs).step_labels
    assert [label for label in labels.values() if label[0] == "face_up"][:2] == [("face_up", "+z"), ("face_up", "-z")]
    Path(ended.log).write_bytes(b"x")
    assert load_finished_run(ignore_progress, result, runs).step_labels == {}
    Path(ended.log).unlink()
    assert load_finished_run(ignore_progress, result, runs).log is None


@pytest.mark.parametrize("text", ["{", json.dumps({"schema": "other"}), "[]"])
def test_file_that_is_not_a_result_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "x.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"x\.json: The file is not"):
        load_finished_run(ignore_progress, path, tmp_path)
