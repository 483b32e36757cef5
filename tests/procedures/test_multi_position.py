"""Multi-position method: manual recordings give matrices and biases with consistent sigmas."""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import real_recordings as real
from hand_recordings import QUICK, context_of, prior_of, recording, solved, unit
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from simulated_stages import block_of, geometry_of, with_effect
from simulated_stages import context_of as table_context
from simulated_stages import prior_of as table_prior

from calstation.bench import BenchConfig
from calstation.bench.truth import Simulator
from calstation.errors import ConfigurationError, InputError, InsufficientDataError
from calstation.estimation import Solution
from calstation.estimation.common import Posterior, SampleBlock, find_stillness, stage_data
from calstation.estimation.effects import MAX_EXCESS, EffectEvidence, EffectTests
from calstation.estimation.positions import fit_positions, valid_links
from calstation.physics import (
    EFFECTS,
    INDEX,
    NAMES,
    Dwell,
    JointLimits,
    ManualMove,
    Move,
    TableGeometry,
    group_indices,
    group_matrix,
    group_vector,
)
from calstation.results import resolve
from procedures import method, multi_position
from procedures.multi_position import ESTIMATED, GROUPS
from tests.helpers import raises_code

MASK = np.array([name in ESTIMATED for name in NAMES])


@pytest.fixture(scope="module")
def mems():
    imu = unit("mems", 3)
    return imu, recording(imu, 3)


@pytest.mark.long
@pytest.mark.parametrize(
    ("grade", "seeds"),
    [
        pytest.param("mems", 8, marks=pytest.mark.exhaustive),
        ("tactical", 4),
        pytest.param("nav", 4, marks=pytest.mark.exhaustive),
    ],
)
def test_errors_of_many_recordings_agree_with_their_sigmas(grade, seeds):
    errors, nees = [], []
    for seed in range(seeds):
        imu = unit(grade, 100 + seed)
        output = solved(recording(imu, seed), context_of(imu), prior_of(grade)).posterior
        error = (output.mean - imu.parameters)[MASK]
        errors.append(error / output.sigma[MASK])
        nees.append(error @ np.linalg.solve(output.covariance[np.ix_(MASK, MASK)], error))
    for group in GROUPS:
        columns = [k for k, name in enumerate(ESTIMATED) if name.rpartition("_")[0] == group]
        # a wider interval, because the axes of a group are correlated: all are observed by the same gravity
        low, high = chi2.ppf([0.0005, 0.9995], 1.5 * seeds) / (1.5 * seeds)
        assert low < np.mean(np.square(np.array(errors)[:, columns])) < high, group
    low, high = chi2.ppf([0.0005, 0.9995], MASK.sum() * seeds)
    assert low < np.sum(nees) < high


@pytest.mark.exhaustive
@pytest.mark.parametrize("sigma", [1e6, 2.0**63])
def test_an_absurd_sigma_of_the_prior_leaves_the_covariance_positive(mems, sigma, monkeypatch):
    monkeypatch.setattr(multi_position, "MAX_TURN_SCATTER", np.inf)  # the solution is nonsense and would be refused
    imu, block = mems
    prior = prior_of("mems")
    correlation = np.eye(len(NAMES))
    correlation[0, 1:3] = correlation[1:3, 0] = 0.5
    sigmas = np.where(np.arange(len(NAMES)) == 0, sigma, prior.sigma)
    covariance = correlation * np.outer(sigmas, sigmas)
    posterior = solved(block, context_of(imu), Posterior(prior.mean, covariance)).posterior
    assert np.isfinite(posterior.mean).all()
    assert (np.diag(posterior.covariance) >= 0.0).all()


def test_every_sigma_is_much_smaller_than_the_prior(mems):
    imu, block = mems
    prior = prior_of("mems")
    output = solved(block, context_of(imu), prior)
    assert np.all(output.posterior.sigma[MASK] < 0.1 * prior.sigma[MASK])
    assert np.array_equal(output.posterior.mean[~MASK], prior.mean[~MASK])
    assert output.consistency.passed
    assert output.messages == ()
    assert len(output.details["positions"]) == len(output.details["motions"]) + 1


