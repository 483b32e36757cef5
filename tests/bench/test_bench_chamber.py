"""The chamber of the bench: its temperatures, protocols and faults, and a unit that depends on temperature."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calstation.bench import BenchClock, BenchConfig, BenchHost, FaultCommand
from calstation.bench.chamber import ChamberMachine, ChamberRegisters, ChamberSettings, Simserv
from calstation.bench.live import LiveBench
from calstation.bench.truth import GRADES, ThermalSettings, UnitThermal
from calstation.devices import Chamber
from calstation.devices.chamber import open_chamber
from calstation.devices.profiles import ChamberProfile, load_chamber_profile
from calstation.errors import DeviceFaultError
from calstation.physics import COUNT, INDEX
from calstation.sequencer import ChamberControl, ChamberLimits
from tests.helpers import raises_code

CHAMBERS = Path(__file__).parents[2] / "data" / "chambers"
UP = np.array([0.0, 0.0, 1.0])
SETTINGS = {"grade": "mems", "sample_rate_hz": 20.0, "chamber": {"rate_c_per_min": 5.0}}


def profile(name: str) -> ChamberProfile:
    return load_chamber_profile(CHAMBERS / f"{name}.toml").at_station(0.2)


def after(machine: ChamberMachine, target: float, seconds: float) -> list[float]:
    """The measured temperature each second."""
    machine.set_point = target
    begin = machine._now
    found = []
    for second in range(1, round(seconds) + 1):
        machine.advance(begin + second)
        found.append(machine.temperature)
    return found


def test_the_air_lags_behind_its_set_point_overshoots_and_settles() -> None:
    machine = ChamberMachine(ChamberSettings())
    machine.start()
    course = after(machine, -40.0, 7200.0)
    assert np.abs(np.diff(course)).max() <= 5.0 / 60.0 + 1e-9
    assert 10.0 < course[120] < 23.0
    assert -43.0 < min(course) < -40.1
    assert course[-1] == pytest.approx(-40.0, abs=0.2)
    assert machine.truth.wall > -38.0, "the wall is slower"


def test_an_open_door_and_a_chamber_without_power_let_the_air_go_to_the_room() -> None:
    machine = ChamberMachine(ChamberSettings())
    machine.start()
    after(machine, -40.0, 3600.0)
    machine.open_door(300.0)
    warmed = after(machine, -40.0, 250.0)[-1]
    assert warmed > -10.0
    assert machine.door_open
    after(machine, -40.0, 100.0)
    assert not machine.door_open
    machine.powerless = True
    assert after(machine, -40.0, 30000.0)[-1] > 15.0


def test_the_temperatures_do_not_depend_on_the_size_of_the_steps() -> None:
    ends = []
    for size in (0.4, 7.0):
        machine = ChamberMachine(ChamberSettings())
        machine.start()
        machine.set_point = 60.0
        for now in np.arange(size, 700.5, size):
            machine.advance(float(now))
        machine.advance(700.0)
        ends.append(machine.temperature)
    assert ends[0] == ends[1]


def soaked(thermal: UnitThermal, air: float, seconds: float = 2500.0) -> UnitThermal:
    for _ in range(round(seconds / 0.5)):
        thermal.step(air, UP)
    return thermal


def unit(seed: int = 1, **settings: Any) -> UnitThermal:
    return UnitThermal(ThermalSettings(**settings), GRADES["mems"].sigma, 23.0, np.random.default_rng(seed))


def test_a_unit_heats_itself_and_its_places_lag() -> None:
    thermal = soaked(unit(), 23.0)
    sensor, gyro, accel = thermal.temperatures
    assert sensor == pytest.approx(27.0, abs=0.01)
    assert 0.001 < abs(gyro - sensor) <= 0.1
    assert (accel - sensor) == pytest.approx(-0.5 * (gyro - sensor), abs=1e-3)
    soaked(thermal, 60.0, 120.0)
    assert thermal.temperatures[0] > thermal.temperatures[2] > thermal.temperatures[1] > 30.0


def test_the_parameters_are_no_polynomials_and_have_their_values_at_the_reference() -> None:
    base = np.zeros(COUNT)
    temperatures = np.linspace(-40.0, 85.0, 60)
    worst = {}
    for order in (1, 3, 6):
        fitted = []
        for seed in range(10):
            thermal = unit(seed)
            assert not thermal.steady(base, 25.0).any()
            values = np.array([thermal.steady(base, t)[INDEX["gyro_bias_x"]] for t in temperatures])
            fit = np.polynomial.Polynomial.fit(temperatures, values, order)
            fitted.append(np.abs(fit(temperatures) - values).max() / np.ptp(values))
        worst[order] = max(fitted)
    assert worst[1] > 0.05
    assert 1e-4 < worst[3] < 0.05
    assert worst[6] > 1e-8, "no order is exact"


def test_levers_do_not_depend_on_temperature() -> None:
    assert not unit().steady(np.zeros(COUNT), 80.0)[INDEX["outer_lever_x"]]


def test_the_biases_depend_on_the_rate_and_on_where_the_temperature_came_from() -> None:
    base, index = np.zeros(COUNT), INDEX["gyro_bias_y"]

    def difference(**settings: float) -> tuple[float, float]:
        thermal = soaked(unit(**settings), -30.0)
        cold = soaked(thermal, 21.0).parameters(base)[index]
        soaked(thermal, 80.0)
        moving = soaked(thermal, 21.0, 120.0)
        extra = moving.parameters(base)[index] - moving.steady(base, moving.temperatures[1])[index]
        return cold - soaked(thermal, 21.0).parameters(base)[index], float(extra)

    hysteresis, moving = difference()
    assert abs(hysteresis) > 1e-7
    assert abs(moving) > 1e-6
    without = difference(hysteresis=0.0, rate_term=0.0)
    assert np.abs(without).max() < 1e-12 + 0.01 * abs(hysteresis)


def test_a_gradient_depends_on_the_attitude() -> None:
    thermal = soaked(unit(gradient_c=3.0), 23.0)
    upright = thermal.temperatures[1]
    for _ in range(2000):
        thermal.step(23.0, -UP)
    assert abs(thermal.temperatures[1] - upright) > 0.5


@pytest.mark.parametrize(
    ("order", "value", "found"),
    [("temperature_stuck", 1.0, 0.0), ("temperature_offset", 5.0, 5.0), ("temperature_jump", 60.0, -150.0)],
)
def test_faults_of_the_temperature_sensor(order: str, value: float, found: float) -> None:
    bench = LiveBench(BenchConfig.model_validate(SETTINGS), lambda: 0.0)
    bench.advance(10.0)
    assert bench.thermal is not None
    assert bench.chamber is not None
    before = bench.unit.temperature(bench.device_time)
    bench.execute(FaultCommand(order=order, value=value))  # type: ignore[arg-type]
    bench.chamber.truth.air = 60.0
    assert bench.unit.temperature(bench.device_time) - before == pytest.approx(found, abs=10.0)
    bench.advance(30.0)
    changed = bench.unit.temperature(bench.device_time) - before
    assert (changed == 0.0) == (order == "temperature_stuck")


def test_the_stream_does_not_depend_on_the_size_of_the_requests() -> None:
    streams = []
    for size in (0.5, 0.35):
        bench = LiveBench(BenchConfig.model_validate(SETTINGS), lambda: 0.0)
        ends = [*np.arange(size, 20.0, size), 20.0]
        streams.append(b"".join(bench.advance(float(end)) for end in ends))
    counts = [np.frombuffer(s, np.uint8).reshape(-1, 34)[:, 4:28] for s in streams]
    np.testing.assert_array_equal(*counts)


@pytest.mark.parametrize("protocol", ["simserv", "watlow_f4"])
def test_both_protocols_drive_the_same_chamber(protocol: str) -> None:
    with running() as (bench, clock):
        port = bench.endpoints["chamber" if protocol == "simserv" else "chamber_modbus"]
        used = profile("virtual_chamber" if protocol == "simserv" else protocol)
        with closing(open_chamber(f"tcp://{port}", used)) as chamber:
            chamber.identify()
            assert chamber.status().air_c == pytest.approx(23.0)
            assert not chamber.status().running
            chamber.set_point(-12.5)
            chamber.start()
            clock.sleep(120.0)
            status = chamber.status()
            assert (status.set_point_c, status.running) == (-12.5, True)
            assert status.air_c < 18.0
            chamber.stop()
            assert not chamber.status().running


def test_wrong_requests_are_refused() -> None:
    parse = Simserv(ChamberMachine(ChamberSettings())).new_parser()
    assert parse(b"12345\xb61\r") == [b"-5\r\n"]
    assert parse(b"11001\xb61\xb61\r110") == [b"-6\r\n"]
    assert parse(b"01\xb61\xb61\xb6x\r") == [b"-6\r\n"]
    machine = ChamberMachine(ChamberSettings())
    registers = ChamberRegisters(machine)
    registers.write(300, [65536 - 405])
    assert (machine.set_point, registers.read(300, 1)) == (-40.5, [65536 - 405])


@contextmanager
def running(**settings: Any) -> Iterator[tuple[BenchHost, BenchClock]]:
    with closing(BenchHost.start({**SETTINGS, **settings})) as bench:
        host, _, port = bench.endpoints["clock"].rpartition(":")
        with closing(BenchClock((host, int(port)), 0.0)) as clock:
            yield bench, clock


@contextmanager
def connected(bench: BenchHost) -> Iterator[Chamber]:
    with closing(open_chamber(f"tcp://{bench.endpoints['chamber']}", profile("virtual_chamber"))) as chamber:
        chamber.identify()
        yield chamber


class Controlled:
    """The control of the bench's chamber through Simserv, with the unit's temperature as the chamber's air."""

    def __init__(self, chamber: Chamber, clock: BenchClock) -> None:
        ranges = dict.fromkeys(("chamber", "table", "unit"), (-55.0, 100.0))
        limits = ChamberLimits(ranges, 5.0 / 60.0, ambient=23.0, dew_point=18.0)
        self.control, self._clock = ChamberControl(chamber, limits, clock, lambda event: None), clock
        self.control.begin()

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / 5.0)):
            self._clock.sleep(5.0)
            self.control.update({"": self.control.status.air_c})


