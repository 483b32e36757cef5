"""A study is planned in random order and evaluated from the stored runs that follow the plan."""

from collections import Counter
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from calstation.errors import InputError
from calstation.quality import GaugePlan, Measurement, gauge_study
from calstation.records import Categories, RunColumns
from tests.quality.test_gauge import AIAG

BEGIN = datetime(2026, 11, 2, tzinfo=UTC)
UNITS = tuple(f"SN-{k}" for k in range(10))
WHO = ("A", "B", "C")


def plan(seed: int = 1, by: str = "operator") -> GaugePlan:
    operators, stations = ((), WHO) if by == "station" else (WHO, ())
    return GaugePlan.random("nav", UNITS, operators, stations, 3, seed, BEGIN)


def stored(order: list[Measurement], **changes: object) -> RunColumns:
    """Store runs of measurements in order, one hour apart, with values of the AIAG study in two parameters."""
    n = len(order)
    values = [AIAG[UNITS.index(m.unit), WHO.index((m.operator or m.station or "")[0]), m.trial - 1] for m in order]
    started = [(BEGIN + timedelta(hours=k)).timestamp() for k in range(n)]
    texts = {
        "serials": tuple(m.unit for m in order),
        "verdicts": ("passed",) * n,
        "products": ("nav",) * n,
        "stations": tuple(m.station or "bench 1" for m in order),
        "operators": tuple(m.operator or "Li Wei" for m in order),
        "failed_checks": ((),) * n,
        **{name: column for name, column in changes.items() if isinstance(column, tuple)},
    }
    columns = {
        "names": tuple(f"run {k}" for k in range(n)),
        "started": np.array(started),
        "partial": np.zeros(n, dtype=bool),
        "check_standard": np.zeros(n, dtype=bool),
        "missing": np.zeros(n, dtype=bool),
        "values": {"gyro_bias_x": np.array(values), "accel_bias_x": np.array([np.nan, *values[1:]])},
        **{name: {} for name in ("sigmas", "table")},
    }
    coded = {name: Categories.of(column) for name, column in texts.items()}
    return RunColumns(**{**columns, **changes, **coded})  # type: ignore[arg-type]


def test_every_trial_contains_every_combination_in_random_order() -> None:
    order = plan().order
    assert len(order) == 90
    assert set(Counter((m.trial, m.appraiser, m.unit) for m in order).values()) == {1}
    assert [m.trial for m in order] == sorted(m.trial for m in order)
    blocks = [tuple(m.unit for m in order[k : k + 10]) for k in range(0, 90, 10)]
    assert all(set(block) == set(UNITS) for block in blocks)
    assert len(set(blocks)) == 9
    assert plan().order == order != plan(seed=2).order


def test_stored_plan_is_read_back(tmp_path: Path) -> None:
    plan().save(tmp_path / "plan.json")
    assert GaugePlan.load(tmp_path / "plan.json") == plan()
    (tmp_path / "other.json").write_text('{"schema": "calstation.result/1"}')
    for name, code in (("other.json", "quality.not_a_plan"), ("none.json", "result.unreadable")):
        with pytest.raises(InputError) as caught:
            GaugePlan.load(tmp_path / name)
        assert caught.value.code == code


def test_values_come_from_the_runs_that_follow_the_plan() -> None:
    order = [*plan().order]
    found = plan().values(stored(order))
    assert found.keys() == {"gyro_bias_x"}  # a run of the study lacks the other
    shown = gauge_study(("unit", "operator"), found["gyro_bias_x"])
    assert shown.gauge.sigma == pytest.approx(0.302373, abs=1e-5)
    by_station = plan(by="station")
    values = by_station.values(stored([*by_station.order]))["gyro_bias_x"]
    assert gauge_study(by_station.factors, values).gauge.sigma == pytest.approx(0.302373, abs=1e-5)