@pytest.mark.long
def test_uncalibrated_stream_may_have_large_biases(mems):
    imu, _ = mems
    far = imu.parameters.copy()
    far[group_indices("gyro_bias")] = [0.05, -0.08, 0.06]
    far[group_indices("accel_bias")] = [0.9, -1.2, 0.7]
    worse = replace(imu, parameters=far)
    wide = prior_of("mems").sigma
    wide[group_indices("gyro_bias")], wide[group_indices("accel_bias")] = 0.1, 2.0
    prior = replace(prior_of("mems"), covariance=np.diag(wide**2))
    output = solved(recording(worse, 5), context_of(worse), prior).posterior
    assert np.abs((output.mean - far) / output.sigma)[MASK].max() < 4.5


@pytest.mark.long
def test_noise_above_the_profile_enlarges_the_sigmas(mems):
    imu, _ = mems
    rough = replace(QUICK, velocity_sigma=8e-3)
    context = context_of(imu)
    quiet = replace(
        context,
        imu=replace(context.imu, gyro_arw=0.2 * imu.gyro_arw, gyro_bias_instability=0.0, accel_bias_instability=0.0),
    )
    output = solved(recording(imu, 6, rough), quiet, prior_of("mems"))
    assert np.abs((output.posterior.mean - imu.parameters) / output.posterior.sigma)[MASK].max() < 5.0
    assert [key for key, _ in output.messages] == ["noisier_than_profile"]
    assert output.details["scatter"]["force"] > 1e-3
    assert output.consistency.passed


#: An octant between positions: with a sextant, the fourth power of a cosine looks like its square.
OCTANT = np.deg2rad(45.0)


@pytest.mark.parametrize(
    ("cause", "size", "component"),
    [
        pytest.param("accel_cubic", 1e-5, 1, marks=pytest.mark.long),
        pytest.param("g_sensitivity", 2e-5, 1, marks=pytest.mark.exhaustive),
        pytest.param("gyro_cubic", 1e-3, 0, marks=pytest.mark.exhaustive),
    ],
)
def test_unmodelled_effect_that_resembles_noise_is_reported(mems, cause, size, component):
    imu, _ = mems
    prior, context = prior_of("mems"), context_of(imu)
    recorded = recording(imu, 5, step=OCTANT)
    sound, output = (
        solved(block, context, prior)
        for block in (recorded, with_effect(recorded, context, imu.parameters, cause, size, component))
    )
    assert not effects_of(sound, prior)
    assert tuple(key for key, _ in output.messages) == ("noisier_than_profile",)
    (first, *_) = effects_of(output, prior)
    assert first.cause == cause
    assert first.size == pytest.approx(size, abs=4.5 * first.sigma)
    changed = (output.posterior.mean - sound.posterior.mean) / output.posterior.sigma
    worst = max(first.parameter_shift, key=lambda name: abs(first.parameter_shift[name]))
    assert changed[INDEX[worst]] == pytest.approx(
        first.parameter_shift[worst], abs=1.0 + 0.1 * abs(first.parameter_shift[worst])
    )


def test_drift_during_the_recording_is_reported(mems):
    imu, recorded = mems
    prior, context = prior_of("mems"), context_of(imu)
    counts = recorded.counts.astype(np.float64)
    course = np.linspace(0.0, np.deg2rad(100.0) / 3600.0, len(counts))
    counts[:, 1] += course / (context.imu.gyro_lsb * context.imu.rate_factor)
    first = effects_of(solved(replace(recorded, counts=counts), context, prior), prior)[0]
    assert (first.cause, first.parameter) == ("drift_throughout", "gyro_bias_y")


def effects_of(solution: Solution, prior: Posterior) -> list[EffectEvidence]:
    """Return the effects found in a solution, the most significant first."""
    tests = EffectTests(prior.sigma)
    tests.add(solution.stage, solution.sensitivity, solution.estimated)
    return [output for output in tests.evidence(solution.posterior) if output.excess > MAX_EXCESS]


