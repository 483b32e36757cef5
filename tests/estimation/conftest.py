"""Simulated stages shared by several tests."""

from types import SimpleNamespace

import pytest
from hypothesis import settings
from simulated_stages import block_of, context_of, prior_of, simulate

from calstation.bench import BenchConfig
from calstation.bench.truth import Simulator

settings.register_profile("estimation", deadline=None)
settings.load_profile("estimation")


@pytest.fixture(scope="session")
def nav_stage():
    """An excitation of a navigation-grade unit with only white noise, as one block at 100 Hz."""
    truth = BenchConfig(grade="nav", seed=21, sample_rate_hz=100.0, instability=False).truth()
    samples = simulate(Simulator(truth, 21), truth, "excitation")
    return SimpleNamespace(
        truth=truth,
        context=context_of(truth),
        prior=prior_of(truth),
        block=block_of(samples),
        samples=samples,
    )
