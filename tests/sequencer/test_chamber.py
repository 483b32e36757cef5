"""The control of a chamber: limits before every set point, faults at every poll, and the return to ambient."""

import math
import threading
import time
from collections.abc import Callable
from typing import Any

import pytest

from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.sequencer import ChamberControl, ChamberLimits, Event
from calstation.sequencer.events import ChamberChanged, Message, from_json, to_json
from tests.helpers import raises_code
from tests.sequencer.fake_chamber import FakeChamber
from tests.sequencer.fakes import FakeClock

RANGES = {"chamber": (-70.0, 180.0), "table": (-40.0, 85.0), "unit": (-45.0, 90.0)}
LIMITS = ChamberLimits(RANGES, max_rate=0.05, ambient=23.0, dew_point=15.0)


class Station:
    """A control with its fake chamber."""

    def __init__(self, **chamber: Any) -> None:
        self.clock = FakeClock()
        self.clock.tick = 1.0
        self.chamber = FakeChamber(self.clock.now, **chamber)
        self.events: list[Event] = []
        self.control = ChamberControl(self.chamber, LIMITS, self.clock, self.events.append)

    def units(self) -> dict[str, float]:
        return {"": self.chamber.unit}

    def tick(self) -> None:
        self.clock.sleep(self.clock.tick)
        self.chamber.advance()

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        end = self.clock.now() + seconds
        while self.clock.now() < end and not until():
            self.tick()
            self.control.update(self.units())

    def messages(self) -> list[str]:
        return [event.id for event in self.events if isinstance(event, Message)]


def at(temperature: float, **chamber: Any) -> Station:
    """A station whose chamber holds a temperature."""
    station = Station(air=temperature, unit=temperature, **chamber)
    station.control.begin()
    return station


@pytest.mark.parametrize(("temperature", "device"), [(-41.0, "table"), (86.0, "table"), (-80.0, "chamber")])
def test_a_target_outside_the_range_of_any_device_is_refused(temperature: float, device: str) -> None:
    station = at(23.0)
    with raises_code(ConfigurationError, "chamber.target_outside") as caught:
        station.control.hold(temperature)
    assert caught.value.values["device"] == device
    assert LIMITS.range == (-40.0, 85.0)
    assert {value for command, value in station.chamber.commands if command == "set_point"} == {23.0}


@pytest.mark.parametrize("rate", [0.0, -0.01, 0.051, math.nan])
def test_a_ramp_beyond_the_largest_rate_is_refused(rate: float) -> None:
    with raises_code(ConfigurationError, "chamber.rate_outside"):
        at(23.0).control.ramp(40.0, rate)


def test_a_chamber_starts_at_the_temperature_of_its_air() -> None:
    station = at(31.5)
    assert station.chamber.commands == [("set_point", 31.5), ("start", 0.0), ("set_point", 31.5)]


def test_a_chamber_beyond_the_range_of_a_device_starts_at_its_end() -> None:
    station = Station(air=-60.0)
    station.control.begin()
    assert station.chamber.goal == -40.0


def test_the_set_point_follows_the_ramp_and_the_target_is_reached() -> None:
    station = at(23.0)
    station.control.ramp(53.0, 0.02)
    station.run(600.0)
    assert station.chamber.goal == pytest.approx(23.0 + 0.02 * 600.0, abs=0.1)
    assert station.control.remaining == pytest.approx(900.0, abs=10.0)
    assert not station.control.arrived
    station.run(1000.0, lambda: station.control.arrived)
    assert station.clock.now() == pytest.approx(1500.0, abs=10.0)
    changed = next(event for event in station.events if isinstance(event, ChamberChanged))
    assert from_json(to_json(changed)) == changed


def test_a_slow_ramp_sends_few_set_points_that_follow_it() -> None:
    station = at(23.0)
    station.control.ramp(33.0, 0.5 / 60.0)
    for _ in range(60):
        station.run(20.0)
        assert station.chamber.goal == pytest.approx(min(23.0 + station.clock.now() * 0.5 / 60.0, 33.0), abs=0.13)
    assert len([c for c in station.chamber.commands if c[0] == "set_point"]) <= 102


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda s: setattr(s.chamber, "alarm", "compressor"), "chamber.alarm"),
        (lambda s: setattr(s.chamber, "door_open", True), "chamber.door_open"),
        (lambda s: setattr(s.chamber, "offset", math.nan), "chamber.no_temperature"),
        (lambda s: setattr(s.chamber, "running", False), "chamber.not_running"),
        (lambda s: setattr(s.chamber, "goal", 80.0), "chamber.set_point_changed"),
        (lambda s: setattr(s.chamber, "stuck", True), "chamber.sensor_stuck"),
        (lambda s: setattr(s.chamber, "rate", 0.0001), "chamber.not_following"),
        (lambda s: setattr(s.chamber, "offset", 30.0), "chamber.too_fast"),
        (lambda s: setattr(s.chamber, "offset", 100.0), "chamber.air_outside"),
        (
            lambda s: setattr(s.chamber, "error", DeviceFaultError("chamber.alarm", alarm="none")),
            "chamber.alarm",
        ),
    ],
)
def test_every_fault_of_the_chamber_is_found(change: Callable[[Station], None], code: str) -> None:
    station = at(23.0)
    station.control.hold(60.0)
    station.run(100.0)
    change(station)
    with raises_code(DeviceFaultError, code):
        station.run(1000.0)


def test_overshoot_lag_and_a_long_hold_are_no_faults() -> None:
    station = at(23.0)
    station.control.hold(-40.0)
    station.run(2000.0)
    station.chamber.offset = -2.0  # overshoot: below the set point, and outside the tolerance
    station.run(300.0)
    station.chamber.offset = 0.0
    station.run(10.0)
    station.chamber.stuck = True  # a sensor of 0.1 K shows the same value for hours
    station.run(3600.0)
    assert station.control.arrived