def test_plan_also_runs_on_a_motorised_table():
    truth = BenchConfig(grade="tactical", seed=8, sample_rate_hz=100.0, instability=False).truth()
    chosen = method("multi_position")
    schedule = chosen.schedule(step_deg=90.0, rest_s=4.0, initial_rest_s=5.0, rate_dps=60.0, acceleration_dps2=60.0)
    samples = Simulator(truth, 8).run(chosen.plan(geometry_of(truth), schedule), "multi_position")
    solver = chosen.solver(table_context(truth), table_prior(truth), schedule)
    solver.feed(block_of(samples))
    output = solver.finish()
    assert np.abs((output.posterior.mean - truth.parameters) / output.posterior.sigma)[MASK].max() < 4.5
    assert np.all(output.posterior.sigma[MASK] < 0.2 * table_prior(truth).sigma[MASK])
    assert (
        len(output.details["positions"])
        == 1 + sum(isinstance(s, Dwell) for s in chosen.plan(geometry_of(truth), schedule)) - 1
    )


def test_plan_covers_full_turns_in_both_directions_about_every_body_axis():
    geometry = TableGeometry(inner_axis=(0.0, 1.0, 0.0))
    chosen = method("multi_position")
    steps = list(chosen.plan(geometry, chosen.schedule()))
    assert isinstance(steps[1], Dwell)
    assert steps[1].duration == 30.0
    poses = [(s.outer, s.inner) for s in steps if isinstance(s, Move)]
    first = [p[1] for p in poses[1:18]]
    assert first == pytest.approx(np.deg2rad([*range(0, 361, 45), *range(315, -1, -45)]))
    turned = np.zeros(3)
    for before, after in itertools.pairwise(poses):
        axis = np.array([1.0, 0.0, 0.0]) if before[0] != after[0] else np.array([0.0, 1.0, 0.0])
        if (before[0] != after[0]) != (before[1] != after[1]):
            body = axis if axis[1] else geometry.body_to_home(0.0, before[1]).T @ axis
            turned += np.abs(body)
    assert np.all(turned > 5.0)


def test_plan_for_a_manual_rig_contains_only_manual_moves():
    chosen = method("multi_position")
    steps = list(chosen.plan(TableGeometry(inner_axis=(0.0, 1.0, 0.0)), chosen.schedule(manual=True)))
    assert {type(s) for s in steps} == {ManualMove}
    assert [s.index for s in steps] == list(range(1, len(steps) + 1))
    assert {s.count for s in steps} == {len(steps)}
    assert (steps[0].outer, steps[0].inner, steps[0].rest, steps[0].travel_time) == (0.0, 0.0, 30.0, 0.0)
    assert steps[1].inner == pytest.approx(np.deg2rad(45.0))
    assert steps[1].rest == 8.0
    for before, after in itertools.pairwise(steps):
        assert max(abs(after.outer - before.outer), abs(after.inner - before.inner)) > 0.1


def test_plan_stays_within_the_travel_or_is_refused():
    chosen = method("multi_position")
    short = JointLimits(low=(-1.7, -3.2), high=(1.7, 3.2))
    poses = [s for s in chosen.plan(TableGeometry(limits=short), chosen.schedule()) if isinstance(s, Move)]
    assert all(short.within(0, s.outer) and short.within(1, s.inner) for s in poses)
    assert {round(np.rad2deg(s.inner)) for s in poses} >= {-180, -90, 0, 90, 180}
    stuck = JointLimits(low=(-2.0, -0.1), high=(2.0, 0.1))
    with raises_code(ConfigurationError, "plan.positions_exceed_travel") as caught:
        list(chosen.plan(TableGeometry(limits=stuck), chosen.schedule()))
    assert "45° apart on the inner axis" in str(caught.value)


def altered(block: SampleBlock, change) -> SampleBlock:
    counts = block.counts.copy()
    return replace(block, counts=change(counts))


def swap(a: int, b: int):
    def change(counts):
        counts[:, [a, b]] = counts[:, [b, a]]
        return counts

    return change


def scale(columns: slice, factor: float):
    def change(counts):
        counts[:, columns] *= factor
        return counts

    return change


def freeze(column: int, first: int, last: int):
    def change(counts):
        counts[first:last, column] = counts[first, column]
        return counts

    return change


def without_motion(counts):
    """Replace the gyro output by noise at rest."""
    counts[:, :3] = np.resize(counts[:800, :3], counts[:, :3].shape)
    return counts


