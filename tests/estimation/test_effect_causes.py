"""The likeliest effect is named as the cause only if its size is plausible and nothing significant remains with it."""

from dataclasses import replace

import numpy as np
import pytest

from calstation.estimation.common import BatchGain, ImuModel, Posterior
from calstation.estimation.effects import (
    EffectEvidence,
    EffectTests,
    StageEffects,
    StateEvidence,
    effect_tests,
    plausible_changes,
)
from calstation.physics import COUNT, INDEX, NAMES, PARAMETERS

SIGMA = np.array([p.prior_sigma for p in PARAMETERS])
MEMS = ImuModel("SIM", 100.0, "increment", 1e-6, 2e-5, 4.4e-5, 5.9e-4)
PLAUSIBLE = plausible_changes(MEMS, {})
OBSERVATIONS = 900
EFFECTS_OF_STAGE = StageEffects(0.0, 100.0)
COLUMNS = [
    (effect.cause, effect.parameter_of(k) or component)
    for effect in EFFECTS_OF_STAGE.candidates
    for k, component in enumerate(effect.components)
]


def score_tests_of(
    sizes: dict[tuple[str, str], float],
    sensitivity: dict[str, float],
    states: tuple[str, ...] = (),
    alike: tuple[tuple[str, str], tuple[str, str], float] | None = None,
) -> tuple[EffectTests, Posterior]:
    """Return the tests after one stage of independent observations, and its posterior.

    Each effect appears in random observations in units of their noise: `sensitivity` per unit of its size, by cause,
    0 without. `sizes` are those in the data, by cause and component or parameter; of a change the first column counts.
    The second effect of `alike` appears like the first, with this correlation.
    """
    random = np.random.default_rng(7)
    H = random.normal(size=(OBSERVATIONS, COUNT)) / SIGMA
    added = random.normal(size=(OBSERVATIONS, len(COLUMNS)))
    if alike is not None:
        first, second = (COLUMNS.index(column) for column in alike[:2])
        added[:, second] = alike[2] * added[:, first] + np.sqrt(1.0 - alike[2] ** 2) * added[:, second]
    added *= [sensitivity.get(cause, 0.0) / np.sqrt(OBSERVATIONS) for cause, _ in COLUMNS]
    y = random.normal(size=OBSERVATIONS)
    for column, size in sizes.items():
        y += size * added[:, COLUMNS.index(column)]
    S = H @ np.diag(SIGMA**2) @ H.T + np.eye(OBSERVATIONS)
    K = np.linalg.solve(S, H @ np.diag(SIGMA**2)).T
    tests = EffectTests(PLAUSIBLE, states)
    gain = EFFECTS_OF_STAGE.batch_sensitivity(BatchGain(H, K, S, y), added, np.ones(COUNT, dtype=bool))
    tests.add("a stage", gain, NAMES)
    return tests, Posterior(K @ y, np.diag(SIGMA**2) - K @ H @ np.diag(SIGMA**2))


def evidence_of(sizes: dict[tuple[str, str], float], sensitivity: dict[str, float]) -> list[EffectEvidence]:
    """Return the evidence in the observations of `score_tests_of`."""
    tests, posterior = score_tests_of(sizes, sensitivity)
    return tests.evidence(posterior)


def causes(evidence: list[EffectEvidence]) -> list[str]:
    """Return the causes of the tests for effects."""
    return [test.diagnosis.cause for test in effect_tests(evidence) if test is not None and test.value > test.limit]


def test_single_effect_is_named_and_explains_the_data() -> None:
    evidence = evidence_of({("time_skew", ""): 1e-3}, {"time_skew": 2e4, "accel_cubic": 1e8})
    assert causes(evidence) == ["time_skew"]
    assert evidence[0].remaining is not None
    assert evidence[0].remaining.excess < 15.0


def test_second_effect_that_remains_is_no_single_effect() -> None:
    sizes = {("time_skew", ""): 1e-3, ("accel_cubic", "y"): 2e-7}
    evidence = evidence_of(sizes, {"time_skew": 2e4, "accel_cubic": 1e8})
    assert evidence[0].cause == "time_skew"
    assert evidence[0].remaining is not None
    assert (evidence[0].remaining.cause, evidence[0].remaining.excess > 200.0) == ("accel_cubic", True)
    assert causes(evidence) == ["no_single_effect"]


def test_jump_that_contradicts_the_stability_does_not_explain_the_data() -> None:
    weak = {"jump": 0.3 / PLAUSIBLE[INDEX["gyro_scale_y"]]}
    jump = 10.0 / weak["jump"]  # ten sigmas: 33 times the plausible size
    assert causes(evidence_of({("jump", "gyro_scale_y"): jump}, weak)) == []
    strong = {"jump": 20.0 / PLAUSIBLE[INDEX["gyro_scale_y"]]}
    plausible = evidence_of({("jump", "gyro_scale_y"): 100.0 / strong["jump"]}, strong)
    assert (plausible[0].cause, plausible[0].parameter, causes(plausible)) == ("jump", "gyro_scale_y", ["jump"])


