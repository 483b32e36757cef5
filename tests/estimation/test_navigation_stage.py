"""The solution of a complete excitation: truth, identical results for any blocks, live sigmas, observability."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from simulated_stages import block_of, context_of, cut, errors_in_sigma, prior_of, simulate, solved, solver_of

from calstation.bench import BenchConfig
from calstation.bench.truth import Simulator
from calstation.errors import InsufficientDataError
from calstation.estimation.common import Posterior, stage_data
from calstation.estimation.navigation import NavigationPass, ReferencePass, relinearise, solve_navigation
from calstation.physics import COUNT, INDEX, NAMES, Dwell
from tests.helpers import raises_code


@pytest.fixture(scope="module")
def solution(nav_stage):
    """The stage solved from one block."""
    return solved(nav_stage.truth, nav_stage.prior, [nav_stage.block])


def test_every_parameter_agrees_with_the_truth_within_its_uncertainty(nav_stage, solution):
    errors = errors_in_sigma(solution.posterior, nav_stage.truth)
    assert np.abs(errors).max() < 4.0
    assert 0.5 < np.sqrt(np.mean(errors**2)) < 1.5
    assert solution.consistency.passed
    assert not solution.consistency.warning
    assert solution.estimated == NAMES


def test_every_sigma_is_much_smaller_than_before(nav_stage, solution):
    assert np.all(solution.posterior.sigma < 0.1 * nav_stage.prior.sigma)


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.long)])
def test_solution_is_bit_identical_for_any_blocks(nav_stage, solution, seed):
    random = np.random.default_rng(seed)
    places = sorted(random.choice(len(nav_stage.block), 300, replace=False).tolist())
    solver = solver_of(nav_stage.truth, nav_stage.prior, "excitation")
    for number, part in enumerate(cut(nav_stage.block, places)):
        solver.feed(part)
        if number % 20 == 0:
            solver.sigma()
    again = solver.finish()
    assert again.posterior.mean.tobytes() == solution.posterior.mean.tobytes()
    assert again.posterior.covariance.tobytes() == solution.posterior.covariance.tobytes()
    assert json.dumps(again.observability) == json.dumps(solution.observability)


def test_live_sigmas_converge_to_the_final_sigmas(nav_stage, solution):
    solver = solver_of(nav_stage.truth, nav_stage.prior, "excitation")
    shown = [solver.sigma()]
    assert np.array_equal(shown[0], nav_stage.prior.sigma)
    for part in cut(nav_stage.block, list(range(1000, len(nav_stage.block), 1000))):
        solver.feed(part)
        shown.append(solver.sigma())
    steps = np.array(shown)[1:] / np.array(shown)[:-1]
    assert steps.max() < 1.001
    assert shown[-1] == pytest.approx(solution.posterior.sigma, rel=0.05)


def test_live_sigmas_survive_a_gap(nav_stage):
    keep = np.ones(len(nav_stage.block), dtype=bool)
    keep[9000:9500] = False
    block = block_of(nav_stage.samples, keep)
    solver = solver_of(nav_stage.truth, nav_stage.prior, "excitation")
    shown = []
    for part in cut(block, list(range(777, len(block), 777))):
        solver.feed(part)
        shown.append(solver.sigma())
    final = solver.finish().posterior.sigma
    assert (np.array(shown)[1:] / np.array(shown)[:-1]).max() < 1.001
    assert shown[-1] == pytest.approx(final, rel=0.1)


def test_fixed_lever_arm_stays_zero_without_loss_of_accuracy():
    truth = BenchConfig(grade="nav", seed=5, sample_rate_hz=100.0, instability=False, outer_lever="fixed").truth()
    prior = prior_of(truth)
    stage = block_of(simulate(Simulator(truth, 5), truth, "excitation"))
    result = solved(truth, prior, [stage])
    lever = [INDEX[f"outer_lever_{a}"] for a in "xyz"]
    assert result.posterior.mean[lever].tolist() == [0.0] * 3
    assert result.posterior.sigma[lever].tolist() == [0.0] * 3
    assert result.estimated == tuple(n for n in NAMES if not n.startswith("outer"))
    assert np.abs(errors_in_sigma(result.posterior, truth)).max() < 4.0
    assert all(result.observability["states"][f"outer_lever_{a}"]["step"] is None for a in "xyz")


@pytest.fixture(scope="module")
def static():
    """Return a stage of one minute at rest."""
    truth = BenchConfig(grade="nav", seed=6, sample_rate_hz=100.0).truth()
    samples = Simulator(truth, 6).run([Dwell(60.0)], "excitation")
    prior = prior_of(truth)
    return truth, prior, solved(truth, prior, [block_of(samples)])


def test_rest_determines_only_parameters_observable_from_gravity_and_earth_rate(static):
    _, prior, result = static
    ratio = dict(zip(NAMES, result.posterior.sigma / prior.sigma, strict=True))
    hidden = {n for n, r in ratio.items() if r > 0.9}
    assert hidden >= {
        *(n for n in NAMES if n.startswith(("gyro_scale", "gyro_misalign", "inner_lever", "outer_lever"))),
        *("gyro_bias_z", "accel_bias_x", "accel_bias_y", "accel_scale_x", "accel_scale_y"),
        *("accel_misalign_yx", "accel_quadratic_x", "accel_quadratic_y"),
    }
    assert ratio["gyro_bias_x"] < 0.5
    assert ratio["gyro_bias_y"] < 0.5


def test_unobservable_parameters_keep_their_prior(static):
    truth, prior, result = static
    assert np.all(result.posterior.sigma <= prior.sigma * (1.0 + 1e-4))
    assert np.abs(errors_in_sigma(result.posterior, truth)).max() < 4.0


def test_stage_without_rest_is_refused(nav_stage):
    turning = np.flatnonzero(nav_stage.block.step == 8)[:120]
    keep = np.zeros(len(nav_stage.block), dtype=bool)
    keep[turning] = True
    with raises_code(InsufficientDataError, "solve.no_rest_to_align") as caught:
        solved(nav_stage.truth, nav_stage.prior, [block_of(nav_stage.samples, keep)])
    assert caught.value.values["seconds"] == pytest.approx(1.2)
    assert caught.value.values["rate"] > 5.0 > caught.value.values["largest_rate"]  # °/s: it turns


def test_stage_without_samples_is_refused(nav_stage):
    with raises_code(InsufficientDataError, "solve.no_rest_to_align") as caught:
        solver_of(nav_stage.truth, nav_stage.prior, "excitation").finish()
    assert caught.value.values["seconds"] == 0.0


@pytest.mark.parametrize(("azimuth", "angles"), [(False, True), (False, False)], ids=["no azimuth", "no encoders"])
def test_unknown_start_attitude_is_found_from_the_data(nav_stage, azimuth, angles, solution):
    context = context_of(nav_stage.truth)
    context = replace(context, site=replace(context.site, azimuth=None))
    block = nav_stage.block if angles else replace(nav_stage.block, angles=np.full_like(nav_stage.block.angles, np.nan))
    result = solved(nav_stage.truth, nav_stage.prior, [block], context)
    assert np.abs(errors_in_sigma(result.posterior, nav_stage.truth)).max() < 4.0
    assert result.consistency.passed
    assert [key for key, _ in result.messages] == ["azimuth_from_data"]
    # after all turns, an unknown start attitude hardly matters
    assert result.posterior.sigma == pytest.approx(solution.posterior.sigma, rel=0.5)


def test_all_passes_linearise_about_the_prior_if_no_parameter_is_estimated(nav_stage, solution):
    known = Posterior(nav_stage.truth.parameters, nav_stage.prior.covariance)
    data = stage_data([nav_stage.block], nav_stage.context.imu)
    output = solve_navigation(data, nav_stage.context, known, np.zeros(COUNT, np.bool_))
    assert output.converged
    np.testing.assert_array_equal(output.point, known.mean)
    assert output.posterior.sigma == pytest.approx(solution.posterior.sigma, rel=0.02)


def passes_of(stage, prior, monkeypatch, fits):
    """Return for each pass whether it used a smoothed reference, and the solution."""
    ways, steps = [], NavigationPass.steps

    def watched(self, *arguments, **others):
        ways.append(isinstance(self, ReferencePass))
        return steps(self, *arguments, **others)

    monkeypatch.setattr(relinearise, "MAX_FIRST_NIS", fits)
    monkeypatch.setattr(NavigationPass, "steps", watched)
    data = stage_data([stage.block], stage.context.imu)
    output = solve_navigation(data, stage.context, prior, np.ones(COUNT, np.bool_))
    monkeypatch.undo()
    return ways, output


def test_consistent_first_pass_is_not_repeated_in_closed_loop(nav_stage, monkeypatch):
    ways, output = passes_of(nav_stage, nav_stage.prior, monkeypatch, relinearise.MAX_FIRST_NIS)
    both_ways, both = passes_of(nav_stage, nav_stage.prior, monkeypatch, 0.0)
    assert ways == [True] * len(ways)
    assert both_ways == [True, False, *ways[1:]]
    # far below the accuracy to which a solution is iterated
    assert np.abs((output.posterior.mean - both.posterior.mean) / both.posterior.sigma).max() < 1e-3


def test_diverged_closed_loop_pass_is_discarded(nav_stage, solution, monkeypatch):
    one_pass = relinearise._Relinearisation.one_pass

    def astray(self, kind, point, output, attitudes):
        run, ends = one_pass(self, kind, point, output, attitudes)
        if kind is ReferencePass:
            return run, ends
        return SimpleNamespace(history=SimpleNamespace(nis=np.array([np.nan]))), ends

    monkeypatch.setattr(relinearise, "MAX_FIRST_NIS", 0.0)
    monkeypatch.setattr(relinearise._Relinearisation, "one_pass", astray)
    data = stage_data([nav_stage.block], nav_stage.context.imu)
    output = solve_navigation(data, nav_stage.context, nav_stage.prior, np.ones(COUNT, np.bool_))
    np.testing.assert_array_equal(output.posterior.mean, solution.posterior.mean)


def test_inconsistent_first_pass_is_repeated_in_closed_loop(nav_stage, monkeypatch):
    wrong = nav_stage.prior.mean.copy()
    wrong[INDEX["gyro_scale_z"]] += 0.05  # a quarter turn ends 4.5° away
    posterior = Posterior(wrong, nav_stage.prior.covariance + np.diag((wrong - nav_stage.prior.mean) ** 2))
    ways, output = passes_of(nav_stage, posterior, monkeypatch, relinearise.MAX_FIRST_NIS)
    assert ways[:3] == [True, False, True]
    assert output.converged
    assert np.abs(errors_in_sigma(output.posterior, nav_stage.truth)).max() < 4.0
