"""Speed of a filter pass, absolute and relative to the same filter in plain Python."""

from dataclasses import replace
from time import perf_counter, process_time
from types import SimpleNamespace

import numpy as np
import pytest
from plain_filter import plain_pass

from calstation.estimation.common import filter_noise
from calstation.estimation.navigation import ClosedLoopFilter, ReferencePass, navigation_pass
from calstation.estimation.navigation.stage import LiveFilter
from calstation.results import one_blas_thread

#: Number of samples that both filters process: half a minute with a turn and three rests.
SAMPLE_COUNT = 6000


def project_pass(stage, last, kind):
    """Run a pass of the project's filter over the first `last` samples."""
    run = kind(stage.context, stage.prior, stage.prior.mean)
    start = replace(stage.start, end=last, prior=stage.start.attitude)
    list(run.steps(stage.data, start, start.attitude))
    return run.posterior


def comparison_pass(stage, last):
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
    monkeypatch.setattr(navigation_pass, "GROUP_TIME", 0.1)  # return to the reference after every observation, as the
    # plain filter does
    with one_blas_thread():
        mean, covariance = comparison_pass(stage, SAMPLE_COUNT)
        posterior = project_pass(stage, SAMPLE_COUNT, ClosedLoopFilter)
    sigma = np.sqrt(np.diag(covariance))
    assert len(set(stage.data.step[:SAMPLE_COUNT])) >= 3
    assert posterior.sigma == pytest.approx(sigma, rel=0.01)
    assert np.abs((posterior.mean - mean) / sigma).max() < 0.05
    assert np.min(sigma / stage.prior.sigma) < 0.1


@pytest.mark.parametrize("kind", [ClosedLoopFilter, ReferencePass], ids=["closed loop", "about a smoothed reference"])
def test_speed_of_a_filter_pass_is_measured(stage, benchmark, figures, kind):
    def one_pass():
        run = kind(stage.context, stage.prior, stage.prior.mean)
        list(run.steps(stage.data, stage.start, stage.start.attitude))

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
        project_pass(stage, SAMPLE_COUNT, ReferencePass)
        begin = perf_counter()
        comparison_pass(stage, SAMPLE_COUNT)
        plain = perf_counter() - begin
        benchmark.pedantic(project_pass, args=(stage, SAMPLE_COUNT, ReferencePass), rounds=5)
    ratio = plain / benchmark.stats["min"]
    figures(plain_us_per_sample=round(plain / SAMPLE_COUNT * 1e6, 1), ratio=round(ratio, 1))
    assert ratio > least


def test_live_filters_of_sixteen_units_take_less_than_a_twentieth_of_a_core(stage, benchmark, figures):
    second = round(stage.context.imu.sample_rate)
    blocks = [stage.block.part(first, first + second) for first in range(0, 30 * second, second)]

    def live():
        shown = LiveFilter(stage.context, stage.prior)
        for block in blocks:
            shown.feed(block)
            shown.sigma()

    def cpu_time():
        begin = process_time()  # other processes do not count
        live()
        return process_time() - begin

    with one_blas_thread():
        least = min(cpu_time() for _ in range(6))
        benchmark.pedantic(live, rounds=1)
    share = 16 * least / len(blocks)
    figures(us_per_group=round(least / (2 * len(blocks)) * 1e6), percent_of_a_core=round(100.0 * share, 1))
    assert share < 0.05
