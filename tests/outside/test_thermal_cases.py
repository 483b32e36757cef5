"""Faults of units over temperature are named first, or leave small errors; all kinds: `tests.outside.thermal_cases`."""

import pytest
from helpers import sampled

from tests.outside.thermal_cases import HYSTERESIS, ThermalRow, rows, run


@pytest.mark.exhaustive
@pytest.mark.parametrize("row", sampled(2, rows()), ids=lambda row: row.title)
def test_a_fault_over_temperature_is_named_first_or_leaves_small_errors(row: ThermalRow) -> None:
    outcome = run(row, 1)
    assert outcome.is_right, (outcome.failed, outcome.cause, outcome.worst, outcome.parameter)


@pytest.mark.long
def test_hysteresis_that_enlarges_a_sigma_beyond_its_limit_is_named() -> None:
    outcome = run(next(row for row in rows() if row.title == "hysteresis of 2 %"), 2)
    assert "gyro_bias_z sigma below" in outcome.failed
    assert HYSTERESIS[0] in outcome.cause, (outcome.failed, outcome.causes)
