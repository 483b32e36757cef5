"""Noise of accelerometers that is not measurable at short rests on a table as in its profile."""

import pytest

from tests.outside.sweep import Case, run


@pytest.mark.parametrize(
    ("ratio", "passes", "simulator"),
    [
        (3.7, False, "bench"),
        *(
            pytest.param(ratio, ratio < 3.0, simulator, marks=mark)
            for ratio, simulator, mark in (
                (1.0, "bench", pytest.mark.exhaustive),
                (1.0, "plain", pytest.mark.long),
                (2.0, "bench", pytest.mark.long),
                (2.0, "plain", pytest.mark.exhaustive),
                (3.7, "plain", pytest.mark.exhaustive),
            )
        ),
    ],
)
def test_noise_of_the_accelerometers_widens_the_sigmas_or_is_named(ratio, passes, simulator):
    found = run(Case("accel_noise", ratio, 1, "nav", simulator=simulator))
    assert found.worst < (4.5 if passes else 6.0)
    assert found.passed == passes
    assert found.cause == "" if passes else found.cause.endswith("imu noise: imu_noise")
