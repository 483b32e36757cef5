"""Cross-calibration of secondaries against a primary: consistent sigmas, triggers, and unusable recordings."""

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import real_recordings as real
from pair_recordings import (
    RATE,
    RIG,
    context_of,
    pair,
    primary_errors,
    recording,
    solved,
    solver_of,
    truth_of,
    vector,
)
from scipy.ndimage import uniform_filter1d
from scipy.stats import chi2

from calstation.bench.truth import Mounting, SecondaryTruth, push, rotation
from calstation.errors import ConfigurationError, InputError, InsufficientDataError
from calstation.estimation.common import SampleBlock, SolveContext, StoredCrossCalibration
from calstation.estimation.pairs import PairCalibration, PairSchedule, PairWatch, call_now, pair_vector
from calstation.estimation.pairs.calibration import compensate_secondary
from calstation.estimation.pairs.schedule import Threshold
from calstation.messages import sentence
from calstation.physics import PAIR_PARAMETERS, TableGeometry, compensation, further_parameter, group_indices, pair_name
from calstation.results import resolve
from procedures import method
from tests.helpers import raises_code

GROUPS = tuple(dict.fromkeys(p.group for p in PAIR_PARAMETERS))
LOOSE = {"fixed": 10.0}
TIGHT = {"secondary_gyro": {"fixed": 1e-3}, "secondary_accel": {"fixed": 5e-3}}


@pytest.fixture(scope="module")
def mems():
    primary, secondary = pair(1)
    return primary, secondary, recording(primary, [secondary], 1)


@pytest.mark.exhaustive
def test_errors_of_many_pairs_agree_with_their_sigmas():
    errors = []
    for seed in range(9):
        primary, secondary = pair(100 + seed)
        solution = solved(
            recording(primary, [secondary], seed), context_of(primary, [secondary]), primary_errors(primary)
        )
        errors.append((vector(solution) - truth_of(primary, secondary)) / vector(solution, "sigma"))
    for group in GROUPS:
        columns = [k for k, p in enumerate(PAIR_PARAMETERS) if p.group == group]
        count = 9 * min(len(columns), 3)
        low, high = chi2.ppf([0.0005, 0.9995], count) / count
        # the sigmas of the jackknife are accurate to a tenth
        assert 0.85 * low < np.mean(np.square(np.array(errors)[:, columns])) < 1.15 * high, group


@pytest.mark.long
def test_clock_offset_is_found_with_subsample_accuracy(mems):
    primary, secondary, block = mems
    solution = solved(block, context_of(primary, [secondary]), primary_errors(primary)).estimates["clock_offset"]
    assert abs(solution.value - secondary.offset) < 4.0 * solution.sigma
    assert solution.sigma < 1e-5
    assert abs(secondary.offset) > 1e-3


@pytest.mark.long
def test_bias_change_during_the_recording_fails_and_is_reported(mems):
    primary, secondary, block = mems
    context = context_of(primary, [secondary])
    sound = solved(block, context, primary_errors(primary))
    assert all(test.value < test.limit for test in sound.tests)
    sigma = sound.estimates["secondary_gyro_bias_y"].sigma
    late = np.arange(len(block)) >= len(block) // 2
    changed = with_error(block, context, lambda w, f: 14.0 * sigma * late[:, None] * np.eye(6)[1])
    test, _ = solved(changed, context, primary_errors(primary)).tests
    assert test.value > test.limit
    assert test.diagnosis.values["parameter"] == "secondary_gyro_bias_y"
    assert test.diagnosis.size == pytest.approx(14.0 * sigma, abs=4.0 * test.diagnosis.sigma)
    assert set(test.diagnosis.parameter_shift) == {"secondary_gyro_bias_y"}