@pytest.mark.parametrize(("times", "cause"), [(5.0, "time_skew"), (20.0, "no_single_effect")])
def test_implausible_size_is_no_cause(times: float, cause: str) -> None:
    assert causes(evidence_of({("time_skew", ""): 0.02 * times}, {"time_skew": 2e4})) == [cause]


def test_plausible_changes_follow_the_stated_stability_and_otherwise_the_noise() -> None:
    stated = plausible_changes(MEMS, {"gyro_bias": 1e-5, "gyro_scale_z": 2e-4})
    assert stated[INDEX["gyro_bias_x"]] == pytest.approx(1e-3)
    assert stated[INDEX["gyro_scale_z"]] == pytest.approx(2e-2)
    assert stated[INDEX["gyro_scale_x"]] == PLAUSIBLE[INDEX["gyro_scale_x"]] == pytest.approx(4.4e-3, rel=0.01)
    assert PLAUSIBLE[INDEX["gyro_bias_x"]] == pytest.approx(4.4e-4, rel=0.01)
    assert PLAUSIBLE[INDEX["accel_bias_x"]] == pytest.approx(1.77e-2, rel=0.01)
    drifting = plausible_changes(ImuModel("SIM", 100.0, "rate", 1e-6, 2e-5, 4.4e-5, 5.9e-4, 1e-4, 1e-3), {})
    assert drifting[INDEX["gyro_bias_x"]] == pytest.approx(1e-2)
    assert drifting[INDEX["accel_bias_x"]] == pytest.approx(0.3)


SKEW, CUBIC = ("time_skew", ""), ("accel_cubic", "x")
SENSITIVITY = {"time_skew": 2e4, "accel_cubic": 1e8}


def with_shift(evidence: StateEvidence, sigmas: float) -> StateEvidence:
    """Return the evidence with a parameter that every other effect shifts by some sigmas more than the state."""
    base = evidence.state.parameter_shift
    shifted = {**base, "gyro_bias_x": base["gyro_bias_x"] + sigmas}
    return StateEvidence(evidence.state, [replace(other, parameter_shift=shifted) for other in evidence.others])


@pytest.mark.parametrize(
    ("effect", "sigmas", "fails", "alike"),
    [(SKEW, 5.0, True, []), (SKEW, 1.0, None, ["time_skew"]), (CUBIC, 5.0, False, []), (CUBIC, 1.0, None, [])],
)
def test_state_that_absorbs_another_effect_fails(
    effect: tuple[str, str], sigmas: float, fails: bool | None, alike: list[str]
) -> None:
    """The state accel_cubic resembles time_skew: right if the data contain it, wrong if they contain time_skew."""
    size = {SKEW: 1e-3, CUBIC: 2e-7}[effect]
    tests, posterior = score_tests_of({effect: size}, SENSITIVITY, ("accel_cubic",), (SKEW, CUBIC, 0.98))
    assert tests.evidence(posterior)[0].excess < 30.0  # the state has absorbed it
    (evidence,) = tests.state_evidence(posterior)
    changed = with_shift(evidence, sigmas)
    assert (None if changed.test is None else changed.test.value > changed.test.limit) is fails
    assert [other.cause for other in changed.alike] == alike
    if fails:
        assert changed.test.diagnosis.values["other"] == "time_skew"
        assert changed.test.diagnosis.parameter_shift["gyro_bias_x"] == pytest.approx(-sigmas)


def test_state_without_evidence_has_no_alternatives() -> None:
    tests, posterior = score_tests_of({}, SENSITIVITY, ("accel_cubic",))
    (evidence,) = tests.state_evidence(posterior)
    assert (with_shift(evidence, 5.0).test, with_shift(evidence, 0.0).alike) == (None, [])


def test_lever_arms_are_uncertain_by_half_the_displacement_of_the_accelerometers() -> None:
    tests, posterior = score_tests_of({("accel_off_axis", "z"): 4e-3}, {"accel_off_axis": 1e4}, ("accel_off_axis",))
    estimate = tests.estimate()
    widened = (
        estimate.correct(posterior).covariance
        - replace(estimate, gauge=np.zeros((COUNT, COUNT))).correct(posterior).covariance
    )
    outer, inner = INDEX["outer_lever_z"], INDEX["inner_lever_z"]
    half_rms = 0.5 * 4e-3 / np.sqrt(3.0)
    assert np.sqrt([widened[outer, outer], widened[inner, inner]]) == pytest.approx(half_rms, rel=0.1)
    assert widened[outer, inner] == pytest.approx(-widened[outer, outer])
    assert not widened[INDEX["gyro_bias_x"]].any()
