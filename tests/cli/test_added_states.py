"""`calstation resolve` solves a log with states added to the model of its stages."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from calstation.physics import INDEX, NAMES
from tests.cli.conftest import Done
from tests.estimation.simulated_stages import log_with

SIZE = 300.0  # µg/g³


def test_state_is_added_for_one_solution(calstation: Callable[..., Done], tmp_path: Path) -> None:
    log = tmp_path / "log.h5"
    truth = log_with(log, "six_position", accel_cubic_ug_g3=SIZE)
    held = log.read_bytes()
    done = calstation("resolve", log, "--state", "accel_cubic", "--state", "time_skew", "--json", "-")
    assert "Solved with accel_cubic, time_skew added" in done.err.replace("\n", " ")
    assert done.json["states_added"] == ["accel_cubic", "time_skew"]
    assert all(check["passed"] for check in done.json["checks"])
    found = done.json["parameters"]
    for axis in "xyz":
        row = found[f"accel_cubic_{axis}"]
        assert abs(row["value"] - SIZE * 1e-6 / 9.80665**2) < 5.0 * row["sigma"]
    errors = [(found[n]["value"] - truth.parameters[INDEX[n]]) / found[n]["sigma"] for n in NAMES if n in found]
    assert np.abs(errors).max() < 5.0
    assert log.read_bytes() == held, "nothing is stored"


def test_error_for_an_unknown_state_lists_the_known_states(calstation: Callable[..., Done], tmp_path: Path) -> None:
    done = calstation("resolve", tmp_path / "log.h5", "--state", "accel_cubi")
    assert done.code == 2
    assert "'accel_cubi' is unknown. Choose from g_sensitivity" in done.err
