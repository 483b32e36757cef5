"""A gyro scale factor that warms up in a fast schedule is detected before its error exceeds what the product allows."""

import pytest

from calstation.bench.truth import GradeName
from tests.outside.sweep import Case, run

#: Fast products, and a warm-up that causes an error of 1.3 to 2.4 times the limit of the scale factor.
WARM_UPS = (("nav", "nav_a_fast", 40.0), ("tactical", "tactical_b_fast", 600.0), ("mems", "mems_c_fast", 6500.0))


@pytest.mark.parametrize(("grade", "product", "ppm"), WARM_UPS)
@pytest.mark.parametrize("axis", ["x", *(pytest.param(axis, marks=pytest.mark.long) for axis in "yz")])
def test_warm_up_of_a_gyro_scale_factor_is_named(grade: GradeName, product: str, ppm: float, axis: str) -> None:
    found = run(Case(f"warm_up_gyro_scale_ppm.{axis}", ppm, 3, grade, product=product))
    assert "designed effects" in found.failed
    assert found.cause == f"designed effects: drift_throughout gyro_scale_{axis}"


@pytest.mark.parametrize(("grade", "product", "ppm"), WARM_UPS)
def test_sound_unit_passes_a_fast_schedule(grade: GradeName, product: str, ppm: float) -> None:
    found = run(Case(seed=3, grade=grade, product=product))
    assert (found.passed, found.cause) == (True, "")
    assert found.worst < 4.5
