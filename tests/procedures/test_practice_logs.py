"""The solutions of the practice logs, simulated by independent code, agree with their truth."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from calstation.physics import NAMES
from calstation.records import open_log
from calstation.results import solve

FOLDER = Path(__file__).parents[3] / "shared" / "data" / "practice"


def read(name):
    path = FOLDER / f"{name}.csv.gz"
    if not path.exists():
        pytest.skip(f"{path} is not there: the practice logs are not part of the project")
    log = open_log(path)
    truth = json.loads((FOLDER / f"{name}.truth.json").read_text(encoding="utf-8"))
    return SimpleNamespace(
        meta=log.meta, blocks=list(log.blocks()), truth=np.array([truth[parameter] for parameter in NAMES])
    )


@pytest.fixture(scope="module")
def nav():
    """The navigation-grade log."""
    return read("nav_full")


@pytest.fixture(scope="module")
def mems():
    """The MEMS log: another latitude, another azimuth."""
    return read("mems_full")


def blind(log, keep=lambda block: True):
    """The log without azimuth and encoder angles."""
    meta = log.meta.model_copy(update={"site": log.meta.site.model_copy(update={"azimuth_deg": None})})
    blocks = [replace(b, angles=np.full_like(b.angles, np.nan)) for b in log.blocks if keep(b)]
    return SimpleNamespace(meta=meta, blocks=blocks, truth=log.truth)


def worst(log, chain):
    """Return the largest error in sigma with its parameter."""
    errors = np.abs(chain.posterior.mean - log.truth) / chain.posterior.sigma
    return errors.max(), NAMES[int(errors.argmax())]


@pytest.mark.parametrize("name", [pytest.param("nav", marks=pytest.mark.long), "mems"])
def test_every_parameter_is_within_four_sigma_of_the_truth(name, request):
    log = request.getfixturevalue(name)
    chain = solve(lambda: log.blocks, log.meta)
    assert [s.stage for s in chain.solutions] == ["rate", "six_position", "excitation", "azimuth_flip"]
    assert worst(log, chain) < (4.0, "")
    assert all(s.consistency.passed for s in chain.solutions)
    assert all(s.gaps == 0 for s in chain.solutions)


@pytest.mark.long
def test_solution_without_azimuth_and_encoders_is_as_accurate(nav):
    log = blind(nav)
    chain = solve(lambda: log.blocks, log.meta)
    assert worst(log, chain) < (4.0, "")
    said = {key for solution in chain.solutions for key, _ in solution.messages}
    assert said == {"turns_assumed_whole", "azimuth_from_data", "table_quiet"}


@pytest.mark.long
def test_excitation_is_solved_from_any_attitude_with_unknown_heading(nav):
    # the data begin within the excitation, with the unit on its side and an unknown bias of 100 times earth rate
    log = blind(nav, lambda block: block.stage == "excitation")
    first = int(log.blocks[0].step[0]) + 18
    tail = [b.part(int(b.step.searchsorted(first)), len(b)) for b in log.blocks if b.step[-1] >= first]
    chain = solve(lambda: tail, log.meta, ("excitation",))
    assert abs(tail[0].counts[:1000, 5].mean()) < 0.1 * np.linalg.norm(tail[0].counts[:1000, 3:].mean(axis=0))
    assert worst(log, chain) < (4.0, "")