@pytest.mark.parametrize(
    ("change", "code", "words"),
    [
        (freeze(2, 3000, 9000), "frozen", "gyro_z is frozen: one value from sample 30"),
        (freeze(4, 4000, 4500), "frozen", "accel_y is frozen"),
        (freeze(0, 0, 10**6), "frozen", "gyro_x is frozen"),
        (swap(0, 1), "axes_differ", "gyro_x is gyro_y, gyro_y is gyro_x"),
        (scale(slice(2, 3), -1.0), "axes_differ", "gyro_z is −gyro_z"),
        (swap(3, 5), "axes_differ", "The axes of gyro and accelerometer differ"),
        (scale(slice(3, 6), 1.0 / 9.80665), "accel_unit", "(g instead of m/s²)"),
        (scale(slice(3, 6), 2.0), "accel_unit", "units are wrong by a factor of 2"),
        (scale(slice(0, 3), 180.0 / np.pi), "gyro_unit_no_rest", "(°/s instead of rad/s)"),
        (scale(slice(0, 3), 0.5), "gyro_unit", "rates are multiplied by 2.0"),
        (without_motion, "gyros_see_no_motion", "The gyros do not measure the motions"),
    ],
)
def test_unusable_recording_is_refused_with_its_fault(mems, change, code, words):
    imu, block = mems
    with raises_code(InputError, f"recording.{code}") as caught:
        solved(altered(block, change), context_of(imu), prior_of("mems"))
    assert words in str(caught.value)


@pytest.mark.long
@pytest.mark.parametrize("known", [2.0, 1000.0])
@pytest.mark.parametrize(
    ("grade", "factor", "code"),
    [
        ("mems", 5.0, "gyro_unit"),
        ("mems", 10.0, "gyro_unit"),
        ("mems", 30.0, "gyro_unit"),
        ("mems", np.pi / 180.0, "gyros_see_no_motion"),
        ("tactical", 10.0, "gyro_unit"),
        ("tactical", 30.0, "gyro_unit"),
        ("tactical", 180.0 / np.pi, "gyro_unit"),
    ],
)
def test_factor_of_the_rates_is_found_although_it_adds_whole_turns(grade, factor, code, known):
    """Rates that are too high rotate the unit by many turns, which agree with gravity within some percent of them."""
    imu = unit(grade, 3)
    block = altered(recording(imu, 3, step=np.deg2rad(90.0)), scale(slice(0, 3), factor))
    with raises_code(InputError, f"recording.{code}") as caught:
        solved(block, context_of(imu), prior_of(grade, known))
    if code == "gyro_unit":
        assert caught.value.values["factor"] == pytest.approx(1.0 / factor, rel=0.03)


@pytest.mark.long
@pytest.mark.parametrize("grade", ["mems", "tactical"])
@pytest.mark.parametrize("step", [45.0, 90.0, 120.0])
def test_sound_recording_of_an_unknown_unit_is_accepted(grade, step):
    imu = unit(grade, 7)
    rough = replace(QUICK, velocity_sigma=8e-3)
    output = solved(recording(imu, 7, rough, step=np.deg2rad(step)), context_of(imu), prior_of(grade, 1000.0))
    assert not any(key == "motions_left_out" for key, _ in output.messages)


@pytest.mark.parametrize(("turn", "duration", "lever"), [(180.0, 0.6, 0.1), (180.0, 1.0, 0.3), (150.0, 0.8, 0.3)])
def test_fast_turns_about_a_distant_axis_do_not_look_like_a_wrong_factor(turn, duration, lever):
    """The accelerations of the lever arm hide the course of gravity."""
    truth, random = unit("mems", 3), np.random.default_rng(5)
    imu = context_of(truth).imu
    period, C, rates, forces = 1.0 / imu.sample_rate, np.eye(3), [], []
    for _ in range(12):
        rates.append(np.zeros((round(4.0 / period), 3)))
        forces.append(np.tile(9.8 * C[2], (len(rates[-1]), 1)))
        phase = (np.arange(round(duration / period)) + 0.5) / round(duration / period)
        angle = np.deg2rad(turn) * (phase - np.sin(2 * np.pi * phase) / (2 * np.pi))
        rate = np.deg2rad(turn) / duration * (1.0 - np.cos(2 * np.pi * phase))
        change = np.deg2rad(turn) / duration**2 * 2 * np.pi * np.sin(2 * np.pi * phase)
        azimuth, arm = random.uniform(0.0, 2 * np.pi), random.normal(size=3)
        axis, arm = C.T @ [np.cos(azimuth), np.sin(azimuth), 0.0], lever / np.linalg.norm(arm) * arm
        up = Rotation.from_rotvec(angle[:, None] * axis).inv().apply(C[2])
        rates.append(rate[:, None] * axis)
        centripetal = np.cross(axis, np.cross(axis, arm))
        forces.append(9.8 * up + change[:, None] * np.cross(axis, arm) + rate[:, None] ** 2 * centripetal)
        C = C @ Rotation.from_rotvec(np.deg2rad(turn) * axis).as_matrix()
    rates.append(np.zeros((round(4.0 / period), 3)))
    forces.append(np.tile(9.8 * C[2], (len(rates[-1]), 1)))
    measured = np.hstack([np.vstack(rates), np.vstack(forces)])
    noise = np.repeat([truth.gyro_arw, truth.accel_vrw], 3) / np.sqrt(period)
    counts = np.round((measured + random.normal(size=measured.shape) * noise) / imu.count_size)
    seq = np.arange(len(counts))
    data = stage_data([SampleBlock.without_table("multi_position", seq, seq * period, counts)], imu)
    still = find_stillness(data, imu, 1.0)
    assert len(valid_links(data, still, imu, 9.8, prior_of("mems"), 1.0)) == 12