def with_error(
    block: SampleBlock, context: SolveContext, error: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> SampleBlock:
    """Return a recording whose secondary has an additional error in SI, a function of its measured rate and force."""
    imu = context.secondaries[0].imu
    unit = np.repeat([imu.gyro_lsb, imu.accel_lsb], 3) * imu.rate_factor
    others = block.others.astype(np.float64)
    measured = uniform_filter1d(others[:, 0] * unit, 5, axis=0)
    others[:, 0] += error(measured[:, :3], measured[:, 3:]) / unit
    return replace(block, others=others)


def gyro(values: np.ndarray) -> np.ndarray:
    return np.hstack([values, np.zeros_like(values)])


def accel(values: np.ndarray) -> np.ndarray:
    return np.hstack([np.zeros_like(values), values])


FAST, G = np.deg2rad(100.0), 9.8


@pytest.mark.long
@pytest.mark.parametrize(
    ("effect", "size", "error"),
    [
        ("gyro_cubic", 1e-3 / FAST**2, lambda w, f: gyro(w**3)),
        ("accel_cubic", 3e-4 / G**2, lambda w, f: accel(f**3)),
        ("time_skew", 2e-4, lambda w, f: accel(-np.gradient(f, 1.0 / RATE, axis=0))),
    ],
)
def test_unmodelled_effect_fails_and_is_reported(mems, effect, size, error):
    primary, secondary, block = mems
    context = context_of(primary, [secondary])
    sound = solved(block, context, primary_errors(primary))
    changed = solved(with_error(block, context, lambda w, f: size * error(w, f)), context, primary_errors(primary))
    (_, test) = changed.tests
    assert (test.kind, test.diagnosis.cause, test.diagnosis.values["effect"]) == ("effects", "pair_effect", effect)
    assert test.value > test.limit
    assert test.diagnosis.size == pytest.approx(
        size, rel=0.15, abs=4.0 * test.diagnosis.sigma
    )  # the measured values are filtered
    shift = test.diagnosis.parameter_shift
    worst = max(shift, key=lambda name: abs(shift[name]))
    before, after = sound.estimates[worst], changed.estimates[worst]
    assert (after.value - before.value) / after.sigma == pytest.approx(shift[worst], rel=0.3, abs=4.0)


def test_drift_during_the_recording_fails_and_is_reported(mems):
    primary, secondary, block = mems
    context = context_of(primary, [secondary])
    course = np.linspace(0.0, 1e-3, len(block))[:, None]
    (_, test) = solved(
        with_error(block, context, lambda w, f: accel(course * f)), context, primary_errors(primary)
    ).tests
    assert test.value > test.limit
    assert test.diagnosis.cause == "drift"
    assert test.diagnosis.values["parameter"].startswith("secondary_accel_matrix_")


@pytest.mark.long
def test_sound_pair_that_turns_in_one_direction_passes(monkeypatch):
    """|ω| and ω then differ by noise only, which must not resemble an asymmetry."""
    once = [np.deg2rad(60.0) * k for k in range(1, 13)]
    full = once[-1]
    poses = (
        [(0.0, a) for a in once] + [(a, full) for a in once] + [(full + a, full + 0.5 * np.pi) for a in (0.0, *once)]
    )
    rig = replace(RIG, stop_sigma=0.0, play=0.0, shake=0.0)
    monkeypatch.setattr("pair_recordings.around", lambda step: poses)
    monkeypatch.setattr("calstation.bench.truth.manual_rig.tremor", lambda random, size: np.empty((0, 3)))
    monkeypatch.setattr("pair_recordings.push", without_corrections(push))
    primary, secondary = pair(1)
    solution = solved(
        recording(primary, [secondary], 1, rig), context_of(primary, [secondary]), primary_errors(primary)
    )
    assert all(test.value < test.limit for test in solution.tests)
    assert np.abs((vector(solution) - truth_of(primary, secondary)) / vector(solution, "sigma")).max() < 4.5


def without_corrections(push):
    """Return `push` with a random generator whose normal numbers are 0, so that no rail is pushed back."""

    class Steady:
        def __init__(self, random: np.random.Generator) -> None:
            self.uniform = random.uniform

        def standard_normal(self, size: int | None = None) -> np.ndarray | float:
            return 0.0 if size is None else np.full(size, 0.3 * (size == 3))

    return lambda rig, poses, random: push(rig, poses, Steady(random))


@pytest.mark.long
def test_effects_are_reported_in_the_axes_of_a_rotated_secondary():
    primary, secondary = pair(3)
    turned = replace(secondary, mounting=Mounting(rotation(np.array([0.0, 0.0, 0.5 * np.pi])), np.zeros(3)))
    block, context = recording(primary, [turned], 3), context_of(primary, [turned])
    along_x = np.eye(3)[0]
    sound = solved(block, context, primary_errors(primary))
    assert all(test.value < test.limit for test in sound.tests)
    changed = with_error(block, context, lambda w, f: 3e-3 / FAST**2 * gyro(along_x * w**3))
    (_, test) = solved(changed, context, primary_errors(primary)).tests
    assert test.value > test.limit
    assert (test.diagnosis.values["effect"], test.diagnosis.values["component"]) == ("gyro_cubic", "x")


def test_effect_indistinguishable_from_a_parameter_is_not_reported(mems):
    primary, secondary, block = mems
    context = context_of(primary, [secondary])
    upright = block.part(0, 4000)  # the axis always points up, so that |f| equals f
    imus = (context.imu, context.secondaries[0].imu)
    counts, others = (np.asarray(x, np.float64).copy() for x in (upright.counts, upright.others))
    random = np.random.default_rng(1)
    rates = uniform_filter1d(random.normal(0.0, 2.0, (len(upright), 3)), 15, axis=0)
    forces = np.array([0.0, 0.0, G]) + uniform_filter1d(random.normal(0.0, 4.0, (len(upright), 3)), 15, axis=0)
    for imu, of in zip(imus, (counts, others[:, 0]), strict=True):
        unit = np.repeat([imu.gyro_lsb, imu.accel_lsb], 3) * imu.rate_factor
        noise = np.repeat([imu.gyro_arw, imu.accel_vrw], 3) * np.sqrt(RATE)
        of[:] = (np.hstack([rates, forces]) + noise * random.normal(size=(len(upright), 6))) / unit
    moved = replace(upright, counts=counts, others=others)
    solution = solved(moved, context, primary_errors(primary), lever=False, clock_offset=False)
    assert all(test.value < test.limit for test in solution.tests)
    assert solution.explanation is None


@pytest.mark.long
@pytest.mark.parametrize("choice", [{"model": "bias"}, {"model": "scale"}, {"clock_offset": False}])
def test_terms_excluded_from_the_fit_are_not_reported_as_effects(mems, choice):
    primary, secondary, block = mems
    solution = solved(block, context_of(primary, [secondary]), primary_errors(primary), **choice)
    named = [
        test.diagnosis
        for test in (*solution.tests, solution.explanation)
        if test is not None and test.kind == "effects"
    ]
    if "model" in choice:
        assert not named
    assert "time_skew" not in [diagnosis.values.get("effect") for diagnosis in named]


def test_effect_without_influence_on_the_parameters_passes(mems):
    primary, secondary, block = mems
    context = context_of(primary, [secondary])
    solution = solved(with_error(block, context, lambda w, f: gyro(1e-5 * f)), context, primary_errors(primary))
    assert all(test.value < test.limit for test in solution.tests)
    assert solution.explanation.diagnosis.values["effect"] == "g_sensitivity"


@pytest.mark.long
def test_secondary_mounted_upside_down_is_calibrated():
    primary, secondary = pair(4)
    turned = replace(secondary, mounting=Mounting(rotation(np.array([np.pi, 0.02, 0.01])), secondary.mounting.arm))
    solution = solved(recording(primary, [turned], 4), context_of(primary, [turned]), primary_errors(primary))
    error = (vector(solution) - truth_of(primary, turned)) / vector(solution, "sigma")
    assert np.abs(error).max() < 5.0


@pytest.mark.parametrize("what", ["bias", "scale"])
def test_partial_models_are_fitted(what):
    primary, secondary = pair(5)
    straight = primary.parameters.copy()
    matrix = [*group_indices("gyro_misalign"), *group_indices("accel_misalign")]
    scales = [*group_indices("gyro_scale"), *group_indices("accel_scale")]
    primary, other = (replace(u, parameters=straight.copy()) for u in (primary, secondary.imu))
    for unit, shift in ((primary, 0.0), (other, 1.0)):
        unit.parameters[matrix] = 0.0
        unit.parameters[scales] = shift * 2e-3 if what == "scale" else 0.0
        unit.parameters[group_indices("gyro_bias")] += shift * 0.004
        unit.parameters[group_indices("accel_bias")] -= shift * 0.06
    alike = SecondaryTruth(other, Mounting(np.eye(3), np.zeros(3)), 0.004)
    solution = solved(recording(primary, [alike], 5), context_of(primary, [alike]), primary_errors(primary), model=what)
    truth, sigma = truth_of(primary, alike), vector(solution, "sigma")
    fitted = sigma > 0.0
    assert fitted.sum() == {"bias": 7, "scale": 13}[what]
    assert np.abs((vector(solution) - truth)[fitted] / sigma[fitted]).max() < 4.5
    assert solution.estimates["secondary_gyro_matrix_xy"].value == 0.0


@pytest.mark.long
def test_parameters_of_several_secondaries_have_distinct_names():
    primary, first = pair(6)
    _, second = pair(7)
    block = recording(primary, [first, second], 6)
    solution = solved(block, context_of(primary, [first, second]), primary_errors(primary))
    assert {"secondary_gyro_bias_x", "clock_offset", "secondary3_gyro_bias_x", "clock_offset3"} < set(
        solution.estimates
    )
    for number, secondary in ((2, first), (3, second)):
        truth = truth_of(primary, secondary)
        for k, p in enumerate(PAIR_PARAMETERS):
            estimate = solution.estimates[pair_name(p.name, number)]
            assert abs(estimate.value - truth[k]) < 5.0 * estimate.sigma, (number, p.name)
            assert further_parameter(pair_name(p.name, number)) is p


def test_secondary_data_are_compensated_by_the_pair_and_then_the_primary(mems):
    primary, secondary, _ = mems
    random = np.random.default_rng(3)
    omega, force = random.standard_normal((5, 3)), 5.0 * random.standard_normal((5, 3))
    truth = truth_of(primary, replace(secondary, mounting=Mounting(secondary.mounting.turn, np.zeros(3))))
    c = compensation(primary.parameters)
    measured = [
        omega @ np.linalg.inv(c.gyro_inverse).T + c.gyro_bias,
        force @ np.linalg.inv(c.accel_inverse).T + c.accel_bias,
    ]
    gyro2 = measured[0] @ truth[3:12].reshape(3, 3).T + truth[0:3]
    accel2 = measured[1] @ truth[15:24].reshape(3, 3).T + truth[12:15]
    back = compensate_secondary(truth, c, gyro2, accel2)
    assert back[0] == pytest.approx(omega, abs=1e-12)
    assert back[1] == pytest.approx(force, abs=1e-12)


def test_threshold_is_fixed_or_relative_to_the_last_calibration():
    assert Threshold(fixed=0.1).limit(0.04) == 0.1
    assert Threshold(fixed=0.1, offset=0.02).limit(0.04) == pytest.approx(0.06)
    assert Threshold(fixed=0.1, ratio=3.0).limit(0.04) == pytest.approx(0.12)
    assert Threshold(fixed=0.1, ratio=3.0).limit(None) == 0.1
    with pytest.raises(ValueError, match="exclude each other"):
        Threshold(fixed=0.1, ratio=3.0, offset=0.1)
    # the calibration of a pair does not change the primary
    with pytest.raises(ValueError, match="only a fixed threshold"):
        PairSchedule(primary_gyro={"fixed": 0.1, "ratio": 3.0})


def watch_of(primary, secondaries, kept=None, stored=None, submit=call_now, **schedule):
    settings = PairSchedule(**{"trigger": "start_up", "motion_s": 10.0, **TIGHT, **schedule})
    context = context_of(primary, secondaries, stored)
    calibration = PairCalibration(context, primary_errors(primary), settings)
    keep = (lambda number, pair: None) if kept is None else kept.__setitem__
    return PairWatch(context.imu, context.secondaries, calibration, keep, submit)


def run(watch, block, size=100):
    return [e for k in range(0, len(block), size) for e in watch.feed(block.part(k, min(k + size, len(block))))]


def test_secondary_out_of_tolerance_is_calibrated_from_the_next_motion(mems):
    primary, secondary, block = mems
    kept: dict[int, StoredCrossCalibration] = {}
    watch = watch_of(primary, [secondary], kept)
    events = run(watch, block)
    assert [e.kind for e in events] == ["triggered", "checked", "calibrating", "calibrated"]
    assert watch.state == "waiting"
    error = (pair_vector(kept[2]) - truth_of(primary, secondary)) / np.sqrt(np.diag(watch.calibrated[2].fit.covariance))
    assert np.abs(error).max() < 5.0
    # with the stored values, the next check finds the secondary as good as the primary and does nothing
    again = watch_of(primary, [secondary], kept, stored=kept)
    assert [e.kind for e in run(again, block)] == ["triggered", "checked"]
    assert again.checks[2].secondary["gyro"].value < 1e-4
    assert again.stored[2] is kept[2]


def test_period_and_command_trigger_a_check(mems):
    primary, secondary, block = mems
    quiet = {"secondary_gyro": LOOSE, "secondary_accel": LOOSE}
    watch = watch_of(primary, [secondary], trigger="period", period_s=20.0, static_s=1.0, **quiet)
    times = [e.time for e in run(watch, block) if e.kind == "triggered"]
    assert len(times) >= 4
    assert np.all(np.diff(times) >= 19.9)
    assert np.diff(times).min() < 21.1
    silent = watch_of(primary, [secondary], trigger="command", static_s=1.0, **quiet)
    half = len(block) // 2
    assert run(silent, block.part(0, half)) == []
    silent.command()
    assert [e.kind for e in run(silent, block.part(half, len(block)))][:2] == ["triggered", "checked"]


def test_out_of_tolerance_primary_prevents_calibration(mems):
    primary, secondary, block = mems
    watch = watch_of(primary, [secondary], primary_gyro={"fixed": 1e-6}, primary_accel={"fixed": 1e-6})
    assert [e.kind for e in run(watch, block)] == ["triggered", "checked", "primary_off"]
    # each sensor is judged separately: if only the gyros are out of tolerance, the accelerometers are still calibrated
    for sensors in ("triggering", "all"):
        watch = watch_of(primary, [secondary], primary_gyro={"fixed": 1e-6}, sensors=sensors)
        events = run(watch, block)
        kinds = [e.kind for e in events]
        assert kinds == ["triggered", "checked", "primary_off", "calibrating", "calibrated"]
        assert events[-1].values == {"sensors": ["accel"], "skipped": ["gyro"]}
        assert watch.checks[2].primary_out_of_tolerance == ("gyro",)
        fitted = watch.calibrated[2].fit.fitted
        assert not fitted[:12].any()
        assert fitted[12:24].all()
        # the next threshold must not be derived from the uncalibrated error of the gyros
        assert watch.stored[2].gyro_static is None
        assert watch.stored[2].accel_static < TIGHT["secondary_accel"]["fixed"]
        assert watch.verdicts[2] == {"gyro": "out_of_tolerance", "accel": "calibrated"}
    both = watch_of(primary, [secondary], primary_gyro={"fixed": 1e-6}, primary_valid="both_sensors")
    assert [e.kind for e in run(both, block)] == ["triggered", "checked", "primary_off"]
    assert set(both.verdicts[2].values()) == {"out_of_tolerance"}


def test_static_error_of_an_uncalibrated_sensor_is_kept(mems):
    primary, secondary, block = mems
    before = {2: StoredCrossCalibration({}, 1e-4, 2e-3)}
    ratio = {"secondary_gyro": {"fixed": 1e-3, "ratio": 3.0}, "primary_gyro": {"fixed": 1e-6}}
    watch = watch_of(primary, [secondary], stored=before, **ratio)
    run(watch, block)
    assert watch.stored[2].gyro_static == 1e-4
    again = watch_of(primary, [secondary], stored=watch.stored, **ratio)
    run(again, block)
    assert again.checks[2].secondary["gyro"].limit == pytest.approx(3e-4)
    assert again.verdicts[2]["gyro"] == "out_of_tolerance"


@pytest.mark.long
def test_out_of_tolerance_calibration_does_not_loosen_the_next_threshold(mems):
    primary, secondary, block = mems
    limits = {"secondary_gyro": {"fixed": 2e-6, "ratio": 3.0}, "secondary_accel": {"fixed": 5e-3, "ratio": 3.0}}
    first = watch_of(primary, [secondary], **limits)
    run(first, block)
    assert first.calibrated[2].static["gyro"] > 2e-6
    assert first.verdicts[2] == {"gyro": "out_of_tolerance", "accel": "calibrated"}
    assert first.stored[2].gyro_static is None
    again = watch_of(primary, [secondary], stored=first.stored, **limits)
    run(again, block)
    assert again.checks[2].secondary["gyro"].limit == 2e-6
    assert again.verdicts[2]["gyro"] == "out_of_tolerance"
    # nor is a value used that only a loosened threshold would accept
    loosened = {2: StoredCrossCalibration({}, None, 0.002)}
    limits["secondary_accel"] = {"fixed": 1e-6, "ratio": 3.0}
    last = watch_of(primary, [secondary], stored=loosened, **limits)
    run(last, block)
    assert last.verdicts[2]["accel"] == "calibrated"
    assert last.stored[2].accel_static == 0.002


def test_silent_primary_is_reported_until_it_sends_again(mems):
    primary, secondary, block = mems
    watch = watch_of(primary, [secondary], trigger="command")
    counts = block.counts.copy()
    counts[200:400] = np.nan
    silent = replace(block, counts=counts, valid=~np.isnan(counts).any(axis=1)).part(0, 600)
    assert [(e.kind, e.time) for e in run(watch, silent, 10)] == [
        ("primary_silent", pytest.approx(3.1)),
        ("primary_resumed", pytest.approx(4.1)),
    ]


def without_secondary(block, start, stop=None):
    others = block.others.copy()
    others[start:stop] = np.nan
    return replace(block, others=others)


def test_silent_secondary_is_reported_until_it_sends_again(mems):
    primary, secondary, block = mems
    watch = watch_of(primary, [secondary], trigger="command")
    silent = without_secondary(block.part(0, 600), 200, 400)
    assert [(e.kind, e.number, e.time) for e in run(watch, silent, 10)] == [
        ("secondary_silent", 2, pytest.approx(3.1)),
        ("secondary_resumed", 2, pytest.approx(4.1)),
    ]
    assert not watch.silent


def test_primary_stays_out_of_tolerance_until_the_next_check(mems):
    primary, secondary, block = mems
    still = block.part(0, 550)
    watch = watch_of(primary, [secondary], primary_gyro={"fixed": 1e-6}, primary_valid="both_sensors")
    assert [e.kind for e in run(watch, still)] == ["triggered", "checked", "primary_off"]
    watch.command()
    # the secondary has no data during the rest, so that nothing was checked
    later = replace(still, seq=still.seq + 600, time=still.time + 6.0)
    assert {e.kind for e in run(watch, without_secondary(later, 0))} == {"triggered", "secondary_silent"}
    assert watch.primary_off == ("gyro",)
    assert watch.state == "checking"


class DeferredExecutor:
    """An executor that runs a fit only when its result is requested."""

    def __init__(self):
        self.done, self.work, self.started = False, [], 0

    def __call__(self, work):
        self.started += 1
        future = Future()
        self.work.append((future, work))
        return future

    def finish(self):
        future, work = self.work.pop()
        future.set_result(work())


def test_motion_before_a_realignment_is_discarded_even_during_a_fit(mems):
    primary, secondary, block = mems
    kept: dict[int, StoredCrossCalibration] = {}
    fits = DeferredExecutor()
    watch = watch_of(primary, [secondary], kept, submit=fits)
    begin = 0
    while not fits.started:
        run(watch, block.part(begin, begin + 50))
        begin += 50
    assert watch.progress == 1.0
    run(watch, block.part(begin, begin + 50))
    watch.realigned(2, 30.0, 0.1, 1e-6)
    assert watch.progress == 0.0
    fits.finish()
    run(watch, block.part(begin + 50, begin + 350))
    assert kept == {}
    assert watch.state == "calibrating"
    # motion is not used either while the offset is unknown
    watch.lost_alignment(2, 40.0)
    before = watch.progress
    events = run(watch, block.part(begin + 350, begin + 2350))
    assert events[0].kind == "alignment_lost"
    assert watch.progress == before
    watch.realigned(2, 50.0, 0.1, 1e-6)
    run(watch, block.part(begin + 2350, len(block)))
    assert watch.progress > 0.0 or fits.started > 1


def test_sensor_stays_out_of_tolerance_if_no_rest_verifies_its_calibration(mems, monkeypatch):
    primary, secondary, block = mems
    watch = watch_of(primary, [secondary])
    solution = PairCalibration.calibrate

    def unverified(*arguments):
        return replace(solution(*arguments), static={"gyro": None, "accel": None})

    monkeypatch.setattr(PairCalibration, "calibrate", unverified)
    assert run(watch, block)[-1].kind == "calibrated"
    assert set(watch.verdicts[2].values()) == {"out_of_tolerance"}


def test_calibration_that_cannot_be_stored_is_reported_and_used(mems):
    primary, secondary, block = mems

    class Full(dict):
        def __setitem__(self, number, pair):
            raise ConfigurationError("log.pair_not_written", file="pair.toml", reason="full")

    watch = watch_of(primary, [secondary], Full())
    events = run(watch, block)
    assert [e.kind for e in events][-2:] == ["calibrated", "not_stored"]
    assert events[-1].values["why"].code == "log.pair_not_written"
    assert len(watch.stored[2].values) == len(PAIR_PARAMETERS)


def test_only_triggering_sensors_are_calibrated_if_configured(mems):
    primary, secondary, block = mems
    watch = watch_of(primary, [secondary], sensors="triggering", secondary_accel=LOOSE)
    run(watch, block)
    assert set(watch.stored[2].values) == {
        p.name for p in PAIR_PARAMETERS if p.group.startswith("secondary_gyro") or p.group == "clock_offset"
    }


def test_calibration_without_motion_is_abandoned(mems):
    primary, secondary, block = mems
    still = block.part(0, 550)
    watch = watch_of(primary, [secondary])
    events = run(watch, still) + watch.finish()
    assert [e.kind for e in events][-1] == "given_up"
    why = events[-1].values["why"]
    assert (why.code, why.values["wanted"]) == ("solve.too_little_motion", 10.0)


@pytest.mark.long
def test_solution_does_not_depend_on_the_blocks(mems):
    primary, secondary, block = mems
    context, prior = context_of(primary, [secondary]), primary_errors(primary)
    for trigger in ("command", "start_up"):
        answers = []
        for size in (37, 1000, len(block)):
            solver = solver_of(context, prior, trigger=trigger, motion_s=10.0, **TIGHT)
            for k in range(0, len(block), size):
                solver.feed(block.part(k, min(k + size, len(block))))
            answers.append(vector(solver.finish()))
        assert np.array_equal(answers[0], answers[1])
        assert np.array_equal(answers[0], answers[2])


def test_secondary_within_tolerance_is_not_changed(mems):
    primary, secondary, block = mems
    solution = solved(
        block,
        context_of(primary, [secondary]),
        primary_errors(primary),
        trigger="start_up",
        secondary_gyro=LOOSE,
        secondary_accel=LOOSE,
    )
    assert solution.estimates == {}
    assert solution.messages[-1][0] == "pair_kept"
    assert solution.consistency.passed
    shown = solution.details["secondaries"][0]["check"]["secondary"]
    assert shown["gyro"]["within"]


def altered(block, change):
    others = block.others.copy()
    change(others[:, 0])
    return replace(block, others=others)


def lose(counts):
    counts[:] = np.nan


def freeze(counts):
    counts[2000:5000, 1] = counts[2000, 1]


def swap(counts):
    counts[:, [0, 1]] = counts[:, [1, 0]]


def degrees(counts):
    counts[:, :3] *= 180.0 / np.pi


def turn_gyro(counts):
    counts[:, [0, 1]] = counts[:, [1, 0]] * [1.0, -1.0]


@pytest.mark.parametrize(
    ("change", "code", "words"),
    [
        (lose, "too_few_pairs", "imu2 has 0.0 s of synchronous samples"),
        (freeze, "frozen_at_time", "gyro2_y is frozen for 30.0 s from 20.0 s on"),
        (swap, "pair_mirrored", "gyro of imu2 are a mirror image of the primary's"),
        (degrees, "pair_unit", "gyro of imu2 measures 57.2"),
        (turn_gyro, "pair_sensors_apart", "gyro and accelerometer of imu2 are 90° apart"),
    ],
)
def test_unusable_recording_is_refused_with_its_fault(mems, change, code, words):
    primary, secondary, block = mems
    with raises_code(InputError, f"recording.{code}") as caught:
        solved(altered(block, change), context_of(primary, [secondary]), primary_errors(primary))
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("code", "words"),
    [("en", "gyro of imu2 has exactly the primary's values"), ("zh_CN", "imu2 的陀螺数值与主 IMU 完全相同")],
)
def test_columns_copied_from_the_primary_are_refused(mems, code, words):
    primary, secondary, block = mems
    copied = replace(block, others=block.counts[:, None].astype(block.others.dtype))
    same = replace(secondary, imu=primary)
    with raises_code(InputError, "recording.pair_identical") as caught:
        solved(copied, context_of(primary, [same]), primary_errors(primary))
    assert words in sentence(caught.value.as_text, code)


