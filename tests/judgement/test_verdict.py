"""The verdict follows from the judgement and the end of the run; the result JSON and the next action follow from it."""

from dataclasses import replace
from typing import Any

import pytest

from calstation.config import ProductConfig, library, load_product
from calstation.estimation import Diagnosis
from calstation.judgement import Check, End, advice, remedy_of, verdict_of
from calstation.judgement.judge import _OF_MOUNTING, _OF_TIME
from calstation.messages import entry
from calstation.records import Verdict
from calstation.results import Result

RESULT: dict[str, Any] = {"unit": {"serial": "SN-1"}, "stages": [], "parameters": {}, "log": {"file": "a.h5"}}


@pytest.mark.parametrize(
    ("passed", "partial", "verdict"),
    [
        (True, False, Verdict.PASSED),
        (True, True, Verdict.PARTIAL),
        (False, False, Verdict.FAILED),
        (False, True, Verdict.FAILED),
        (None, False, Verdict.UNDETERMINED),
        (None, True, Verdict.UNDETERMINED),
    ],
)
def test_completed_run_has_the_verdict_of_its_values(passed: bool | None, partial: bool, verdict: Verdict) -> None:
    assert verdict_of(End.COMPLETED, passed, partial=partial) is verdict
    assert verdict.passed is passed
    assert verdict.judged


@pytest.mark.parametrize("end", [End.STOPPED, End.FAULT, End.INCOMPLETE])
@pytest.mark.parametrize("passed", [True, False, None])
def test_run_that_did_not_reach_its_end_never_passes(end: End, passed: bool | None) -> None:
    verdict = verdict_of(end, passed, partial=False)
    assert (verdict.value, verdict.passed, verdict.judged) == (end.value, False, False)


@pytest.mark.parametrize("verdict", [verdict for verdict in Verdict if verdict is not Verdict.UNDETERMINED])
def test_verdict_is_read_back_from_the_result_json(verdict: Verdict) -> None:
    partial = verdict is Verdict.PARTIAL
    row = {**RESULT, "schema": "calstation.result/1", "outcome": verdict.outcome, "passed": verdict.passed}
    assert Result.from_json({**row, "partial": partial}).verdict is verdict


@pytest.mark.parametrize("passed", [True, False, None])
def test_log_that_was_solved_again_has_a_verdict(passed: bool | None) -> None:
    row = {**RESULT, "schema": "calstation.result/1", "outcome": "resolved", "passed": passed, "partial": False}
    assert Result.from_json(row).verdict.passed is passed


@pytest.fixture
def product() -> ProductConfig:
    """A product whose units are set aside after the third failure."""
    loaded = load_product(library.find("products", "nav_a"))[1]
    return loaded.model_copy(update={"advice": ["reseat", "repeat"], "attempts_allowed": 3})


@pytest.mark.parametrize(
    ("verdict", "failures", "resumable", "action"),
    [
        (Verdict.PASSED, 0, True, None),
        (Verdict.PARTIAL, 0, False, None),
        (Verdict.FAILED, 1, True, "reseat"),
        (Verdict.FAILED, 2, False, "repeat"),
        (Verdict.FAILED, 3, False, "set_aside"),
        (Verdict.FAULT, 0, True, "resume"),
        (Verdict.STOPPED, 2, False, "repeat"),
    ],
)
def test_next_action_follows_from_the_verdict(
    product: ProductConfig, verdict: Verdict, failures: int, resumable: bool, action: str | None
) -> None:
    assert advice(product, verdict, failures, resumable=resumable) == action


def test_failed_unit_with_a_stage_ended_by_hand_is_not_reseated(
    product: ProductConfig,
) -> None:
    assert advice(product, Verdict.FAILED, 1, resumable=False, shortened=True) == "repeat"
    assert advice(product, Verdict.PASSED, 0, resumable=False, shortened=True) is None
    assert advice(product, Verdict.FAILED, 1, resumable=False, remedy="full_calibration") == "full_calibration"
    assert advice(product, Verdict.PASSED, 0, resumable=False, remedy="full_calibration") is None
    limited = product.model_copy(update={"attempts_allowed": 1})
    assert advice(limited, Verdict.FAILED, 1, resumable=False, remedy="ask_engineer") == "ask_engineer"
    assert advice(limited, Verdict.FAILED, 1, resumable=False, shortened=True) == "set_aside"
    assert advice(product, Verdict.FAILED, 1, resumable=False, shortened=True, remedy="ask_engineer") == "repeat"


@pytest.mark.parametrize(
    ("causes", "actions"),
    [
        ((None,), ["reseat", "repeat", "set_aside"]),
        (("mount_unlike",), ["reseat", "repeat", "set_aside"]),
        (("spikes",), ["reseat", "repeat", "set_aside"]),
        (("excess_shift",), ["reseat", "repeat", "set_aside"]),
        (("drift",), ["repeat", "repeat", "set_aside"]),
        (("temperature_changed",), ["repeat", "repeat", "set_aside"]),
        (("samples_lost",), ["repeat", "repeat", "set_aside"]),
        (("sample_clock",), ["ask_engineer"] * 3),
        (("clipped",), ["ask_engineer"] * 3),
        (("latitude_unlike",), ["ask_engineer"] * 3),
        (("gravity_uncertain",), ["ask_engineer"] * 3),
        (("g_sensitivity",), ["ask_engineer"] * 3),
        ((None, "sample_clock", "excess_shift"), ["ask_engineer"] * 3),
        (("spikes", "sample_clock"), ["reseat", "repeat", "set_aside"]),
    ],
)
def test_advice_follows_from_the_first_cause(
    product: ProductConfig, causes: tuple[str | None, ...], actions: list[str]
) -> None:
    passed = Check("effects", "rate", 1.0, 2.0, "1", passed=True)
    diagnoses = (None if cause is None else Diagnosis(cause) for cause in causes)
    checks = [passed, *(replace(passed, passed=False, diagnosis=diagnosis) for diagnosis in diagnoses)]
    remedy = remedy_of(checks, partial=False)
    taken = [advice(product, Verdict.FAILED, failures, resumable=False, remedy=remedy) for failures in (1, 2, 3)]
    assert taken == actions


def test_causes_that_are_not_for_an_engineer_are_in_the_catalogue() -> None:
    for cause in _OF_MOUNTING | _OF_TIME:
        assert entry(f"cause.{cause}").remedy