def test_rotations_that_scatter_by_tens_of_degrees_are_refused(mems, monkeypatch):
    imu, block = mems
    found = fit_positions

    def scattered(*args):
        fit = found(*args)
        return replace(fit, scatter=replace(fit.scatter, turn=np.deg2rad(42.0)), assumed=())

    monkeypatch.setattr(multi_position, "fit_positions", scattered)
    with raises_code(InputError, "recording.turns_scatter") as caught:
        solved(block, context_of(imu), prior_of("mems"))
    assert caught.value.values["scatter_deg"] == pytest.approx(42.0)


@pytest.mark.long
def test_motion_that_contradicts_gravity_is_excluded_and_reported(mems):
    imu, block = mems
    output = solved(block, context_of(imu), prior_of("mems"))
    motion = output.details["motions"][7]

    def lose(counts):
        counts[motion["first_seq"] : motion["last_seq"], :3] = counts[:1, :3]
        counts[motion["first_seq"] : motion["last_seq"] : 2, :3] += 1.0
        return counts

    after = solved(altered(block, lose), context_of(imu), prior_of("mems"))
    # without its rotation, the motion is a cut of the recording
    assert ("recording_cut", {"stage": "multi_position", "count": 1}) in after.messages
    assert np.abs((after.posterior.mean - imu.parameters) / after.posterior.sigma)[MASK].max() < 4.5


def test_recordings_without_rest_or_motion_are_refused(mems):
    imu, block = mems
    context, prior = context_of(imu), prior_of("mems")
    with raises_code(InsufficientDataError, "recording.one_position"):
        solved(block.part(0, 900), context, prior)
    moving = replace(QUICK, initial_rest=0.2, rest=0.3, speed=np.deg2rad(20.0))
    with raises_code(InsufficientDataError, "recording.no_rest"):
        solved(recording(imu, 9, moving, step=np.deg2rad(120.0)), context, prior)


@pytest.mark.long
def test_motions_across_gaps_are_not_used(mems):
    imu, block = mems
    output = solved(block, context_of(imu), prior_of("mems"))
    positions = output.details["positions"]
    keep = np.ones(len(block), dtype=bool)
    for k in (3, 9):  # the motion after these rests is removed, and the counter is made continuous
        keep[positions[k]["last_seq"] - 20 : positions[k + 1]["first_seq"] + 20] = False
    seq = np.arange(int(keep.sum()))
    spliced = SampleBlock(
        block.stage,
        seq,
        (seq + 1) / imu.sample_rate,
        *(v[keep] for v in (block.counts, block.angles, block.step, block.valid, block.temperature)),
    )
    after = solved(spliced, context_of(imu), prior_of("mems"))
    assert len(after.details["cuts"]) == 2
    assert ("recording_cut", {"stage": "multi_position", "count": 2}) in after.messages
    assert len(after.details["motions"]) == len(output.details["motions"]) - 2
    assert np.abs((after.posterior.mean - imu.parameters) / after.posterior.sigma)[MASK].max() < 4.5


