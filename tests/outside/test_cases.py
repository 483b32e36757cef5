"""Causes are named in the schedules in which they are hard to tell apart; all kinds of cases: `tests.outside.cases`."""

import pytest
from helpers import sampled

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
@pytest.mark.parametrize(
    ("title", "product", "simulator", "seed"),
    [
        ("low-pass of 2 ms", "nav_a_fast", "plain", 2),  # resembled coning of a negative size
        ("increments compensated for coning", "nav_a_fast", "plain", 2),  # a negative low-pass
        ("low-pass of 10 ms", "mems_c_fast", "bench", 3),  # doubled samples at the begin of a rotation
        ("gyro clipped at 99.8 % of its largest rate, remainder carried over", "nav_a_fast", "plain", 1),  # spikes
        ("accelerometer x keeps its value until it changes by 8 times its noise", "mems_c_fast", "plain", 1),  # stuck
        ("table with 2.9 times its noise", "nav_a_fast", "bench", 1),  # a sigma above its limit, without a cause
    ],
)
def test_cause_is_not_the_one_that_it_resembles(title: str, product: str, simulator: str, seed: int) -> None:
    row = next(row for row in rows() if (row.title, row.product) == (title, product))
    case = next(case for case in row.cases(seed) if (case.simulator, case.seed) == (simulator, seed))
    outcome = run(case, CHANGES)
    assert not outcome.passed
    assert is_right(row, outcome), (outcome.failed, outcome.cause)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "row", sampled(4, [row for row in rows() if "hysteresis" in row.title]), ids=lambda row: row.title
)
def test_hysteresis_is_named_in_four_stages(row: Row) -> None:
    """The azimuth flips begin with a move, which determines the sense of the last turn at their first rest."""
    for case in row.cases(1):
        outcome = run(case)
        assert not outcome.passed
        assert is_right(row, outcome), (outcome.failed, outcome.cause)
