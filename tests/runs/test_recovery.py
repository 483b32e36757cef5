"""Recovery of missing results, and runs beside files of other programs and other runs of the same unit."""

import json
import os
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from calstation.cli.run import _show_run
from calstation.config import RunRequest
from calstation.records import open_log
from calstation.results import History, ended_result
from calstation.runs import finish_incomplete
from calstation.runs.preparation import prepare
from calstation.sequencer import Control
from tests.shared_runs import SharedRuns
from tests.site_folder import SiteFolder


def test_result_of_a_closed_log_is_restored_and_handed_over(tmp_path: Path, shared_runs: SharedRuns) -> None:
    ended = shared_runs.passed(tmp_path, "six_position")
    result, runs = Path(ended.result_file), Path(ended.log).parent
    stored = result.read_bytes()
    result.unlink()
    assert finish_incomplete(runs) == [], "it did not die"
    assert json.loads(result.read_bytes()) == json.loads(stored)
    assert (runs / ".handover" / result.stem).exists()
    assert ended_result(open_log(Path(ended.log))) is not None


def test_copy_of_a_log_gets_no_result(tmp_path: Path, shared_runs: SharedRuns) -> None:
    ended = shared_runs.passed(tmp_path, "six_position")
    copy = Path(ended.log).with_name("copy.h5")
    Path(ended.log).rename(copy)
    assert finish_incomplete(copy.parent) == []
    assert not copy.with_suffix(".json").exists()


def test_result_that_could_not_be_written_is_not_shown(
    tmp_path: Path, shared_runs: SharedRuns, capsys: pytest.CaptureFixture[str]
) -> None:
    ended = shared_runs.passed(tmp_path, "six_position")
    for exists in (True, False):
        _show_run(ended, None, RunRequest(""))
        assert (ended.result_file in capsys.readouterr().out.replace("\n", "")) == exists
        Path(ended.result_file).unlink(missing_ok=True)


@pytest.mark.timeout(60)
@pytest.mark.skipif(sys.platform == "win32", reason="there are no pipes in folders")
def test_files_of_other_programs_do_not_disturb_runs(tmp_path: Path, shared_runs: SharedRuns) -> None:
    ended = shared_runs.passed(tmp_path, "six_position")
    runs = Path(ended.log).parent
    os.mkfifo(tmp_path / "pipe")
    for name in ("a.h5", "b.json"):
        (runs / name).symlink_to(tmp_path / "pipe")
    (runs / "c.h5").symlink_to(runs / "removed.h5")
    (runs / "d.json").symlink_to(runs / "removed.json")
    (runs / "e.h5").mkdir()
    for number, meta in enumerate((None, 1.0, "text", np.zeros((2, 2)), np.zeros(3, complex))):
        copy = runs / f"malformed-{number}.h5"
        copy.write_bytes(Path(ended.log).read_bytes())
        with h5py.File(copy, "r+") as file:
            for dataset in ("meta", "events", "samples"):
                del file[dataset]
                file.create_group(dataset) if meta is None else file.create_dataset(dataset, data=meta)
    assert finish_incomplete(runs) == []
    History(runs).refresh()
    assert [run.log.name for run in History(runs).runs()] == [Path(ended.log).name]


def test_simultaneous_runs_of_a_unit_are_different_attempts(tmp_path: Path) -> None:
    site = SiteFolder(tmp_path)
    (first,), (second,) = (prepare(site.request(), lambda event: None, Control()) for _ in range(2))
    runs = [unit.open(None) for unit in (first, second)]
    assert [run.meta.run.attempt for run in runs if run.meta.run] == [1, 2]
    for run in runs:
        run.log.close("stopped")
