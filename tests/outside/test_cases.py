"""Causes are named in the schedules in which they are hard to tell apart; all kinds of cases: `tests.outside.cases`."""

import pytest

from tests.outside.cases import CHANGES, Row, configurations, is_right, rows
from tests.outside.sweep import run


@pytest.mark.parametrize(
    "row", [row for row in configurations() if row.product == "mems_c_fast"], ids=lambda row: row.title
)
def test_gross_error_is_named_where_both_joints_always_move(row: Row) -> None:
    for case in row.cases(1):
        outcome = run(case, CHANGES)
        assert not outcome.passed
        assert is_right(row, outcome), (outcome.failed, outcome.cause)


@pytest.mark.long
@pytest.mark.parametrize("row", [row for row in rows() if "hysteresis" in row.title], ids=lambda row: row.title)
def test_hysteresis_is_named_in_four_stages(row: Row) -> None:
    """The azimuth flips begin with a move, which determines the sense of the last turn at their first rest."""
    for case in row.cases(1):
        outcome = run(case)
        assert not outcome.passed
        assert is_right(row, outcome), (outcome.failed, outcome.cause)
