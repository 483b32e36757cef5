"""Model tests of a solution and the resulting checks."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calstation.config import RunRequest, load_configuration
from calstation.estimation import Diagnosis, ModelTest, Solution
from calstation.estimation.common import Consistency, LatitudeEstimate, Posterior
from calstation.judgement import ModelTests, check_limits, judge
from calstation.physics import COUNT, NAMES
from calstation.records import MODEL_KINDS

PRIOR = Posterior(np.zeros(COUNT), np.eye(COUNT))
SOLVED = Solution("rate", Posterior(np.zeros(COUNT), 0.01 * np.eye(COUNT)), NAMES, Consistency(1.0, 0.9, 1.1, 100))
FOUND = ModelTest("effects", 50.0, 30.0, "1", Diagnosis("gyro_cubic"))


@pytest.mark.parametrize(("message", "failed"), [("not_converged", ["rate convergence"]), ("turns_assumed_whole", [])])
def test_solution_that_did_not_converge_fails(message: str, failed: list[str]) -> None:
    solution = replace(SOLVED, messages=((message, {"stage": "rate", "passes": 20}),))
    tested = ModelTests(PRIOR.sigma, ()).add_tests(solution, (), PRIOR)
    assert [check.name for check in check_limits({}, PRIOR, [tested]) if not check.passed] == failed


def test_only_the_last_test_for_effects_counts() -> None:
    first, last = replace(SOLVED, tests=(FOUND,)), replace(SOLVED, stage="excitation")
    assert all(check.passed for check in check_limits({}, PRIOR, [first, last]))
    failed = [check.name for check in check_limits({}, PRIOR, [last, first]) if not check.passed]
    assert failed == ["rate effects"]


@pytest.mark.parametrize(("nis", "failed"), [(1.0, []), (2.0, ["rate effects", "rate consistency"])])
def test_harmless_effect_only_explains_other_failures(nis: float, failed: list[str]) -> None:
    solution = replace(SOLVED, consistency=replace(SOLVED.consistency, nis_mean=nis), explanation=FOUND)
    meta = load_configuration(RunRequest("SN-1", product=Path("data/products/nav_a.toml"))).log_meta()
    checks = judge(meta, PRIOR, (solution,)).checks
    assert [check.name for check in checks if check.kind in ("effects", "consistency") and not check.passed] == failed


@pytest.mark.parametrize(
    ("cause", "first"), [("no_single_effect", ["latitude_unlike", "heading_unlike"]), ("drift", ["drift"])]
)
def test_latitude_and_heading_come_first_unless_an_effect_explains_the_data(cause: str, first: list[str]) -> None:
    meta = load_configuration(RunRequest("SN-1", product=Path("data/products/nav_a.toml"))).log_meta()
    effect, heading = (
        ModelTest(kind, 50.0, 30.0, "1", Diagnosis(name))
        for kind, name in (("effects", cause), ("start_attitude", "heading_unlike"))
    )
    latitude = LatitudeEstimate(np.deg2rad(meta.site.latitude_deg + 1.0), np.deg2rad(0.01))
    solution = replace(SOLVED, tests=(effect, heading), latitude=latitude)
    causes = [check.diagnosis.cause for check in judge(meta, PRIOR, (solution,)).checks if check.diagnosis is not None]
    assert causes[: len(first)] == first
    assert sorted(causes) == sorted([cause, "latitude_unlike", "heading_unlike"])


def test_heading_that_is_far_off_comes_before_every_effect() -> None:
    meta = load_configuration(RunRequest("SN-1", product=Path("data/products/nav_a.toml"))).log_meta()
    effect = ModelTest("effects", 5000.0, 30.0, "1", Diagnosis("g_sensitivity"))
    for heading, first in ((np.pi, "heading_wrong"), (0.11, "g_sensitivity")):
        test = ModelTest("heading", heading, 0.1, "rad", Diagnosis("heading_wrong"))
        checks = judge(meta, PRIOR, (replace(SOLVED, tests=(effect, test)),)).checks
        assert next(check.diagnosis.cause for check in checks if check.diagnosis is not None) == first


def test_heading_comes_before_its_consequences_and_after_other_causes() -> None:
    """At three times its limit it is not far off; a passed test of effects names none; faults of the data remain."""
    meta = load_configuration(RunRequest("SN-1", product=Path("data/products/nav_a.toml"))).log_meta()
    heading = ModelTest("heading", 0.75, 0.25, "rad", Diagnosis("heading_wrong"))
    effect = ModelTest("effects", 5000.0, 30.0, "1", Diagnosis("g_sensitivity"))
    passed = ModelTest("effects", 5.0, 30.0, "1", Diagnosis("g_sensitivity"))
    clipping = ModelTest("clipping", 9.0, 5.0, "1", Diagnosis("clipped"))
    noise = ModelTest("table_noise", 9.0, 5.0, "1", Diagnosis("table_noise"))
    for tests, causes in (
        ((effect, heading), ["g_sensitivity", "heading_wrong"]),
        ((passed, noise, heading), ["heading_wrong", "table_noise"]),
        ((clipping, noise, heading), ["clipped", "heading_wrong", "table_noise"]),
    ):
        checks = judge(meta, PRIOR, (replace(SOLVED, tests=tests),)).checks
        assert [check.diagnosis.cause for check in checks if check.diagnosis is not None] == causes


def test_documentation_describes_every_kind_of_test() -> None:
    text = Path("docs/explanation/estimation.md").read_text(encoding="utf-8")
    described = text.partition("### Tests of the model")[2].partition("\n## ")[0]
    assert {kind for kind in MODEL_KINDS if f"`{kind.replace('_', ' ')}`" not in described} == set()
    assert f"tests of {('fourteen', 'fifteen', 'sixteen', 'seventeen')[len(MODEL_KINDS) - 14]} kinds" in described
