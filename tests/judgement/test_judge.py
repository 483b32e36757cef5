"""Decision between PASS and FAIL for solutions made by hand, case by case."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calstation.config import RunRequest, load_configuration
from calstation.estimation import Diagnosis, ModelTest, Solution
from calstation.estimation.common import Consistency, Posterior
from calstation.judgement import Check, SolvedAgain, compare_only, judge, needs_full_calibration
from calstation.judgement.judge import End, advice, is_partial, verdict_of
from calstation.physics import COUNT, NAMES
from calstation.records import Excitation, LogMeta, PriorSection, Verdict

PRIOR = Posterior(np.zeros(COUNT), np.eye(COUNT))
SOLVED = Solution("rate", Posterior(np.zeros(COUNT), 1e-24 * np.eye(COUNT)), NAMES, Consistency(1.0, 0.9, 1.1, 100))
COARSE = replace(SOLVED, posterior=Posterior(np.zeros(COUNT), 1e-6 * np.eye(COUNT)))
META = load_configuration(RunRequest("SN-1", product=Path("data/products/nav_a.toml"))).log_meta()
assert META.product is not None


def with_product(**changes: Any) -> LogMeta:
    assert META.product is not None
    return META.model_copy(update={"product": META.product.model_copy(update=changes)})


UNLIMITED = META.model_copy(update={"product": None})


class Standard:
    """The outcome of the comparison of a check standard."""

    def __init__(self, passed: bool) -> None:
        self.passed = passed


def test_unit_within_all_limits_passes_and_any_failed_check_fails_it() -> None:
    judgement = judge(META, PRIOR, (SOLVED,))
    assert (judgement.passed, judgement.partial, judgement.tested, judgement.not_compared) == (True, False, True, ())
    far = np.zeros(COUNT)
    far[NAMES.index("gyro_bias_x")] = 1.0
    judgement = judge(META, PRIOR, (replace(SOLVED, posterior=Posterior(far, SOLVED.posterior.covariance)),))
    assert judgement.passed is False
    assert {check.subject for check in judgement.checks if check.kind == "within" and not check.passed} == {
        "gyro_bias_x"
    }
    assert judge(META, PRIOR, (COARSE,)).passed is False


def test_run_without_a_solution_fails() -> None:
    judgement = judge(with_product(checks=None), PRIOR, ())
    assert judgement.passed is False
    assert "gyro_bias_x" in judgement.not_compared


def test_run_without_limits_neither_passes_nor_fails() -> None:
    assert judge(UNLIMITED, PRIOR, (SOLVED,)).passed is None
    assert judge(with_product(limits={}, checks=None), PRIOR, (SOLVED,)).passed is None
    assert judge(with_product(limits={}), PRIOR, (SOLVED,)).passed is True, "acceptance checks are limits"
    assert judge(with_product(checks=None), PRIOR, (SOLVED,)).passed is True


def test_check_standard_must_pass_its_comparison() -> None:
    for passed in (True, False):
        judgement = judge(META, PRIOR, (SOLVED,), standard=Standard(passed))  # type: ignore[arg-type]
        assert judgement.passed is passed
        assert judgement.standard is not None


def test_part_of_a_log_solved_again_may_fail_but_not_pass() -> None:
    assert judge(META, PRIOR, (SOLVED,), again=SolvedAgain()).passed is True
    assert judge(META, PRIOR, (SOLVED,), again=SolvedAgain(complete=False)).passed is None
    assert judge(META, PRIOR, (COARSE,), again=SolvedAgain(complete=False)).passed is False
    (failed, *_) = [check for check in judge(META, PRIOR, (COARSE,)).checks if not check.passed]
    again = judge(META, PRIOR, (SOLVED,), again=SolvedAgain(online=(failed,)))
    assert again.passed is False, "unlike the result of the run"
    assert again.checks[-1] == failed
    assert failed not in judge(UNLIMITED, PRIOR, (SOLVED,), again=SolvedAgain(online=(failed,))).checks


def test_log_with_impossible_gravity_solved_again_does_not_pass() -> None:
    meta = META.model_copy(update={"site": META.site.model_copy(update={"gravity_mps2": 9.0})})
    assert judge(meta, PRIOR, (SOLVED,), again=SolvedAgain()).passed is None


def test_stages_solved_again_are_partial_if_some_are_missing() -> None:
    assert judge(META, PRIOR, (SOLVED,), again=SolvedAgain()).partial is True
    assert META.run is not None
    assert is_partial(META, META.run.stages) is False
    assert is_partial(META, [*META.run.stages, "other"]) is False
    assert is_partial(META, META.run.stages[1:]) is True
    assert is_partial(META.model_copy(update={"run": META.run.model_copy(update={"stages": ["rate"]})})) is True
    assert is_partial(META.model_copy(update={"run": None})) is False
    assert is_partial(META.model_copy(update={"profiles": {}}), ["rate"]) is False


def test_stages_of_the_product_replace_the_default_ones() -> None:
    assert META.run is not None
    run = META.run.model_copy(update={"stages": ["rate", "six_position"]})
    meta = META.model_copy(update={"run": run})
    for stages, partial in (('["rate"]', False), ('["rate", "excitation"]', True)):
        product = {**meta.profiles, "product": f"stages = {stages}"}
        assert is_partial(meta.model_copy(update={"profiles": product})) is partial


def moved(**values: float) -> Solution:
    """A solution with other values of some parameters."""
    mean = np.array([values.get(name, 0.0) for name in NAMES])
    return replace(SOLVED, posterior=Posterior(mean, SOLVED.posterior.covariance))


def calibrated(meta: LogMeta) -> LogMeta:
    """Return the configuration of a run that starts from the current calibration of the unit."""
    assert meta.run is not None
    return meta.model_copy(update={"run": meta.run.model_copy(update={"calibration": "run 1"})})


def test_only_stated_priors_other_than_the_current_calibration_are_compared() -> None:
    rows = {"gyro_bias_x": PriorSection(value=0.0, sigma=1.0), "gyro_bias_y": PriorSection(value=0.0)}
    meta = META.model_copy(update={"prior": rows})
    for solution, passed in ((moved(gyro_bias_x=20.0), False), (moved(gyro_bias_y=20.0), True)):
        (check,) = [check for check in judge(meta, PRIOR, (solution,)).checks if check.kind == "prior"]
        assert (check.where.parameter, check.passed) == ("gyro_bias_x", passed)
    assert "prior" not in {check.kind for check in judge(calibrated(meta), PRIOR, (SOLVED,)).checks}


def test_the_excitation_is_checked_unless_the_unit_was_calibrated_before() -> None:
    assert META.product is not None
    assert META.product.checks is not None
    meta = with_product(checks=META.product.checks.model_copy(update={"excitation": Excitation(sigma_ratio_below=0.5)}))
    kinds = [{check.kind for check in judge(each, PRIOR, (SOLVED,)).checks} for each in (meta, calibrated(meta))]
    assert [("excitation" in each) for each in kinds] == [True, False]


def test_comparison_without_tests_has_values_and_sigmas_only() -> None:
    judgement = compare_only(META, PRIOR, (COARSE,))
    assert (judgement.passed, judgement.tested, judgement.partial) == (None, False, True)
    assert {check.kind for check in judgement.checks} == {"within", "sigma_below"}
    assert compare_only(UNLIMITED, PRIOR, (COARSE,)).checks == ()


def test_sigma_that_gravity_alone_exceeds_names_gravity_as_its_cause() -> None:
    assert META.product is not None
    limits = META.product.limits
    narrow = limits["accel_scale"].model_copy(update={"sigma_below": 1e-9, "within": 1e-9})
    meta = with_product(limits={**limits, "accel_scale": narrow})
    values = [check for check in judge(meta, PRIOR, (COARSE,)).checks if check.kind == "within"]
    assert {check.diagnosis for check in values} == {None}, "of values, gravity is not the cause"
    causes = {c.subject: c.diagnosis for c in judge(meta, PRIOR, (COARSE,)).checks if c.kind == "sigma_below"}
    gravity = causes["accel_scale_x"]
    assert gravity is not None
    assert gravity.cause == "gravity_uncertain"
    assert gravity.values["parameter"] == "accel_scale_x"
    assert gravity.size == pytest.approx(gravity.values["sigma_ppm"] * 1e-6)
    assert causes["gyro_bias_x"] is None


def test_noise_is_the_cause_of_sigmas_that_it_explains_if_no_other_cause_is_known() -> None:
    noises = [
        ModelTest(kind, value, 5.0, "1", Diagnosis(kind)) for kind, value in (("table_noise", 2.0), ("imu_noise", 3.0))
    ]
    limit = 9.7e-08
    for factor, cause in ((2.9, "imu_noise"), (3.1, None)):
        covariance = SOLVED.posterior.covariance.copy()
        covariance[0, 0] = (factor * limit) ** 2
        solution = replace(SOLVED, posterior=Posterior(np.zeros(COUNT), covariance), tests=tuple(noises))
        checks = judge(META, PRIOR, (solution,)).checks
        (sigma,) = [c for c in checks if c.kind == "sigma_below" and not c.passed]
        assert sigma.subject == NAMES[0]
        assert (sigma.diagnosis and sigma.diagnosis.cause) == cause


def test_the_larger_noise_is_the_cause_up_to_its_ratio_to_the_profile() -> None:
    assert META.product is not None
    covariance = SOLVED.posterior.covariance.copy()
    covariance[0, 0] = 0.375**2
    limits = {NAMES[0]: META.product.limits["gyro_bias"].model_copy(update={"sigma_below": 0.125, "within": 1.0})}
    for kind, other in (("table_noise", "imu_noise"), ("imu_noise", "table_noise")):
        tests = tuple(ModelTest(k, value, 5.0, "1", Diagnosis(k)) for k, value in ((kind, 3.0), (other, 2.0)))
        solution = replace(SOLVED, posterior=Posterior(np.zeros(COUNT), covariance), tests=tests)
        checks = judge(with_product(limits=limits, checks=None), PRIOR, (solution,)).checks
        (sigma,) = [check for check in checks if check.kind == "sigma_below"]
        assert sigma.diagnosis is not None
        assert sigma.diagnosis.cause == kind, "three times the limit, with three times the noise"


def test_only_a_completed_run_that_passed_and_lacks_no_stage_is_a_pass() -> None:
    assert verdict_of(End.COMPLETED, True, partial=False) is Verdict.PASSED
    assert verdict_of(End.COMPLETED, True, partial=True) is Verdict.PARTIAL
    assert verdict_of(End.COMPLETED, False, partial=True) is Verdict.FAILED
    assert verdict_of(End.COMPLETED, None, partial=False) is Verdict.UNDETERMINED
    assert verdict_of(End.STOPPED, True, partial=False) is Verdict.STOPPED


def test_partial_run_needs_a_full_calibration_unless_a_failed_check_has_another_cause() -> None:
    sigma = Check("sigma_below", "accel_bias_z", 2.0, 1.0, "1", False)
    value, other = replace(sigma, kind="within"), replace(sigma, kind="within", subject="accel_bias_x")
    force = Check("gravity_at_rest", "", 2.0, 1.0, "m/s²", False)  # its limit allows for the sigmas
    inconsistent = Check("consistency", "azimuth_flip", 2.0, 1.0, "1", False)
    tilted = Check("effects", "azimuth_flip", 2.0, 1.0, "1", False, diagnosis=Diagnosis("tilt"))
    changed = replace(sigma, kind="change")
    assert needs_full_calibration([sigma, value, replace(inconsistent, passed=True)], partial=True)
    assert needs_full_calibration([changed], partial=True)
    assert not needs_full_calibration([sigma, value], partial=False)
    for checks in (
        [value],
        [sigma, other],
        [sigma, force],
        [sigma, inconsistent],
        [sigma, tilted],
        [replace(sigma, passed=True)],
    ):
        assert not needs_full_calibration(checks, partial=True), checks


def test_advice_ends_with_setting_the_unit_aside() -> None:
    product = load_configuration(RunRequest("SN-1", product=Path("data/products/nav_a.toml"))).product
    product = product.model_copy(update={"attempts_allowed": 3, "advice": ["reseat", "repeat"]})
    taken = [advice(product, Verdict.FAILED, failures, resumable=True) for failures in (1, 2, 3)]
    assert taken == ["reseat", "repeat", "set_aside"]
    unlimited = product.model_copy(update={"attempts_allowed": None})
    assert advice(unlimited, Verdict.FAILED, 9, resumable=False) == "repeat"
    assert [advice(product, Verdict.STOPPED, 1, resumable=resumable) for resumable in (True, False)] == [
        "resume",
        "repeat",
    ]
    assert advice(product, Verdict.PASSED, 0, resumable=True) is None


@pytest.mark.parametrize(("ratio", "cause"), [(1.1, None), (2.5, "table_vibrates")])
def test_noise_that_is_hardly_larger_than_stated_is_no_cause_of_a_large_sigma(ratio: float, cause: str | None) -> None:
    noisy = ModelTest("table_noise", ratio, 3.3, "1", Diagnosis("table_vibrates", 1e-6, unit="m/s"))
    assert META.product is not None
    i, limit = NAMES.index("gyro_bias_x"), META.product.limits["gyro_bias"].sigma_below or 0.0
    covariance = SOLVED.posterior.covariance.copy()
    covariance[i, i] = (1.05 * limit) ** 2
    judgement = judge(META, PRIOR, (replace(SOLVED, posterior=Posterior(np.zeros(COUNT), covariance), tests=(noisy,)),))
    (check,) = (check for check in judgement.checks if not check.passed)
    assert (check.kind, check.subject) == ("sigma_below", "gyro_bias_x")
    assert (check.diagnosis and check.diagnosis.cause) == cause
