"""Decisions about units near their limits are wrong as often as the results predict."""

import pytest

from tests.outside.conformity import decisions, summary


@pytest.mark.exhaustive
def test_observed_false_decisions_lie_within_predicted_intervals() -> None:
    """60 units with 30 parameters; docs/explanation/conformity.md has the figures of 1000."""
    rows = summary([*decisions(60, workers=1)])
    assert {(row.rule, row.kind) for row in rows} == {
        (rule, f"{kind}{of}")
        for rule in ("simple", "guard_band")
        for kind in ("accept", "reject")
        for of in ("", ", specific")
    }
    for row in rows:
        assert row.decisions == 60 * 30
        assert row.low <= row.observed <= row.high, row
    assert sum(row.beyond for row in rows) <= 2  # of 240 binomial intervals of 99.9 %
    wrong = {(row.rule, row.kind): row.observed for row in rows}
    assert wrong["simple", "reject"] > 30
    assert wrong["guard_band", "accept"] < wrong["simple", "accept"]
