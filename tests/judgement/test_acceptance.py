"""Acceptance checks: compared values, margins and values near limits; no check without data."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calstation.errors import ConfigurationError
from calstation.estimation import Estimate, Solution
from calstation.estimation.common import Consistency, ImuModel, Posterior, Site, SolveContext, TableModel
from calstation.estimation.positions import Evidence, MotionEvidence, RestEvidence, turn_between
from calstation.judgement import Check, Where, offline_online
from calstation.judgement.acceptance import acceptance
from calstation.physics import COUNT, INDEX, NAMES, axis_rotation, orientation_matrix
from calstation.records import ChecksSection
from calstation.schema import validate
from tests.check_rows import check_row

G = 9.8
X = (1.0, 0.0, 0.0)


def context(orientation: str = "+x+z") -> SolveContext:
    imu = ImuModel("U", 100.0, "rate", 1e-6, 1e-6, 1e-5, 1e-4)
    table = TableModel(orientation=orientation_matrix(orientation))
    return SolveContext(Site(0.6, 0.0, 0.0, 0.0, G), imu, table)


def rest(force, angles=None, duration=5.0) -> RestEvidence:
    return RestEvidence(duration, np.array(force), np.zeros(3), angles)


def motion(angle: float, scale: float = 0.0, before: int = 0, after: int = 1) -> MotionEvidence:
    """Return a rotation about x whose gyro has a scale factor error `scale`, with its derivative."""
    derivative = np.zeros((3, 12))
    derivative[0, 3] = -angle
    seen = axis_rotation(X, angle * (1.0 + scale))
    return MotionEvidence(before, after, 2.0, abs(angle), seen, np.zeros(COUNT), seen, derivative)


def solution(evidence: Evidence | None = None, estimated=NAMES, sigma=1e-4, **values: float) -> Solution:
    mean = np.zeros(COUNT)
    for name, value in values.items():
        mean[INDEX[name]] = value
    posterior = Posterior(mean, np.diag(np.full(COUNT, sigma) ** 2))
    return Solution("multi_position", posterior, tuple(estimated), Consistency(1.0, 0.9, 1.1, 9), evidence=evidence)


def prior() -> Posterior:
    return Posterior(np.zeros(COUNT), np.diag(np.full(COUNT, 1e-2) ** 2))


def checked(rules: dict, checks: Solution, previous=None) -> dict[str, Check]:
    section = ChecksSection.model_validate(rules)
    return {c.name: c for c in acceptance(section, context(), prior(), [checks], previous or {})}


def rests(*forces) -> Evidence:
    return Evidence("multi_position", tuple(rest(f) for f in forces), ())


def test_gravity_check_uses_the_worst_compensated_rest():
    # z measures 0.03 too much, of which the estimated bias leaves 0.001; x has an error of 0.004
    evidence = rests([0.0, 0.0, G + 0.031], [0.0, 0.0, -G + 0.03], [G + 0.004, 0.0, 0.03])
    check = checked({"gravity_at_rest": {"within": 5e-3}}, solution(evidence, sigma=1e-7, accel_bias_z=0.03))
    checks = check["gravity_at_rest"]
    assert checks.value == pytest.approx(0.004, abs=1e-6)
    assert str(checks.where) == "multi_position rest 2"
    assert checks.passed
    assert not checks.near_miss
    assert checks.margin == pytest.approx(0.001, abs=1e-6)
    tight = checked({"gravity_at_rest": {"within": 4.5e-3}}, solution(evidence, sigma=1e-7, accel_bias_z=0.03))
    assert tight["gravity_at_rest"].near_miss
    missed = checked({"gravity_at_rest": {"within": 3e-3}}, solution(evidence, sigma=1e-7, accel_bias_z=0.03))
    assert not missed["gravity_at_rest"].passed
    assert not missed["gravity_at_rest"].near_miss
    assert missed["gravity_at_rest"].margin < 0.0


@pytest.mark.parametrize(("sigma_z", "limit"), [(1e-5, 5e-3), (1.2e-3, 5e-3), (3e-3, 12e-3)])
def test_force_at_rest_may_differ_from_gravity_by_the_uncertainty_of_the_parameters(sigma_z, limit):
    sigma = np.zeros(COUNT)
    sigma[INDEX["accel_bias_z"]] = sigma_z
    uncertain = replace(solution(rests([0.0, 0.0, G + 0.01])), posterior=Posterior(np.zeros(COUNT), np.diag(sigma**2)))
    check = checked({"gravity_at_rest": {"within": 5e-3}}, uncertain)["gravity_at_rest"]
    assert (check.limit, check.passed) == (pytest.approx(limit, rel=1e-5), limit > 0.01)


@pytest.mark.parametrize(("scale", "limit"), [(-1.0, 5e-3), (1.0, 16e-3)])
def test_uncertainty_of_the_force_at_rest_follows_from_the_covariance(scale, limit):
    # bias and scale factor errors that compensate each other at +z, and add up at -z
    direction = np.zeros(COUNT)
    direction[[INDEX["accel_bias_z"], INDEX["accel_scale_z"]]] = 2e-3, scale * 2e-3 / G
    evidence = rests([0.0, 0.0, G + 0.01])
    joint = replace(solution(evidence), posterior=Posterior(np.zeros(COUNT), np.outer(direction, direction)))
    check = checked({"gravity_at_rest": {"within": 5e-3}}, joint)["gravity_at_rest"]
    assert check.limit == pytest.approx(limit, rel=2e-3)


def test_uncertainty_of_gravity_does_not_increase_the_limit_of_the_force_at_rest():
    direction = np.zeros(COUNT)
    direction[INDEX["accel_bias_z"]] = context().site.relative_gravity_sigma * G
    evidence = rests([0.0, 0.0, G + 1e-6])
    scaled = replace(solution(evidence), posterior=Posterior(np.zeros(COUNT), np.outer(direction, direction)))
    assert checked({"gravity_at_rest": {"within": 1e-9}}, scaled)["gravity_at_rest"].limit < 2e-9


def test_short_pause_is_not_judged_as_a_rest():
    evidence = Evidence("rate", (rest([0, 0, G + 1.0], duration=1.2), rest([0, 0, G])), ())
    assert checked({"gravity_at_rest": {"within": 1e-3}}, solution(evidence))["gravity_at_rest"].passed


def test_improvement_is_judged_by_its_ratio():
    evidence = rests([0.0, 0.0, G + 0.030], [0.0, 0.0, -G + 0.030], [0.0, G, 0.0])
    better = solution(evidence, accel_bias_z=0.02)
    rule = {"improvement_at_rest": {"below": 0.5}}
    # the error decreases from 0.03 to 0.01 at both z rests, and increases from 0 to 2e-5 at the third
    chosen = checked({"improvement_at_rest": {"below": 0.5, "positions": [0, 1]}}, better)["improvement_at_rest"]
    assert chosen.passed
    assert chosen.value == pytest.approx(1.0 / 3.0, abs=1e-6)
    assert (chosen.limit, chosen.unit) == (0.5, "1")
    worse = solution(evidence, accel_bias_z=-0.02)
    assert not checked({"improvement_at_rest": {"below": 0.5, "positions": [0]}}, worse)["improvement_at_rest"].passed
    checks = checked(rule, better)["improvement_at_rest_floor"]
    assert not checks.passed
    assert checks.where == Where(stage="multi_position", rest=2)


def test_improvement_floor_applies_only_to_small_errors_and_is_shown():
    evidence = rests([0.0, 0.0, G + 0.030], [0.0, 0.0, -G + 0.030], [0.0, G, 0.0])
    rule = {"improvement_at_rest": {"below": 0.5, "or_within": 1e-4}}
    checks = checked(rule, solution(evidence, accel_bias_z=0.02))
    assert checks["improvement_at_rest"].value == pytest.approx(1.0 / 3.0, abs=1e-6)
    floor = checks["improvement_at_rest_floor"]
    assert floor.passed
    assert floor.value == pytest.approx(2e-5, rel=0.05)
    assert (floor.limit, floor.unit) == (1e-4, "m/s²")
    assert floor.where == Where(stage="multi_position", rest=2)
    # an error that increases to more than the floor fails
    rule = {"improvement_at_rest": {"below": 0.5, "or_within": 0.02}}
    assert set(checked(rule, solution(evidence, accel_bias_z=0.02))) == {"improvement_at_rest_floor"}
    assert not checked(rule, solution(evidence, accel_bias_z=-0.02))["improvement_at_rest_floor"].passed


def test_improvement_is_relative_to_the_uncalibrated_output():
    evidence = rests([0.0, 0.0, G + 0.030])
    mean = np.zeros(COUNT)
    mean[INDEX["accel_bias_z"]] = 0.03
    section = ChecksSection.model_validate({"improvement_at_rest": {"below": 0.5}})
    before = Posterior(mean, prior().covariance)
    (checks,) = acceptance(section, context(), before, [solution(evidence, accel_bias_z=0.03)], {})
    assert (checks.name, checks.passed) == ("improvement_at_rest", True)
    assert checks.value < 1e-6


def test_failed_check_at_rest_names_the_state_that_the_parameters_do_not_correct():
    evidence = rests([0.0, 0.0, G * (1.0 + 5e-5)], [0.0, 0.0, -G * (1.0 - 5e-5)])
    found = solution(evidence, sigma=1e-7)
    for state, cause in (("accel_asymmetry_z", "accel_asymmetry"), ("accel_cross_xy", None)):
        with_state = replace(found, estimates={state: Estimate(5e-5, 1e-6, "1")})
        (check,) = checked({"gravity_at_rest": {"within": 4e-4, "shortest_rest_s": 1.0}}, with_state).values()
        assert not check.passed
        assert (check.diagnosis.values["state"] if check.diagnosis else None) == cause


def test_level_checks_horizontal_and_vertical_components():
    evidence = rests([0.02, -0.05, G + 0.0045], [0.0, 0.0, -G])
    rule = {"level": {"horizontal_within": 0.04, "vertical_within": 0.005}}
    checks = checked(rule, solution(evidence))
    assert checks["level_horizontal"].value == pytest.approx(0.05)
    assert not checks["level_horizontal"].passed
    assert checks["level_vertical"].value == pytest.approx(0.0045)
    assert checks["level_vertical"].near_miss


def test_level_is_judged_in_the_axes_of_the_platform():
    # body +y is along platform z, body -z along platform x
    evidence = rests([-0.02, G + 0.0045, 0.05])
    section = ChecksSection.model_validate({"level": {"horizontal_within": 0.06, "vertical_within": 0.005}})
    checks = {c.name: c for c in acceptance(section, context("-z+y"), prior(), [solution(evidence)], {})}
    assert checks["level_horizontal"].value == pytest.approx(0.05)
    assert checks["level_vertical"].value == pytest.approx(0.0045)


def test_motions_are_compared_with_the_encoder_if_available():
    turn = np.pi / 2.0
    angles = (np.array([0.0, 0.0]), np.array([turn, 0.0]))
    evidence = Evidence(
        "excitation",
        tuple(rest([0.0, 0.0, G], a) for a in angles),
        (motion(turn, scale=1e-3),),
    )
    rule = {"motion_angle": {"within": 5e-4, "below": 0.3}}
    checks = checked(rule, solution(evidence, gyro_scale_x=0.9e-3))
    assert checks["motion_angle"].value == pytest.approx(1e-4 * turn, rel=0.02)
    assert checks["motion_angle"].passed
    assert checks["motion_angle"].where == Where(stage="excitation", rest=0, to=1)
    assert checks["motion_improvement"].value == pytest.approx(0.1, rel=0.02)
    assert checks["motion_improvement"].limit == 0.3
    assert checks["motion_improvement"].passed
    untouched = checked(rule, solution(evidence))
    assert not untouched["motion_angle"].passed
    assert not untouched["motion_improvement"].passed


def test_manual_motions_are_compared_with_gravity():
    turn = np.pi / 2.0
    evidence = Evidence("multi_position", (rest([0.0, 0.0, G]), rest([0.0, G, 0.0])), (motion(turn, scale=2e-3),))
    rule = {"motion_angle": {"within": 1e-3, "below": 0.5}}
    checks = checked(rule, solution(evidence, gyro_scale_x=2e-3))
    assert checks["motion_angle"].value < 1e-5
    assert checks["motion_improvement"].passed
    assert checked(rule, solution(evidence))["motion_angle"].value == pytest.approx(2e-3 * turn, rel=0.02)


def chain(reference: str = "encoders", broken: bool = False) -> Evidence:
    """Return three 60° rotations about x with a gyro scale factor error of 1e-3, and rests at 0, 60, 120 and 180°."""
    turn = np.pi / 3.0
    places = [k * turn for k in range(4)]
    rests = tuple(
        rest([0.0, G * np.sin(a), G * np.cos(a)], np.array([a, 0.0]) if reference == "encoders" else None)
        for a in places
    )
    motions = tuple(motion(turn, 1e-3, k, k + 1) for k in range(3) if not (broken and k == 1))
    return Evidence("multi_position", rests, motions)


@pytest.mark.parametrize("reference", ["encoders", "gravity"])
def test_any_two_positions_are_compared_with_all_motions_between_them(reference):
    evidence, turn = chain(reference), np.pi / 3.0
    rule = {"motion_angle": {"within": 1.0, "positions": [3, 0]}}
    checks = checked(rule, solution(evidence))["motion_angle"]
    assert checks.value == pytest.approx(3e-3 * turn, rel=0.01)
    assert checks.where == Where(stage="multi_position", rest=0, to=3)
    assert str(checks.where) == "multi_position rest 0 to 3"
    every = checked({"motion_angle": {"within": 1.0, "positions": [0, 1, 3]}}, solution(evidence))["motion_angle"]
    assert every.value == pytest.approx(3e-3 * turn, rel=0.01)
    neighbours = checked({"motion_angle": {"within": 1.0}}, solution(evidence))["motion_angle"]
    assert neighbours.value == pytest.approx(1e-3 * turn, rel=0.01)
    better = checked(rule, solution(evidence, gyro_scale_x=1e-3))["motion_angle"]
    assert better.value < 1e-5
    lost = checked(rule, solution(chain(reference, broken=True)))["motion_angle"]
    assert (lost.passed, lost.where) == (False, checks.where)
    assert np.isnan(lost.value)


@pytest.mark.parametrize(
    ("rules", "where"),
    [
        ({"improvement_at_rest": {"below": 0.9, "positions": [7]}}, "multi_position rest 7"),
        ({"level": {"vertical_within": 5.0, "horizontal_within": 5.0, "position": 7}}, "multi_position rest 7"),
        ({"level": {"vertical_within": 5.0, "position": 7, "stage": "multi_position"}}, "multi_position rest 7"),
        ({"motion_angle": {"within": 1.0, "below": 0.9, "positions": [0, 7]}}, "multi_position rest 0 to 7"),
    ],
)
def test_missing_rest_named_in_a_rule_fails_its_checks(rules, where):
    checks = checked(rules, solution(chain()))
    assert checks
    for check in checks.values():
        assert (check.passed, check.near_miss, str(check.where)) == (False, False, where)
        assert np.isnan(check.value)
    other = {name: {**rule, "stage": "six_position"} for name, rule in rules.items()}
    assert checked(other, solution(chain())) == {}


def test_gravity_can_be_the_reference_despite_encoders():
    wrong = Evidence("multi_position", tuple(replace(r, angles=np.zeros(2)) for r in chain().rests), chain().motions)
    checks = solution(wrong, gyro_scale_x=1e-3)
    assert checked({"motion_angle": {"within": 1.0}}, checks)["motion_angle"].value > 1.0
    assert checked({"motion_angle": {"within": 1.0, "reference": "gravity"}}, checks)["motion_angle"].value < 1e-5


@pytest.mark.parametrize(("scale", "passed"), [(0.0, True), (3e-4, True), (1e-3, False)])
def test_short_rests_are_compared_with_gravity_within_their_noise(scale, passed):
    """Noise of 5e-5 rad at both rests: 4 sigma are 2.8e-4 rad, in addition to the limits."""
    quiet, turn = chain("gravity"), np.pi / 3.0
    noisy = replace(quiet, rests=tuple(replace(r, force_sigma=5e-5 * G) for r in quiet.rests))
    rule = {"motion_angle": {"within": 2e-4, "below": 0.1, "or_within": 2e-4, "reference": "gravity"}}
    checks = checked(rule, solution(noisy, gyro_scale_x=1e-3 - scale))
    noise = 4.0 * np.sqrt(2.0) * 5e-5
    for name in ("motion_angle", "motion_improvement_floor"):
        assert checks[name].value == pytest.approx(scale * turn, rel=0.02, abs=2e-6)
        assert checks[name].limit == pytest.approx(2e-4 + noise)
        assert checks[name].passed is passed
    precise = checked(rule, solution(quiet, gyro_scale_x=1e-3 - scale))
    assert precise["motion_angle"].passed is (scale == 0.0)
    rule["motion_angle"]["reference"] = None
    encoders = replace(chain(), rests=tuple(replace(r, force_sigma=5e-5 * G) for r in chain().rests))
    assert checked(rule, solution(encoders))["motion_angle"].limit == 2e-4


@pytest.mark.parametrize("turns", [0.2, 0.9, 1.0, 2.5])
def test_angle_between_positions_excludes_earth_rate(turns):
    angle, duration, earth = 2.0 * np.pi * turns, 10.0, np.array([0.0, 3e-5, 6e-5])
    inertial = axis_rotation(tuple(earth / np.linalg.norm(earth)), float(np.linalg.norm(earth)) * duration)
    seen = inertial @ axis_rotation(X, angle)
    moved = MotionEvidence(0, 1, duration, angle, seen, np.zeros(COUNT), seen, np.zeros((3, 12)))
    rests = tuple(replace(rest([0.0, 0.0, G], np.array([a, 0.0])), rate=earth, steady_rate=earth) for a in (0.0, angle))
    evidence = Evidence("rate", rests, (moved,))
    assert turn_between(evidence, 0, 1, np.zeros(COUNT)).duration == duration
    assert checked({"motion_angle": {"within": 1e-8}}, solution(evidence))["motion_angle"].passed


def test_change_since_the_last_calibration_reports_the_worst_parameter():
    rule = {"previous": {"change_within": {"gyro_bias": 1e-6, "accel_scale_z": 1e-5}}}
    current = solution(gyro_bias_x=1e-6, gyro_bias_y=-3e-6, accel_scale_z=1e-5)
    checks = checked(rule, current, {"gyro_bias_x": 9e-7, "gyro_bias_y": -1e-6, "accel_scale_z": 8e-6})
    assert checks["previous gyro_bias"].value == pytest.approx(2e-6)
    assert checks["previous gyro_bias"].where == Where("gyro_bias_y")
    assert not checks["previous gyro_bias"].passed
    assert checks["previous accel_scale_z"].passed
    assert checked(rule, current) == {}


def test_excitation_check_requires_sufficient_sigma_reduction():
    checks = checked({"excitation": {"sigma_ratio_below": 0.05}}, solution(estimated=("gyro_bias_x",)))
    assert checks["excitation"].value == pytest.approx(0.01)
    assert checks["excitation"].passed
    assert not checked({"excitation": {"sigma_ratio_below": 0.005}}, solution())["excitation"].passed


def test_offline_result_must_equal_the_online_result():
    row = {"value": 1.0, "sigma": 0.1, "stage": "rate"}
    section = ChecksSection.model_validate({"offline_online": {"within_sigmas": 0.0}})
    assert offline_online(section, {"a": row}, {"a": row})[0].passed
    (checks,) = offline_online(section, {"a": row, "b": row}, {"a": {**row, "value": 1.05}, "b": row})
    assert checks.value == pytest.approx(0.5)
    assert (checks.passed, checks.where) == (False, Where("a"))
    assert offline_online(section, {"a": row}, {"a": {**row, "stage": "excitation"}}) == []
    (checks,) = offline_online(section, {"a": row, "b": row}, {"a": row, "b": {**row, "value": np.nan}})
    assert (checks.passed, checks.where) == (False, Where("b"))


def test_no_check_is_made_without_data():
    rules = {
        "gravity_at_rest": {"within": 1.0},
        "level": {"vertical_within": 1.0},
        "motion_angle": {"within": 1.0},
        "improvement_at_rest": {"below": 0.5},
    }
    assert checked(rules, solution()) == {}
    assert ChecksSection.model_validate(rules).need_samples
    assert not ChecksSection.model_validate({"excitation": {"sigma_ratio_below": 0.5}}).need_samples


def test_misspelled_rule_is_refused():
    for wrong, message in (
        ({"gravity_at_rst": {"within": 1.0}}, "Did you mean 'gravity_at_rest'"),
        ({"previous": {"change_within": {"gyro_bais": 1.0}}}, "Did you mean 'gyro_bias'"),
        ({"gravity_at_rest": {"within": 0.0}}, "greater than 0"),
        ({"improvement_at_rest": {"below": 0.5, "positions": [0, -1]}}, "it must be at least 0"),
        (
            {"gravity_at_rest": {"within": 1e-3}, "improvement_at_rest": {"below": 0.5, "or_within": 2e-3}},
            r"improvement_at_rest\.or_within.*The absolute limit 0.002 is larger than the limit 'within' = 0.001",
        ),
        ({"motion_angle": {"within": 1e-3, "below": 0.5, "or_within": 2e-3}}, r"motion_angle\.or_within"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            validate(ChecksSection, wrong, Path("unit.toml"))


def test_check_has_its_margin_and_a_near_limit_flag():
    def check(value, limit, **more):
        return Check.compare("within", value, limit, "m", subject="accel_bias_x", **more)

    inside = check(0.9, (-1.0, 1.0))
    assert inside.to_json()["margin"] == pytest.approx(0.1)
    assert inside.to_json()["near_miss"] is True
    assert check(0.9, (-1.0, 1.0), near=0.95).near_miss is False
    assert check(-1.5, (-1.0, 1.0)).margin == pytest.approx(-0.5)
    assert not check(-1.5, (-1.0, 1.0)).passed
    assert check(0.0, 0.0).near_miss is False


@pytest.mark.parametrize(
    ("name", "kind", "subject"),
    [
        ("gyro_scale_x within", "within", "gyro_scale_x"),
        ("gyro_scale_x sigma below", "sigma_below", "gyro_scale_x"),
        ("rate consistency", "consistency", "rate"),
        ("unobservable parameters", "unobservable", ""),
        ("latitude", "latitude", ""),
        ("level_vertical", "level_vertical", ""),
        ("previous accel_bias", "previous", "accel_bias"),
        ("a check of the future", "other", "a check of the future"),
    ],
)
def test_check_is_read_back_from_the_result_json(name, kind, subject):
    row = check_row(kind, subject, 1.0, [0.0, 2.0], passed=True, unit="1", margin=1.0, near_miss=False)
    row |= {"where": "rate rest 3 to 17", "at": {"stage": "rate", "rest": 3, "to": 17}}
    check = Check.from_json(row)
    assert (check.kind, check.subject, check.name) == (kind, subject, name)
    assert check.where == Where(stage="rate", rest=3, to=17)
    assert check.to_json() == row


def test_check_of_a_later_version_keeps_its_name():
    row = {"name": "drift of rate", "kind": "drift", "value": 1.0, "limit": 2.0, "unit": "1", "passed": True}
    assert Check.from_json(row).id == ("other", "drift of rate")


def test_check_without_numbers_is_read_from_a_result():
    row = {"name": "rate consistency", "value": None, "limit": None, "unit": "1", "passed": False}
    check = Check.from_json(row)
    assert np.isnan(check.value)
    assert np.isinf(check.limit)
    assert check.where == Where()