@pytest.mark.skipif(not real.HAND.exists(), reason="the real recordings are not beside the project")
def test_manual_recording_agrees_with_its_authors():
    result = resolve(real.HAND, ("multi_position",)).result.to_json()
    for name, faces, modulus in (
        ("accel_scale", (-1.399e-3, -4.007e-3, 2.848e-2), (-1.227e-3, -4.232e-3, 2.861e-2)),
        ("accel_bias", (-0.0288, -0.2312, -0.1387), (-0.0290, -0.2310, -0.1413)),
    ):
        tolerance = 5e-4 if name == "accel_scale" else 5e-3
        output = np.array([result["parameters"][f"{name}_{a}"]["value"] for a in "xyz"])
        assert output == pytest.approx(faces, abs=tolerance)
        assert output == pytest.approx(modulus, abs=tolerance)
    # the recording contains no motion between the faces, and its turns are vertical, so the gyros are undetermined
    lost = result["unobservable"]
    assert all(name in lost for name in ESTIMATED if name.startswith(("gyro_scale", "gyro_misalign")))
    assert not any(name in lost for name in ESTIMATED if name.startswith("gyro_bias"))
    # six faces are not redundant, so the scatter of the force is assumed and what depends on it is not determined
    assert all(name in lost for name in ESTIMATED if name.startswith("accel_bias"))


@pytest.mark.long
@pytest.mark.skipif(not real.IMU_TK.exists(), reason="the real recordings are not beside the project")
def test_xsens_recording_agrees_with_its_authors(tmp_path: Path):
    result = resolve(real.imu_tk(tmp_path), ("multi_position",)).result.to_json()
    published = real.imu_tk_published()
    value, sigma = (
        np.array([result["parameters"].get(n, {key: 0.0})[key] for n in NAMES]) for key in ("value", "sigma")
    )
    assert result["unobservable"] == []
    assert result["consistency"]["multi_position"]["passed"]
    for sensor in ("accel", "gyro"):
        M = np.eye(3) + group_matrix(value, f"{sensor}_scale", f"{sensor}_misalign")
        width = group_matrix(sigma, f"{sensor}_scale", f"{sensor}_misalign")
        assert np.all(np.abs(M - published[f"{sensor}_matrix"]) < 3.0 * width + 1e-12)
    # the agreement is close regardless of the sigmas
    accel = np.eye(3) + group_matrix(value, "accel_scale", "accel_misalign")
    assert accel == pytest.approx(published["accel_matrix"], abs=3e-4)
    assert group_vector(value, "accel_bias") == pytest.approx(published["accel_bias"], abs=2e-3)
    gyro = np.eye(3) + group_matrix(value, "gyro_scale", "gyro_misalign")
    assert gyro == pytest.approx(published["gyro_matrix"], abs=2e-3)
    # the published bias is from the first 50 s and ours the mean of all rests, between which the bias drifted
    assert group_vector(value, "gyro_bias") == pytest.approx(published["gyro_bias"], abs=2e-3)


@pytest.mark.long
def test_effects_of_a_table_are_not_tested_in_a_recording_by_hand(mems):
    """A gyro bias that is present only in motion has other names if a hand turns the unit."""
    imu, block = mems
    unit_rate, counts = imu.gyro_lsb * imu.sample_rate, block.counts.copy()  # the output is increments
    counts[np.abs(unit_rate * block.counts[:, :3]).max(axis=1) > np.deg2rad(3.0), :3] += np.rint(2e-3 / unit_rate)
    by_hand = replace(block, counts=counts)
    on_table = replace(by_hand, angles=np.zeros((len(block), 2)))
    prior, context = prior_of("mems", 20.0), context_of(imu)
    tested = []
    for recorded in (by_hand, on_table):
        solution = solved(recorded, context, prior)
        tests = EffectTests(np.zeros(len(NAMES)))
        tests.add("multi_position", solution.sensitivity, solution.estimated)
        ranked = tests.evidence(solution.posterior)
        tested.append({e.cause for e in ranked if e.excess > 0.0})
        assert max(ranked, key=lambda e: e.excess).excess > MAX_EXCESS
    of_table = {effect.cause for effect in EFFECTS if effect.on_table}
    assert not tested[0] & of_table
    assert {"gyro_moving_bias", "gyro_hysteresis"} <= tested[1]