@pytest.mark.parametrize(
    ("order", "value", "code"),
    [
        ("chamber_alarm", 7.0, "chamber.alarm"),
        ("chamber_door", 600.0, "chamber.door_open"),
        ("chamber_off", 1.0, "chamber.not_running"),
        ("chamber_no_power", 1.0, "chamber.not_following"),
        ("chamber_set_point", 80.0, "chamber.set_point_changed"),
        ("chamber_sensor_stuck", 1.0, "chamber.sensor_stuck"),
        ("chamber_sensor_offset", 40.0, "chamber.too_fast"),
        ("mute_chamber", 100.0, "chamber.link"),
        ("slow_chamber", 0.2, ""),
        ("hang_up_chamber", 1.0, ""),
    ],
)
def test_every_fault_of_the_chamber_is_found_through_its_protocol(order: str, value: float, code: str) -> None:
    with running() as (bench, clock), connected(bench) as chamber:
        station = Controlled(chamber, clock)
        station.control.hold(-20.0)
        station.run(300.0)
        clock.inject({"order": order, "value": value})
        if code:
            with raises_code(DeviceFaultError, code):
                station.run(1500.0)
        else:
            station.run(100.0)


def test_units_of_a_batch_share_the_chamber_and_have_functions_of_their_own() -> None:
    other = {**SETTINGS, "unit": 2, "seed": 7, "clock_drift_ppm": -15.0, "thermal": {"self_heating_c": 8.0}}
    config = BenchConfig.model_validate({**SETTINGS, "secondaries": [other]})
    first = LiveBench(config, lambda: 0.0)
    second = LiveBench(config.secondaries[0], lambda: 0.0, first)
    assert second.chamber is first.chamber
    assert first.chamber is not None
    first.chamber.start()
    first.chamber.set_point = 60.0
    for second_of_time in range(1, 301):
        first.advance(float(second_of_time))
    assert first.thermal is not None
    assert second.thermal is not None
    assert second.sample_count == pytest.approx(first.sample_count, abs=1)
    assert b"".join(second.outbox)
    assert second.thermal.temperatures[0] - first.thermal.temperatures[0] > 2.0
    base = np.zeros(COUNT)
    assert np.abs(first.thermal.steady(base, 80.0) - second.thermal.steady(base, 80.0)).max() > 0.0
