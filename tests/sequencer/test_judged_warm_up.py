"""The warm-up of a unit is judged over a period that lost samples do not shorten."""

from types import SimpleNamespace
from typing import Any

import pytest

from calstation.sequencer.preflight import _WarmUp


@pytest.mark.parametrize("lost_at", [None, 15.0])
def test_a_unit_that_still_warms_up_is_not_warm_after_lost_samples(lost_at: float | None) -> None:
    limits = SimpleNamespace(warm_up=10.0, warm_up_slope=0.2, warm_up_timeout=600.0)
    unit: Any = SimpleNamespace(slot=SimpleNamespace(unit=SimpleNamespace(preflight=limits)))
    warm_up, done = _WarmUp(unit, 0.0, 0.0), False
    for k in range(600):
        now = 0.1 * k
        unit.flow = SimpleNamespace(count=10, missing=int(now == lost_at))
        unit.temperature = round(25.0 + now / 60.0, 1)  # 1 K/min, by a sensor of 0.1 K
        done = done or warm_up.done(now)
    assert not done