def test_sensors_that_disagree_after_a_soak_are_a_fault() -> None:
    station = at(23.0)
    station.control.check_agreement(32.0)
    with raises_code(DeviceFaultError, "chamber.sensors_disagree"):
        station.control.check_agreement(35.0)


@pytest.mark.parametrize("temperature", [-40.0, 85.0])
def test_safe_goes_to_ambient_and_the_chamber_stays_on_until_the_unit_may_be_touched(temperature: float) -> None:
    station = at(temperature)
    station.control.update(station.units())
    assert not station.control.may_open
    assert station.control.safe() == []
    assert station.chamber.commands[-1] == ("set_point", 23.0)
    assert station.chamber.running
    assert station.control.wait_until_safe(station.units, station.tick) == []
    assert 15.0 <= station.chamber.unit <= 43.0
    assert not station.chamber.running
    assert station.control.may_open
    ids = station.messages()
    assert ids[0] == "chamber_to_ambient"
    assert ids.count("chamber_returning") > 10
    assert ids[-1] == "chamber_may_be_opened"


@pytest.mark.parametrize("units", [dict, lambda: {"": -40.0}, lambda: {"": math.nan}])
def test_a_unit_that_no_longer_sends_is_given_half_an_hour_at_ambient(units: Callable[[], dict[str, float]]) -> None:
    station = at(-40.0)
    station.control.safe()
    station.control.wait_until_safe(units, station.tick)
    assert station.clock.now() == pytest.approx(63.0 / 0.05 + 1800.0, abs=150.0)


def test_a_unit_that_is_hot_inside_may_be_touched_once_its_temperature_no_longer_changes() -> None:
    """Its sensor is inside, where a gyro of 20 W is warmer than its case."""
    station = at(85.0)
    station.control.safe()
    assert station.control.wait_until_safe(lambda: {"": station.chamber.unit + 25.0}, station.tick) == []
    assert station.messages()[-1] == "chamber_may_be_opened"
    assert station.clock.now() == pytest.approx(62.0 / 0.05 + 300.0 * math.log(62.0) + 1800.0, abs=600.0)


def test_a_chamber_that_fails_on_the_way_to_ambient_is_reported_and_not_switched_off() -> None:
    station = at(-40.0)
    station.chamber.error = DeviceFaultError("chamber.alarm", alarm="compressor")
    failures = station.control.safe() + station.control.wait_until_safe(station.units, station.tick)
    assert [failure.code for failure in failures] == ["chamber.alarm", "chamber.alarm"]
    assert station.chamber.running
    assert station.clock.now() == pytest.approx(40.0, abs=5.0), "after 20 polls"
    assert station.messages()[-1] == "chamber_unknown"


def test_a_chamber_that_answers_again_is_sent_to_ambient_again() -> None:
    station = at(-40.0)
    station.chamber.error = DeviceFaultError("chamber.alarm", alarm="link")
    station.clock.at(30.0, lambda: setattr(station.chamber, "error", None))
    assert len(station.control.safe()) == 1
    assert station.control.wait_until_safe(station.units, station.tick) == []
    assert station.chamber.goal == 23.0
    assert station.messages()[-1] == "chamber_may_be_opened"


def test_a_chamber_that_never_returns_is_reported() -> None:
    station = at(-40.0, dead=True)
    station.control.safe()
    failures = station.control.wait_until_safe(station.units, station.tick)
    assert [failure.code for failure in failures] == ["chamber.not_following"]


def test_a_slow_answer_holds_up_neither_the_control_loop_nor_the_return_to_ambient() -> None:
    station = at(23.0)
    station.control.hold(60.0)
    station.run(100.0)
    station.chamber.answers.clear()
    station.clock.sleep(10.0)
    before, begin = station.chamber.goal, time.monotonic()
    station.control.update(station.units())
    station.control.update(station.units())
    assert time.monotonic() - begin < 2.0
    assert station.chamber.goal == before
    threading.Timer(0.2, station.chamber.answers.set).start()
    assert station.control.safe() == []
    assert station.chamber.commands[-1] == ("set_point", 23.0), "after the set point that was on its way"
    assert station.control.target == 23.0


def test_a_late_answer_is_checked_when_it_arrives() -> None:
    station = at(23.0)
    station.run(10.0)
    station.chamber.answers.clear()
    station.run(5.0)
    station.chamber.door_open = True
    station.chamber.answers.set()
    with raises_code(DeviceFaultError, "chamber.door_open"):
        station.run(5.0)


def test_a_control_that_never_began_leaves_the_chamber_alone() -> None:
    station = Station()
    assert station.control.safe() + station.control.wait_until_safe(station.units, station.tick) == []
    assert station.chamber.commands == []


def test_a_full_disk_does_not_end_the_return_to_ambient(monkeypatch: pytest.MonkeyPatch) -> None:
    station = at(-40.0)
    failing = iter([True])

    def emit(event: Event) -> None:
        if isinstance(event, Message) and event.id == "chamber_returning" and next(failing, False):
            raise ConfigurationError("log.disk_nearly_full", file="log.h5", megabytes=100)
        station.events.append(event)

    monkeypatch.setattr(station.control, "_emit", emit)
    station.control.safe()
    failures = station.control.wait_until_safe(station.units, station.tick)
    assert [failure.code for failure in failures] == ["log.disk_nearly_full"]
    assert station.messages()[-1] == "chamber_may_be_opened"
    assert not station.chamber.running