def test_too_little_motion_is_refused(mems):
    primary, secondary, block = mems
    context, prior = context_of(primary, [secondary]), primary_errors(primary)
    with raises_code(InsufficientDataError, "recording.no_turning"):
        solved(block.part(0, 550), context, prior)
    inner_only = replace(RIG, play=0.0, stop_sigma=0.0, tilt=0.0, shake=0.0)
    rail = recording(primary, [secondary], 3, inner_only)
    first = int(np.flatnonzero(np.abs(rail.counts[:, 0] - np.median(rail.counts[:, 0])) > 2000)[0])
    with raises_code(InsufficientDataError, "recording.little_turning") as caught:
        solved(rail.part(0, first), context, prior)
    assert caught.value.values["axis"] in "xz"
    with raises_code(InputError, "solve.no_second_imu"):
        solved(block, replace(context, secondaries=()), prior)


def test_gaps_and_missing_values_exclude_only_their_rows(mems):
    primary, secondary, block = mems
    others = block.others.copy()
    others[3000:3050, 0, 2] = np.nan
    keep = np.ones(len(block), dtype=bool)
    keep[5000:5300] = False
    kept = replace(
        block,
        **{
            n: getattr(block, n)[keep]
            for n in ("seq", "time", "counts", "angles", "step", "valid", "temperature", "joints")
        },
        others=others[keep],
    )
    solution = solved(kept, context_of(primary, [secondary]), primary_errors(primary))
    assert solution.gaps == 1
    assert np.abs((vector(solution) - truth_of(primary, secondary)) / vector(solution, "sigma")).max() < 5.0


