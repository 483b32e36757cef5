"""Noise of accelerometers that is not measurable at short rests on a table as in its profile."""

import pytest

from tests.outside.sweep import Case, run


@pytest.mark.parametrize("simulator", ["bench", "plain"])
@pytest.mark.parametrize(("ratio", "passes"), [(1.0, True), (2.0, True), (3.7, False)])
def test_noise_of_the_accelerometers_widens_the_sigmas_or_is_named(simulator, ratio, passes):
    found = run(Case("accel_noise", ratio, 1, "nav", simulator=simulator))
    assert found.worst < (4.5 if passes else 6.0)
    assert found.passed == passes
    assert found.cause == "" if passes else found.cause.endswith("imu noise: imu_noise")
