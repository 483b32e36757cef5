"""The schedule search on a small problem: a MEMS unit with some of its limits."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from calstation.config import RunRequest, library, load_configuration
from calstation.designer.search import (
    Beam,
    Exchange,
    Front,
    Problem,
    Stop,
    durations,
    remaining_log_ratio,
    shortest_walk,
    states,
)
from calstation.designer.segments import Conditions, SegmentLibrary
from calstation.estimation.effects import drifts_before_end
from calstation.physics import NAMES
from calstation.records import context_from_meta, prior_from_meta
from calstation.results import one_blas_thread

#: Turns of a joint that the small problem allows.
TURNS = (-4, -2, 0, 2, 4)


@pytest.fixture(scope="module")
def problem():
    with one_blas_thread():
        yield small_problem()


def small_problem(effects=()):
    """Return the problem; with effects, of which the error of every parameter must stay within its limit."""
    product = library.find("products", "mems_c")
    setup = load_configuration(RunRequest("M-1", None, product, ("designed",), Path("nowhere")))
    meta = setup.log_meta()
    context = context_from_meta(meta)
    mount = np.full(3, 0.3 * context.table.mount_sigma)
    conditions = Conditions(context, prior_from_meta(meta), 0.5, 1.7, 2.6, mount, effects)
    limits = setup.sigma_limits()
    targets = np.array([limits[n] if n.startswith("gyro_misalign") else np.inf for n in NAMES])
    count = sum(len(effect.components) for effect in effects)
    required = np.full(count, np.inf), np.outer([limits[n] for n in NAMES], np.ones(count))
    return Problem(SegmentLibrary(conditions), targets, (-4, -4), (4, 4), TURNS, 1.0, 0, 0, *required)


def run_search(problem, width=4, longest=40.0, front=None):
    *_, (seconds, stops) = Beam(problem, width, longest, front).run()
    return seconds, stops


def ratios(problem, stops):
    return problem.ratios(states(problem.library, stops)[-1][None])[0]


@pytest.mark.long
def test_beam_search_is_reproducible_and_respects_travel_and_targets(problem):
    front = Front()
    seconds, stops = run_search(problem, front=front)
    assert (seconds, stops) == run_search(problem)
    assert seconds == pytest.approx(durations(problem.library, stops)[-1])
    assert ratios(problem, stops).max() <= 1.0
    assert all(problem.allowed(stop.position) for stop in stops)
    for a, b in pairwise(stops):
        assert b.position in problem.next_positions(a.position)
    times, worst = np.array([point[:2] for point in front.points()]).T
    assert (np.diff(times) > 0.0).all()
    assert (np.diff(worst) < 0.0).all()


@pytest.mark.long
def test_exchange_search_keeps_a_solution_and_shortens_a_poor_one(problem):
    _, stops = run_search(problem)
    poor = (*stops[:-1], replace(stops[-1], rest=stops[-1].rest + 20))
    exchange = Exchange(problem, poor, seed=3)
    shares = list(exchange.run(20))
    assert shares[-1] == 1.0
    assert exchange.reached
    assert exchange.time < durations(problem.library, poor)[-1]
    assert exchange.time == pytest.approx(durations(problem.library, exchange.best)[-1])
    assert ratios(problem, exchange.best).max() <= 1.0
    again = Exchange(problem, poor, seed=3)
    list(again.run(20))
    assert again.best == exchange.best


@pytest.mark.long
def test_exchange_search_may_extend_a_schedule_that_misses_the_targets(problem):
    _, stops = run_search(problem)
    tighter = replace(problem, targets=0.9 * problem.targets)
    limited, free = (Exchange(tighter, stops, seed=3, longest=longest) for longest in (None, np.inf))
    for exchange in (limited, free):
        list(exchange.run(40))
    assert free.reached
    assert free.time > durations(problem.library, stops)[-1] > 0.0
    assert ratios(tighter, free.best).max() <= 1.0
    assert not limited.reached or limited.time <= durations(problem.library, stops)[-1]


def test_drift_of_a_scale_factor_shows_if_its_axis_turns_early_and_late():
    drift = next(effect for effect in drifts_before_end() if effect.parameters[2] == "gyro_scale_z")
    with one_blas_thread():
        problem = small_problem((drift,))
        ends = ((0, 0), 12), ((0, 4), 2), ((0, 0), 2), ((2, 0), 2)
        late = ((0, 0), 2), ((0, 4), 2), ((0, 0), 2)
        once, both = (
            ratios(problem, tuple(Stop(*stop) for stop in stops))[-1]
            for stops in ((*ends, ((0, 0), 30)), (*ends, *late))
        )
    assert both < 0.2 * once


@pytest.mark.long
def test_schedule_is_extended_from_its_end(problem):
    seconds, stops = run_search(problem)
    tighter = replace(problem, targets=0.8 * problem.targets)
    before = stops, states(problem.library, stops)[-1], seconds
    *_, (longer, more) = Beam(tighter, 4, 80.0).run(before)
    assert more[: len(stops) - 1] == stops[:-1]
    assert more[len(stops) - 1].position == stops[-1].position
    assert longer == pytest.approx(durations(problem.library, more)[-1])
    assert ratios(tighter, more).max() <= 1.0


def test_unreachable_targets_are_reported_with_the_achievable_ratios(problem):
    result, shown = shortest_walk(problem, 0)
    assert result is not None
    assert shown.max() <= 1.0
    assert ratios(problem, result) == pytest.approx(shown, rel=1e-3)
    none, left = shortest_walk(replace(problem, targets=1e-3 * problem.targets), 0)
    assert none is None
    assert left.max() > 1.0


def test_search_handles_travel_shorter_than_a_quarter_turn(problem):
    eighth = replace(problem, low=(-1, -1), high=(1, 1), turns=(-1, 0, 1), targets=1e-6 * problem.targets)
    result, left = shortest_walk(eighth, 0)
    assert result is None
    assert np.isfinite(left).all()


def test_missing_information_counts_only_sigmas_above_their_targets():
    assert remaining_log_ratio(np.array([[0.5, 1.0, np.e], [0.0, 0.1, 0.2]])) == pytest.approx([1.0, 0.0])


def test_moves_beyond_the_table_travel_are_not_tried(problem):
    assert not problem.allowed((6, 0))
    assert all(abs(outer) <= 4 and abs(inner) <= 4 for outer, inner in problem.next_positions((4, -4)))
    assert Stop((0, 0), 1).position not in list(problem.next_positions((0, 0)))
