"""Speed of a filter pass, absolute and relative to the same filter in plain Python."""

from dataclasses import replace
from time import perf_counter
from types import SimpleNamespace

import numpy as np
import pytest
from plain_filter import plain_pass

from calstation.estimation.common.noise import filter_noise
from calstation.estimation.navigation import filter as navigation
from calstation.estimation.navigation.filter import NavigationFilter
from calstation.results.solver_chain import one_blas_thread

#: Samples of the stretch that both filters pass over: half a minute with a turn and three rests.
STRETCH = 6000


def compiled_pass(stage, last):
    """Run the project's filter over the first `last` samples, closed loop."""
    run = NavigationFilter(stage.context, stage.prior, stage.prior.mean)
    start = replace(stage.start, end=last, prior=stage.start.attitude)
    run.run(stage.data, start, start.attitude, smooth=False)
    return run.belief


def reference_pass(stage, last):
    """Run the plain filter over the same samples."""
    return plain_pass(
        stage.context,
        stage.prior,
        stage.data,
        stage.start.attitude,
        stage.start.prior_sigma,
        filter_noise(stage.context),
        stage.start.begin,
        last,
    )


@pytest.mark.long
def test_plain_filter_gives_the_same_solution(stage, monkeypatch):
    monkeypatch.setattr(navigation, "GROUP_TIME", 0.1)  # back to the reference after every observation, as there
    with one_blas_thread():
        mean, covariance = reference_pass(stage, STRETCH)
        belief = compiled_pass(stage, STRETCH)
    sigma = np.sqrt(np.diag(covariance))
    assert len(set(stage.data.step[:STRETCH])) >= 3
    assert belief.sigma == pytest.approx(sigma, rel=0.01)
    assert np.abs((belief.mean - mean) / sigma).max() < 0.05
    assert np.min(sigma / stage.prior.sigma) < 0.1


@pytest.mark.parametrize("smooth", [False, True], ids=["closed loop", "about a smoothed reference"])
def test_speed_of_a_filter_pass_is_measured(stage, benchmark, figures, smooth):
    def one_pass():
        run = NavigationFilter(stage.context, stage.prior, stage.prior.mean)
        run.run(stage.data, stage.start, stage.start.attitude, smooth=smooth)

    with one_blas_thread():
        one_pass()
        benchmark.pedantic(one_pass, rounds=3)
    figures(samples=len(stage.data), samples_per_second=round(len(stage.data) / benchmark.stats["min"]))


@pytest.mark.parametrize(
    ("interval", "least"),
    [(0.1, 60.0), (1.0, 100.0)],
    ids=["20 samples an observation, 200 Hz", "200 samples an observation, as at 2 kHz"],
)
def test_compiled_filter_is_faster_than_a_plain_loop(stage, benchmark, figures, interval, least):
    table = replace(stage.context.table, velocity_interval=interval)
    stage = SimpleNamespace(**{**vars(stage), "context": replace(stage.context, table=table)})
    with one_blas_thread():
        compiled_pass(stage, STRETCH)
        begin = perf_counter()
        reference_pass(stage, STRETCH)
        plain = perf_counter() - begin
        benchmark.pedantic(compiled_pass, args=(stage, STRETCH), rounds=5)
    ratio = plain / benchmark.stats["min"]
    figures(plain_us_per_sample=round(plain / STRETCH * 1e6, 1), ratio=round(ratio, 1))
    assert ratio > least