def test_cross_calibration_on_a_table_is_refused():
    chosen = method("cross_calibration")
    with raises_code(ConfigurationError, "plan.needs_joint_recording"):
        list(chosen.plan(TableGeometry(), chosen.schedule()))


@pytest.mark.exhaustive
@pytest.mark.skipif(not real.IMU_ARRAY.exists(), reason="the real recordings are not beside the project")
@pytest.mark.parametrize("number", [3, 8])
def test_array_recording_agrees_with_its_references(number: int, tmp_path: Path) -> None:
    result = resolve(real.imu_array(tmp_path, number)).result.to_json()
    parameters = result["parameters"]
    assert result["stages"] == ["cross_calibration"]
    assert result["unobservable"] == []

    def values(group: str) -> np.ndarray:
        return np.array([row["value"] for name, row in parameters.items() if name.startswith(group)])

    # the lever arms from the drawing of the board, which the recording does not contain
    assert 1e3 * values("secondary_lever") == pytest.approx(real.array_lever_mm(number), abs=1.0)
    # one clock drives all IMUs, so that the offset is less than a hundredth of a sample
    assert parameters["clock_offset"]["value"] == pytest.approx(0.0, abs=2e-4)
    if number == 3:
        gyro, accel, bias = real.ARRAY_3_TO_1
        assert values("secondary_gyro_matrix").reshape(3, 3) == pytest.approx(gyro, abs=1e-3)
        assert values("secondary_accel_matrix").reshape(3, 3) == pytest.approx(accel, abs=5e-4)
        assert values("secondary_accel_bias") == pytest.approx(bias, abs=6e-3)
