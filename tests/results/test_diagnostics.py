"""The diagnostics of a result are computed from its log alone and agree with the result."""

from pathlib import Path

import numpy as np
import pytest

from calstation.results import diagnose
from tests.helpers import Progress, ignore_progress
from tests.shared_runs import SharedRuns


@pytest.mark.long
def test_diagnostics_contain_innovations_residuals_and_observability_per_stage(
    tmp_path: Path, shared_runs: SharedRuns
) -> None:
    ended = shared_runs.passed(tmp_path)
    progress = Progress()
    looked = diagnose(progress, Path(ended.log))
    assert looked.serial == "SN-000042"
    assert [s.stage for s in looked.stages] == ["rate", "six_position", "excitation", "azimuth_flip"]
    for stage in looked.stages:
        stored = ended.result["consistency"][stage.stage]
        assert stage.consistency.nis_mean == stored["nis_mean"]
        assert stage.innovations is not None
        if stage.stage in ("excitation", "azimuth_flip"):
            nis = np.sum(stage.innovations.normalised**2, axis=1)
            assert nis.mean() == pytest.approx(stored["nis_mean"], rel=1e-3)
        assert np.all(np.diff(stage.innovations.seq) > 0)
        assert stage.innovations.seq[0] >= stage.first_seq
        assert len(stage.rests) >= 4
    assert looked.stages[3].observability == ended.result["observability"]["azimuth_flip"]
    assert progress.fractions == sorted(progress.fractions)
    assert progress.fractions[-1] < 1.0


@pytest.mark.long
def test_diagnostics_can_be_limited_to_some_stages(tmp_path: Path, shared_runs: SharedRuns) -> None:
    ended = shared_runs.passed(tmp_path)
    looked = diagnose(ignore_progress, Path(ended.log), ("six_position",))
    assert [s.stage for s in looked.stages] == ["six_position"]