def test_plan_with_operators_and_stations_crosses_both() -> None:
    both = GaugePlan.random("nav", UNITS[:3], ("A", "B"), ("s1", "s2"), 2, 4, BEGIN)
    assert both.factors == ("unit", "operator", "station")
    assert set(Counter((m.trial, m.operator, m.station, m.unit) for m in both.order).values()) == {1}
    assert len(both.order) == 2 * 2 * 2 * 3
    assert both.order[0].appraiser in {"A, s1", "A, s2", "B, s1", "B, s2"}
    runs = stored([*both.order])
    assert both.remaining(runs) == []
    values = both.values(runs)["gyro_bias_x"]
    assert values.shape == (3, 2, 2, 2)
    first = both.order[0]
    levels = both.units, both.operators, both.stations
    assert both.appraisers == ("A, s1", "A, s2", "B, s1", "B, s2")  # in the order of the values
    at = [names.index(getattr(first, factor)) for names, factor in zip(levels, both.factors, strict=True)]
    assert values[(*at, 0)] == runs.values["gyro_bias_x"][0]


def test_runs_of_another_product_are_ignored() -> None:
    order = [*plan().order]
    other = stored(order, products=("mems",) + ("nav",) * 89)
    assert len(plan().remaining(other)) == 1


def test_runs_out_of_the_planned_order_are_counted() -> None:
    order = [*plan().order]
    assert plan().out_of_order(stored(order)) == 0
    assert plan().out_of_order(stored(order[:40])) == 0
    assert plan().out_of_order(stored([order[1], order[0], *order[2:]])) == 1
    late = [*order[:10], *order[11:30], order[10], *order[30:]]
    assert plan().out_of_order(stored(late)) == 1
    assert plan().out_of_order(stored(sorted(order, key=lambda m: (m.trial, m.appraiser, m.unit)))) > 30


def test_earlier_stopped_partial_and_surplus_runs_are_ignored() -> None:
    order = [*plan().order]
    extra = [order[0], *order, order[0]]
    runs = stored(extra)
    runs.started[:] -= 3600.0  # the first run began before the plan
    np.testing.assert_array_equal(plan().values(runs)["gyro_bias_x"], plan().values(stored(order))["gyro_bias_x"])
    for changes in (
        {"verdicts": ("stopped",) + ("passed",) * 89},
        {"partial": np.arange(90) == 0},
        {"operators": ("D", *(m.operator for m in order[1:]))},
        {"serials": ("SN-99", *(m.unit for m in order[1:]))},
    ):
        runs = stored(order, **changes)
        left = plan().remaining(runs)
        assert len(left) == 1
        assert (left[0].unit, left[0].appraiser) == (order[0].unit, order[0].appraiser)


def test_incomplete_study_states_the_next_measurement() -> None:
    order = [*plan().order]
    assert plan().remaining(stored(order[:88])) == order[88:]
    with pytest.raises(InputError) as caught:
        plan().values(stored(order[:88]))
    assert caught.value.code == "quality.study_incomplete"
    assert f"2 of the 90 runs of the study missing; next: {order[88].unit}, {order[88].appraiser}" in str(caught.value)


def test_study_requires_two_of_each_factor() -> None:
    with pytest.raises(InputError) as caught:
        GaugePlan.random("nav", UNITS, ("A",), (), 3, 1, BEGIN)
    assert caught.value.code == "quality.small_study"
    with pytest.raises(InputError) as caught:
        GaugePlan.random("nav", UNITS, (), (), 3, 1, BEGIN)
    assert caught.value.code == "quality.no_appraisers"


@pytest.mark.parametrize(("units", "who"), [((*UNITS, "SN-3"), WHO), (UNITS, (*WHO, "B"))])
def test_plan_with_duplicate_names_is_refused(units: tuple[str, ...], who: tuple[str, ...]) -> None:
    """Such a plan would never be complete, because runs of the second name count for the first."""
    with pytest.raises(InputError) as caught:
        GaugePlan.random("nav", units, who, (), 3, 1, BEGIN)
    assert caught.value.code == "quality.named_twice"
