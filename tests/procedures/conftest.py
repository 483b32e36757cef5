"""Complete chains of simulated stages, one unit per grade, solved once for all tests."""

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import settings

from calstation.bench import BenchConfig
from calstation.bench.truth import Simulator

sys.path.append(str(Path(__file__).parent.parent / "estimation"))

settings.register_profile("procedures", deadline=None)
settings.load_profile("procedures")

STAGES = ("rate", "six_position", "excitation", "azimuth_flip")


@pytest.fixture(scope="session")
def solve_chain():
    """Simulate the four stages of one bench and solve them in sequence."""
    from simulated_stages import block_of, prior_of, simulate, solved

    def chain(grade, seed, **bench):
        truth = BenchConfig(grade=grade, seed=seed, sample_rate_hz=100.0, **bench).truth()
        simulator = Simulator(truth, seed)
        unit = SimpleNamespace(truth=truth, prior=prior_of(truth), samples={}, priors={}, solutions={})
        posterior = unit.prior
        for stage in STAGES:
            unit.samples[stage] = simulate(simulator, truth, stage)
            unit.priors[stage] = posterior
            unit.solutions[stage] = solved(truth, posterior, [block_of(unit.samples[stage])])
            posterior = unit.solutions[stage].posterior
        return unit

    return chain


@pytest.fixture(scope="session")
def nav_chain(solve_chain):
    """A navigation-grade unit with only white noise."""
    return solve_chain("nav", 31, instability=False)


@pytest.fixture(
    scope="session", params=["tactical", *(pytest.param(grade, marks=pytest.mark.long) for grade in ("nav", "mems"))]
)
def chain(request, solve_chain):
    """A unit of each grade with bias instability."""
    return solve_chain(request.param, 31)
