"""Gross errors are named where both joints of the table move at once; `tests.outside.cases` has all kinds of cases."""

import pytest

from tests.outside.cases import CHANGES, Row, configurations, is_right
from tests.outside.sweep import run


@pytest.mark.parametrize(
    "row", [row for row in configurations() if row.product == "mems_c_fast"], ids=lambda row: row.title
)
def test_gross_error_is_named_in_a_designed_schedule(row: Row) -> None:
    for case in row.cases(1):
        outcome = run(case, CHANGES)
        assert not outcome.passed
        assert is_right(row, outcome), (outcome.failed, outcome.cause)
