"""A short version of `calstation study`: few units, short schedules, all values within bounds."""

import json

import numpy as np
import pytest

from calstation.simulation import run_study
from calstation.simulation.study import CASES
from calstation.simulation.study_table import rms_band

SHORT = {
    "six_position": {"dwell_s": 10.0},
    "excitation": {"dwell_s": 10.0},
    "azimuth_flip": {"dwell_s": 30.0, "rounds": 1},
}


def run(grade: str, seeds: int, *names: str) -> dict:
    cases = tuple(c for c in CASES if c.name in names)
    assert len(cases) == len(names)
    return run_study(grade, seeds, cases=cases, schedules=SHORT, workers=1)


def outside(study: dict) -> list:
    return [
        (row["grade"], row["case"], group, numbers)
        for row in study["rows"]
        for group, numbers in row["groups"].items()
        if not numbers["passed"]
    ]


@pytest.mark.long
@pytest.mark.parametrize(
    ("grade", "seeds", "names"),
    [
        pytest.param("nav", 2, ("full", "full, no outer lever"), marks=pytest.mark.exhaustive),
        ("nav", 5, ("rate", "six_position", "scale factors")),
        pytest.param("nav", 12, ("rate", "six_position", "scale factors"), marks=pytest.mark.exhaustive),
        pytest.param("tactical", 2, ("full", "excitation"), marks=pytest.mark.exhaustive),
        pytest.param("mems", 3, ("full", "azimuth_flip"), marks=pytest.mark.exhaustive),
    ],
)
def test_errors_agree_with_their_sigmas_and_approach_the_cramer_rao_bound(grade, seeds, names):
    study = run(grade, seeds, *names)
    assert outside(study) == []
    for row in study["rows"]:
        assert row["nees"]["passed"], (row["case"], row["nees"])
        assert row["bound_ratio"] <= row["bound_limit"], row["case"]
        for stage, nis in row["nis"].items():
            assert nis["inside"] == 1.0, (row["case"], stage, nis)
    assert json.loads(json.dumps(study)) == study


@pytest.mark.exhaustive
def test_errors_with_modelled_effects_agree_with_their_sigmas():
    (row,) = run("nav", 2, "full, optional states")["rows"]
    assert row["nees"]["passed"], row["nees"]
    assert outside({"rows": [row]}) == []
    assert all(group["cost"] >= 1.0 for group in row["groups"].values())


@pytest.mark.exhaustive
def test_bias_instability_widens_the_bounds_as_predicted():
    study = run("tactical", 2, "excitation, bias instability")
    (row,) = study["rows"]
    assert outside(study) == []
    assert row["groups"]["outer_lever"]["expected"] == pytest.approx(1.0, abs=0.1)
    assert row["groups"]["gyro_bias"]["expected"] != pytest.approx(1.0, abs=1e-3)


def test_rms_bounds_agree_with_correlated_normal_values():
    correlation = np.array([[1.0, 0.9], [0.9, 1.0]])
    draws = np.random.default_rng(1).multivariate_normal(np.zeros(2), correlation, (20_000, 10))
    rms = np.sqrt((draws**2).mean(axis=(1, 2)))
    low, high = rms_band([correlation] * 10)
    assert np.mean(rms < low) < 2e-3
    assert np.mean(rms > high) < 3e-3
