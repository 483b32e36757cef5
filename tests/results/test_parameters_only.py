"""A parameters-only solution equals the full solution bit for bit, without a verdict."""

import json
from pathlib import Path
from typing import Any

import pytest
from synthetic.many_logs import record_logs

from calstation.errors import InputError
from calstation.physics import EffectName
from calstation.records import read_resolves
from calstation.reports.issue import load_source
from calstation.results import resolve, write_json
from calstation.simulation import Kind, make_recording
from tests.estimation.simulated_stages import log_with
from tests.helpers import ignore_progress, raises_code
from tests.shared_runs import SharedRuns

SAME = ("parameters", "correlation", "log", "stages", "configuration_sha256")
#: Keys that only a full result has.
TESTS = {"conformity", "consistency", "observability", "table", "latitude_untold"}


def both(log: Path, *states: EffectName) -> tuple[dict[str, Any], dict[str, Any]]:
    """Solve a log with and without tests; assert equal parameters and return both results as JSON."""
    whole, part = (resolve(log, states=states, diagnostics=tested).result.to_json() for tested in (True, False))
    assert json.dumps([part[key] for key in SAME]) == json.dumps([whole[key] for key in SAME])
    assert part["checks"] == [check for check in whole["checks"] if check["name"].endswith((" within", " sigma below"))]
    assert set(part) - set(whole) == {"tested"}
    assert set(whole) - set(part) <= TESTS
    assert (part["tested"], part["passed"]) == (False, None)
    return whole, part


@pytest.mark.long
def test_four_stages_of_a_run_have_the_same_parameters(tmp_path: Path, shared_runs: SharedRuns) -> None:
    ended = shared_runs.passed(tmp_path)
    whole, part = both(Path(ended.log))
    assert whole["parameters"] == ended.result["parameters"]
    assert whole["passed"]
    assert part["stages"] == ["rate", "six_position", "excitation", "azimuth_flip"]
    assert part["checks"]
    assert TESTS >= set(whole) - set(part) >= {"consistency", "observability", "conformity"}


def test_a_designed_run_has_the_same_parameters(tmp_path: Path) -> None:
    (log,) = record_logs(ignore_progress, tmp_path / "logs", 1, seed=4)
    whole, part = both(log)
    assert part["stages"] == ["designed"]
    assert len(part["parameters"]) == 30
    assert part["checks"]
    assert whole["passed"] is not None
    (full, alone) = read_resolves(log.parent)
    assert (full.tested, alone.tested, alone.passed) == (True, False, None)


@pytest.mark.parametrize(
    "kind", ["gimbal", *(pytest.param(kind, marks=pytest.mark.exhaustive) for kind in ("hand", "pair"))]
)
@pytest.mark.long
def test_methods_without_a_table_have_the_same_parameters(tmp_path: Path, kind: Kind) -> None:
    make_recording(kind, tmp_path / "log.h5", "mems", 3)
    both(tmp_path / "log.h5")


@pytest.mark.long
@pytest.mark.parametrize("stage", ["six_position", "azimuth_flip"])
def test_model_states_are_estimated_in_a_parameters_only_solution(tmp_path: Path, stage: str) -> None:
    log_with(tmp_path / "log.h5", stage, accel_cubic_ug_g3=300.0)
    part = both(tmp_path / "log.h5", "accel_cubic", "g_sensitivity")[1]
    assert "accel_cubic_x" in part["parameters"]


def test_parameters_only_result_gets_no_certificate(tmp_path: Path) -> None:
    log_with(tmp_path / "log.h5", "six_position")
    write_json(tmp_path / "result.json", resolve(tmp_path / "log.h5", diagnostics=False).result.to_json())
    with raises_code(InputError, "report.untested"):
        load_source(ignore_progress, tmp_path / "result.json")
