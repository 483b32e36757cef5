"""Schedule fields with ranges, the schedules of a product, and invalid schedule values."""

from dataclasses import replace
from typing import Any

import pytest

from calstation.config import (
    field_spec,
    schedule_fields,
    schedule_options,
    schedule_problems,
)
from calstation.errors import ConfigurationError
from procedures import method
from tests.prepared import prepare_run
from tests.site_folder import PRODUCT, SiteFolder


def test_fields_have_type_unit_range_and_description() -> None:
    turns, rate, _, dwell = schedule_fields("rate")
    assert (turns.name, turns.kind, turns.low, turns.high, turns.optional) == (
        "turns",
        "count",
        1.0,
        50.0,
        False,
    )
    assert (rate.unit, rate.low, rate.above, rate.high) == ("°/s", 0.0, True, 360.0)
    assert (dwell.unit, dwell.low, dwell.above) == ("s", 2.0, False)
    by_name = {field.name: field for field in schedule_fields("excitation")}
    assert not by_name["rounds"].optional
    assert (by_name["rounds"].low, by_name["rounds"].above) == (0.0, False)
    assert by_name["duration_s"].optional
    assert by_name["targets"].kind == "targets"
    assert all(field.description for field in by_name.values())


def test_schedule_options_contain_complete_schedules_of_the_product(site_folder: SiteFolder) -> None:
    site_folder.write({"stages": ["six_position", "rate"]})
    offered = schedule_options(site_folder.station, site_folder.product)
    assert offered.stages == ("six_position", "rate")
    assert offered.offered == ("six_position", "rate", "excitation", "azimuth_flip")
    assert offered.schedules["six_position"] == PRODUCT["schedule"]["six_position"]
    assert offered.schedules["azimuth_flip"]["targets"] == {}
    assert offered.rate == pytest.approx(120.0)
    assert offered.virtual


@pytest.mark.parametrize(
    ("stage", "change", "field", "problem"),
    [
        ("rate", {"turns": 0}, "turns", ("greater_than_equal", 1.0)),
        ("rate", {"turns": 51}, "turns", ("less_than_equal", 50.0)),
        ("rate", {"turns": 1.5}, "turns", ("int_from_float", None)),
        ("rate", {"dwell_s": "abc"}, "dwell_s", ("float_parsing", None)),
        ("rate", {"dwell_s": None}, "dwell_s", ("float_type", None)),
        ("rate", {"rate_dps": 0.0}, "rate_dps", ("greater_than", 0.0)),
        ("rate", {"rate_dps": 130.0}, "rate_dps", ("table", 120.0)),
        ("excitation", {"targets": {"gyro_bias": -1.0}}, "targets.gyro_bias", ("greater_than", 0.0)),
        ("excitation", {"targets": {"gyro_bais": 1.0}}, "targets.gyro_bais", ("value_error", None)),
        ("excitation", {"rounds": None}, "", None),
    ],
)
def test_invalid_value_is_reported_at_its_field(
    site_folder: SiteFolder, stage: str, change: dict[str, object], field: str, problem: tuple[str, float | None] | None
) -> None:
    offered = schedule_options(site_folder.station, site_folder.product)
    problems = schedule_problems(stage, {**offered.schedules[stage], **change}, offered)
    if problem is None:
        assert problems == []
        return
    (reported,) = problems
    assert (reported.name, reported.kind) == (field, problem[0])
    assert reported.what.values.get("bound") == (problem[1] if problem[1] is None else pytest.approx(problem[1]))


def test_schedule_values_of_a_request_override_the_product(site_folder: SiteFolder) -> None:
    asked = site_folder.request("rate")
    changed = prepare_run(replace(asked, schedule={"rate": {"turns": 2}, "excitation": {"rounds": 3}}))
    assert list(changed.schedules) == ["rate"]
    plain, other = (setup.log_meta() for setup in (prepare_run(asked), changed))
    assert plain.schedule["rate"] == PRODUCT["schedule"]["rate"]
    assert other.schedule["rate"] == {**PRODUCT["schedule"]["rate"], "turns": 2}
    assert other.to_json() != plain.to_json()
    with pytest.raises(ConfigurationError, match=r"^schedule\.rate: turns: 0 is out of range"):
        prepare_run(replace(asked, schedule={"rate": {"turns": 0}}))


def test_fields_have_the_expected_types() -> None:
    kinds = {field.name: field.kind for field in schedule_fields("multi_position")}
    assert kinds["manual"] == "flag"
    assert kinds["step_deg"] == "number"
    by_name = {field.name: field for field in schedule_fields("cross_calibration")}
    assert by_name["trigger"].kind == "choice"
    assert by_name["trigger"].choices == ("command", "start_up", "period")
    assert by_name["primary_gyro"].kind == "other"


@pytest.mark.parametrize(
    ("values", "rounds"),
    [
        ({}, 1),
        ({"rounds": 0}, 0),
        ({"duration_s": 1500.0}, 0),
        ({"targets": {"gyro_bias": 1e-7}}, 0),
        ({"rounds": 3, "duration_s": 1500.0}, 3),
        ({"rounds": None}, 0),
    ],
)
def test_default_number_of_rounds_depends_on_other_stop_conditions(values: dict[str, Any], rounds: int) -> None:
    assert method("excitation").schedule.model_validate(values).model_dump()["rounds"] == rounds


@pytest.mark.parametrize(
    ("name", "unit"),
    [("ramp_c_per_min", "°C/min"), ("max_rate_c_per_min", "°C/min"), ("dwell_s", "s"), ("rounds", ""), ("speed", "×")],
)
def test_unit_of_a_field_follows_from_its_name(name: str, unit: str) -> None:
    assert field_spec(name, None).unit == unit
