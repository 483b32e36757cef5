"""Faults of the chamber and of a unit's temperature sensor: the run stops, and the chamber returns to ambient."""

import pytest

from calstation.sequencer import Command, Control, Event, Message
from tests.faults.conftest import FaultRuns, Ran
from tests.runs.test_temperature_runs import PRODUCT, THERMAL

pytestmark = pytest.mark.long


def thermal(fault_runs: FaultRuns, *points: float) -> FaultRuns:
    """A station with a chamber, and a product whose temperatures are these."""
    schedule = {**PRODUCT["schedule"]["temperature"], "points_c": list(points)}
    ends = [min(points) + 4.0, max(points) + 4.0]  # of the unit, which heats itself
    temperature = {**PRODUCT["temperature"], "range_c": ends, "reference_c": ends[1]}
    fault_runs.product = {**PRODUCT, "serial_pattern": r"SN-\d{6}", "temperature": temperature}
    fault_runs.product["schedule"] = {"temperature": schedule}
    fault_runs.chamber = {"profile": "virtual_chamber", "timeout_s": 0.2}
    fault_runs.site = {"gravity_mps2": 9.79547}
    return fault_runs


def messages(ran: Ran) -> list[str]:
    return [event.id for event in ran.events if isinstance(event, Message)]


@pytest.mark.parametrize(
    ("kind", "value", "code"),
    [
        ("chamber_alarm", 7, "chamber.alarm"),
        ("chamber_door", 120, "chamber.door_open"),
        pytest.param("chamber_off", 1, "chamber.not_running", marks=pytest.mark.exhaustive),
        ("chamber_no_power", 1, "chamber.not_following"),
        pytest.param("chamber_set_point", 80, "chamber.set_point_changed", marks=pytest.mark.exhaustive),
        pytest.param("chamber_sensor_stuck", 1, "chamber.sensor_stuck", marks=pytest.mark.exhaustive),
        pytest.param("chamber_sensor_offset", -10, "chamber.too_fast", marks=pytest.mark.exhaustive),
    ],
)
def test_a_fault_of_the_chamber_stops_the_run(fault_runs: FaultRuns, kind: str, value: float, code: str) -> None:
    planned = {"kind": kind, "stage": "temperature", "step": 0, "time_s": 60.0, "value": value}
    ran = thermal(fault_runs, -20.0, 23.0).run(planned, stages=("temperature",), thermal=THERMAL)
    ran.assert_stopped("chamber: ")
    assert ran.fault.code == code
    assert "chamber_to_ambient" in messages(ran)
    if kind != "chamber_sensor_stuck":  # which cannot show that it is at ambient
        assert messages(ran)[-1] == "chamber_may_be_opened"


def test_a_silent_chamber_stops_the_run_and_is_to_be_kept_closed(fault_runs: FaultRuns) -> None:
    planned = {"kind": "mute_chamber", "stage": "temperature", "step": 0, "time_s": 60.0, "value": 1e6}
    runs = thermal(fault_runs, -20.0, 23.0)
    runs.chamber["timeout_s"] = 0.05
    ran = runs.run(planned, stages=("temperature",), thermal=THERMAL)
    ran.assert_stopped("chamber: ", "check cable, power and network")
    assert ran.fault.code == "chamber.link"
    assert "chamber_unknown" in messages(ran)
    assert "chamber_may_be_opened" not in messages(ran)


@pytest.mark.parametrize("kind", ["slow_chamber", pytest.param("hang_up_chamber", marks=pytest.mark.exhaustive)])
def test_late_and_lost_answers_of_the_chamber_cost_nothing(fault_runs: FaultRuns, kind: str) -> None:
    planned = {"kind": kind, "stage": "temperature", "step": 0, "time_s": 60.0, "value": 0.1}
    ran = thermal(fault_runs, 20.0, 29.0).run(planned, stages=("temperature",), thermal=THERMAL)
    assert kind in ran.bench["executed"]
    assert ran.ended.verdict.passed


@pytest.mark.parametrize(
    ("kind", "value"),
    [pytest.param("temperature_stuck", 1, marks=pytest.mark.exhaustive), ("temperature_offset", 20)],
)
def test_a_temperature_sensor_that_disagrees_stops_the_run(fault_runs: FaultRuns, kind: str, value: float) -> None:
    planned = {"kind": kind, "stage": "temperature", "step": 0, "time_s": 60.0, "value": value}
    ran = thermal(fault_runs, 5.0, 23.0).run(planned, stages=("temperature",), thermal=THERMAL)
    ran.assert_stopped("chamber: ", "which sensor is wrong")
    assert ran.fault.code == "chamber.sensors_disagree"


@pytest.mark.exhaustive
def test_a_temperature_sensor_that_jumps_prolongs_the_soak(fault_runs: FaultRuns) -> None:
    planned = {"kind": "temperature_jump", "stage": "temperature", "step": 0, "time_s": 60.0, "value": 5}
    ran = thermal(fault_runs, 20.0, 29.0).run(planned, stages=("temperature",), thermal=THERMAL)
    assert ran.ended.verdict.passed


@pytest.mark.exhaustive
def test_stop_at_minus_40_rests_the_table_and_brings_the_chamber_to_ambient(fault_runs: FaultRuns) -> None:
    control = Control()

    def stop(event: Event) -> None:
        if isinstance(event, Message) and event.id == "soaked":
            control.send(Command.STOP)

    runs = thermal(fault_runs, -40.0, 23.0)
    ran = runs.run(stages=("temperature",), control=control, on_event=stop, thermal=THERMAL)
    assert ran.ended.verdict == "stopped"
    assert not ran.bench["moving"]
    assert not ran.bench["enabled"]
    ids = messages(ran)
    assert "chamber_to_ambient" in ids
    assert ids.count("chamber_returning") > 5
    assert ids[-1] == "chamber_may_be_opened"
    back = next(e for e in ran.events if isinstance(e, Message) and e.id == "chamber_to_ambient")
    assert back.values["air_c"] == pytest.approx(-40.0, abs=2.0)
