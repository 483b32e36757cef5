"""Monte Carlo calibrations of units near their limits: decisions are wrong as often as predicted."""

import pytest

from tests.outside.conformity import decisions, summary


@pytest.mark.long
def test_false_accepts_and_rejects_are_as_frequent_as_predicted() -> None:
    rows = summary(list(decisions(60)))
    for row in rows:
        assert row.low <= row.observed <= row.high, row
        assert row.beyond <= 1, row
    counts = {(row.rule, row.kind): row for row in rows}
    assert counts["simple", "accept"].observed > 20
    assert counts["guard_band", "accept"].predicted < 0.05 * counts["simple", "accept"].predicted
