"""The designer over temperature: optimal temperatures, times of soaks and ramps, and sigmas against closed forms."""

import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import calstation as cs
from calstation.config import RunRequest, check, library, load_configuration, load_product, read_text
from calstation.designer import DesignRequest, design_temperature, measured_thermal, temperature_product
from calstation.designer.prediction import Prediction, optimal_nodes
from calstation.designer.soaking import Thermal, course_of
from calstation.errors import ConfigurationError, InputError
from calstation.estimation.common import Posterior, SampleBlock, TemperatureModel
from calstation.physics import COUNT, INDEX, Dwell, Move, Ramp, Soak
from calstation.records import TemperatureSection
from procedures import method
from tests.helpers import raises_code
from tests.outside.thermal_bench import ThermalCase

STATION = library.find("stations", "virtual_chamber")
PRODUCT = library.find("products", "mems_c_thermal")
#: Sigma of a measured gyro bias x, and the weak prior, rad/s.
SIGMA, PRIOR = 1e-6, 1e-1
LINE = TemperatureModel(25.0, (-40.0, 85.0), {"gyro_bias": 1})


def design(product: Path = PRODUCT, **options):
    margin = options.pop("margin", 0.8)
    return design_temperature(lambda *_, **__: None, DesignRequest(STATION, product, margin), **options)


def product_with(tmp_path: Path, *changes: tuple[str, str]) -> Path:
    text = read_text(PRODUCT)
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "products" / "thermal_changed.toml"
    path.parent.mkdir()
    path.write_text(text, encoding="utf-8")
    return path


def bias_sigmas(model: TemperatureModel, temperatures) -> np.ndarray:
    """Return the predicted sigmas of a gyro bias over the range, if it is measured alone at each temperature."""
    setup = load_configuration(RunRequest("SN-000001", STATION, PRODUCT))
    prediction = Prediction(setup.log_meta(), model, [], 0.0)
    prior = np.zeros((COUNT, COUNT))
    prior[INDEX["gyro_bias_x"], INDEX["gyro_bias_x"]] = PRIOR**2
    prediction._prior = Posterior(np.zeros(COUNT), prior)
    measured = prior / (1.0 + (PRIOR / SIGMA) ** 2)
    prediction._posteriors[1, True] = Posterior(np.zeros(COUNT), measured)
    return prediction.sigmas([(t, 0.0) for t in temperatures])[:, INDEX["gyro_bias_x"]]


def test_sigmas_of_a_line_are_those_of_the_textbook() -> None:

    def expected(temperatures: np.ndarray) -> np.ndarray:
        distance, square = LINE.temperatures - temperatures.mean(), np.sum((temperatures - temperatures.mean()) ** 2)
        return SIGMA * np.sqrt(1.0 / len(temperatures) + distance**2 / square)

    temperatures = np.linspace(-40.0, 85.0, 6)
    predicted = bias_sigmas(LINE, temperatures)
    assert predicted == pytest.approx(expected(temperatures), rel=1e-6)
    ends = bias_sigmas(LINE, [-40.0] * 3 + [85.0] * 3)
    assert ends[[0, -1]] == pytest.approx(SIGMA / np.sqrt(3.0), rel=1e-6)
    assert ends.max() < predicted.max()
    # the sigmas include the hysteresis that temperatures visited from both sides do not exclude
    visits = np.array([25.0, -40.0, 25.0, 85.0] * 2)
    ratio = bias_sigmas(LINE, visits) / expected(visits)
    assert np.all((ratio > 1.05) & (ratio < 3.0)), ratio


@pytest.mark.parametrize("order", [2, 3, 4, 5])
def test_optimal_temperatures_leave_no_sigma_above_that_of_a_measurement(order: int) -> None:
    model = replace(LINE, order={"gyro_bias": order})
    nodes = 22.5 + 62.5 * optimal_nodes(order + 1)
    assert bias_sigmas(model, nodes).max() == pytest.approx(SIGMA, rel=1e-6)
    if order > 2:
        assert bias_sigmas(model, np.linspace(-40.0, 85.0, order + 1)).max() > 1.05 * SIGMA


@pytest.mark.parametrize(("tau", "hold", "heating"), [(300.0, 60.0, 0.0), (900.0, 120.0, 4.0), (20.0, 60.0, 0.0)])
def test_soak_lasts_as_long_as_the_exact_course_of_the_unit(tau: float, hold: float, heating: float) -> None:
    rate, ambient, target, limit = 3.0 / 60.0, 23.0, -40.0, 0.05
    course = course_of([Soak(target, limit, hold, 1e5, 1, 1)], 1, Thermal(rate, ambient, tau, heating), 1.5)
    arrived = (ambient - target) / rate + 60.0

    def slope(t, unit):
        return (max(ambient - rate * max(t - 60.0, 0.0), target) + heating - unit) / tau

    end = course.duration
    times = np.linspace(0.0, end, 20_001)
    unit = solve_ivp(slope, (0.0, end), [ambient], t_eval=times, max_step=5.0, rtol=1e-10, atol=1e-10).y[0]

    def slope_before(time: float) -> float:
        window = (times >= time - hold) & (times <= time)
        return 60.0 * abs(np.polyfit(times[window] - time, unit[window], 1)[0])

    assert end >= arrived + hold - 1e-6
    if end > arrived + hold + 1.0:
        assert slope_before(end) == pytest.approx(limit, rel=0.01)
    else:
        assert slope_before(end) < limit


def test_unit_on_a_ramp_lags_by_rate_and_time_constant() -> None:
    cycle = [Move(0.0, 0.0, 1.0, 1.0), Dwell(60.0)]
    steps = [Soak(-40.0, 0.05, 60.0, 1e5, 1, 2), *cycle, Ramp(80.0, 2.0), *cycle * 50]
    found = np.array(course_of(steps, 1, Thermal(5.0 / 60.0, 23.0, 120.0, 3.0), 0.0).cycles)
    assert found[0] == pytest.approx((-37.0, 0.0), abs=0.2)
    assert found[40] == pytest.approx((-40.0 + 2.0 * 39.5 + 3.0 - 4.0, 2.0 / 60.0), abs=1e-3)


def chamber_log(tau: float, heating: float, end: float) -> SimpleNamespace:
    """Return a log of a unit at 23 °C in a chamber that goes to -40 °C at 3 K/min, and stays there until `end`, s."""
    time = np.arange(0.0, end, 1.0)
    air = np.maximum(23.0 - time / 20.0, -40.0)
    unit = solve_ivp(lambda t, x: (max(23.0 - t / 20.0, -40.0) + heating - x) / tau, (0.0, end), [23.0], t_eval=time)
    noise = 0.02 * np.random.default_rng(1).standard_normal(len(time))
    count = len(time)
    samples = np.zeros((count, 6), np.int64), np.zeros((count, 2)), np.zeros(count, np.int64), np.ones(count, np.bool_)
    seq, chamber = np.arange(count), np.where(time % 2.0 == 0.0, air, np.nan)[:, None]
    block = SampleBlock("temperature", seq, time, *samples, np.round(unit.y[0] + noise, 2), chamber=chamber)
    return SimpleNamespace(
        path=Path("log"), blocks=lambda: iter([block.part(0, count // 2), block.part(count // 2, count)])
    )


@pytest.mark.parametrize(("tau", "heating"), [(60.0, 0.0), (300.0, 4.0), (900.0, 12.0)])
def test_properties_of_a_unit_are_measured_in_one_soak(tau: float, heating: float) -> None:
    found = measured_thermal(chamber_log(tau, heating, 1260.0 + 4.0 * tau))
    assert found == pytest.approx((tau, heating), rel=0.02, abs=0.05)


def test_log_without_a_change_of_the_chamber_is_refused() -> None:
    with raises_code(InputError, "design.no_chamber_air"):
        measured_thermal(chamber_log(300.0, 0.0, 100.0))


@pytest.fixture(scope="module")
def found():
    return design(time_constant=270.0, self_heating=4.0)


def test_designed_soaks_meet_the_limits_over_the_range_and_make_a_valid_product(found) -> None:
    assert found.chosen is found.soak
    assert found.soak.worst <= 0.8
    assert found.soak.schedule["points_c"][:2] == [21.0, -44.0]
    assert found.soak.schedule["points_c"][-2:] == [81.0, 21.0]
    assert found.soak.temperatures == 6
    assert found.fewer is None
    assert found.more.course.duration > found.soak.course.duration + 900.0
    assert found.more.worst < found.soak.worst
    assert found.ramp.course.duration < found.soak.course.duration
    text = temperature_product(read_text(PRODUCT), found)
    assert check("products", text) == []
    written = tomllib.loads(text)["schedule"]["temperature"]
    assert written["points_c"] == found.soak.schedule["points_c"]
    assert written["soak"]["at_most_s"] >= 1.5 * found.soak.course.longest_soak


def test_soaks_of_a_slow_unit_last_longer(found) -> None:
    slow = design(time_constant=1200.0)
    assert slow.soak.course.duration > 2.0 * found.soak.course.duration
    assert slow.to_json()["soak"]["duration_s"] == slow.soak.course.duration


@pytest.mark.long
def test_moves_are_repeated_until_the_limits_are_met(tmp_path: Path) -> None:
    path = product_with(tmp_path, ("sigma_below = 8.0e-06", "sigma_below = 4.0e-06"))
    found = design(path, time_constant=270.0)
    assert found.soak.worst <= 0.8
    assert found.soak.cycles > 1
    _, product = load_product(path)
    moves = product.schedule["temperature"]["moves"]
    assert found.soak.schedule["moves"] == [list(map(float, move)) for move in moves] * found.soak.cycles


@pytest.mark.parametrize(
    ("reference", "points"),
    [(25.0, [25.0, -40.0, 85.0, 25.0]), (85.0, [85.0, -40.0, 22.5, 85.0]), (-40.0, [-40.0, 22.5, 85.0, -40.0])],
)
def test_low_orders_need_three_temperatures(tmp_path: Path, reference: float, points: list[float]) -> None:
    changes = ('order = "auto"', "order = { gyro_bias = 1 }"), ("reference_c = 25.0", f"reference_c = {reference}")
    found = design(product_with(tmp_path, *changes), time_constant=270.0)
    assert found.soak.schedule["points_c"] == points
    assert found.soak.temperatures == 3
    assert found.fewer is None


def test_moves_beyond_the_limits_of_the_table_are_refused() -> None:
    with raises_code(ConfigurationError, "motion.rate_outside"):
        design_temperature(lambda *_, **__: None, DesignRequest(STATION, PRODUCT, rate_dps=999.0))


def test_ramp_is_chosen_if_it_is_stated_and_held_out_temperatures_are_visited(tmp_path: Path) -> None:
    stated = 'order = { gyro_bias = 2 }\nrate_term = ["gyro_bias"]\nheld_out_c = [22.0, 60.0]'
    path = product_with(tmp_path, ('order = "auto"', stated))
    assert not design(path, time_constant=270.0).is_ramp
    ramp = "[schedule.temperature]\nramp_c_per_min = 3.0"
    path.write_text(read_text(path).replace("[schedule.temperature]", ramp), encoding="utf-8")
    found = design(path, time_constant=270.0)
    assert found.is_ramp
    assert found.ramp.schedule["ramp_c_per_min"] == 3.0
    # between the ramps the unit need not be as steady as in a soak, but within 1.5 K of the end of the range
    assert found.ramp.schedule["soak"]["unit_rate_below_c_per_min"] == 0.3
    assert {60.0, 22.0} < set(found.soak.schedule["points_c"])
    text = temperature_product(read_text(PRODUCT), found)
    assert tomllib.loads(text)["schedule"]["temperature"]["ramp_c_per_min"] == found.ramp.schedule["ramp_c_per_min"]
    assert check("products", text) == []


@pytest.mark.long
def test_ramp_of_a_mems_unit_takes_less_than_two_hours(tmp_path: Path) -> None:
    stated = 'order = "auto"\nrate_term = ["gyro_bias", "accel_bias"]'
    ramp = "[schedule.temperature]\nramp_c_per_min = 4.0"
    path = product_with(tmp_path, ('order = "auto"', stated), ("[schedule.temperature]", ramp))
    found = design(path, time_constant=270.0, self_heating=4.0)
    assert found.is_ramp
    assert found.ramp.worst < 0.4
    assert found.ramp.course.duration < 6600.0
    slow = design(path, time_constant=900.0, self_heating=4.0)
    assert slow.ramp.schedule["soak"]["unit_rate_below_c_per_min"] == 0.1


def test_range_beyond_the_devices_and_a_station_without_chamber_are_refused() -> None:
    with raises_code(ConfigurationError, "chamber.target_outside"):
        design(self_heating=10.0)
    with raises_code(ConfigurationError, "temperature.no_chamber"):
        design_temperature(lambda *_, **__: None, DesignRequest(product=PRODUCT))


@pytest.mark.exhaustive
def test_limit_that_cannot_be_reached_is_refused(tmp_path: Path) -> None:
    path = product_with(tmp_path, ("sigma_below = 3.0e-05", "sigma_below = 3.0e-08"))
    with raises_code(ConfigurationError, "design.temperature_unreachable"):
        design(path)


@pytest.mark.long
def test_predicted_sigmas_are_those_of_a_simulated_solution() -> None:
    section = TemperatureSection(range_c=(-40.0, 85.0), order={"gyro_bias": 3, "gyro_scale": 2, "accel_bias": 2})
    temperatures = (25.0, -40.0, 0.0, 40.0, 85.0, 25.0)
    case = ThermalCase("mems_c_fast", temperatures, {}, section)
    chain, _ = case.solve()
    fit = chain.solutions[0].temperature
    # the differences between rising and falling temperature of a group may be significant by chance
    solved = np.sqrt(fit.largest_sigma**2 - fit.hysteresis**2)
    setup = load_configuration(RunRequest("SN-000001", product=library.find("products", "mems_c_fast")))
    plan = method("designed").plan(setup.table.geometry(), setup.schedules["designed"])
    steps = [step for step in plan if isinstance(step, Move | Dwell)]
    prediction = Prediction(case.meta(), section.model(), steps, setup.table.settle_s)
    predicted = prediction.sigmas([(t, 0.0) for t in temperatures]).max(axis=0)
    assert predicted / solved == pytest.approx(np.ones(COUNT), abs=0.1)


@pytest.mark.long
def test_python_designs_over_temperature_as_the_command_does(tmp_path: Path) -> None:
    file = tmp_path / "designed.toml"
    made = cs.design("mems_c_thermal", "virtual_chamber", 0.9, time_constant=270.0, self_heating=4.0, out=file)
    same = design(margin=0.9, time_constant=270.0, self_heating=4.0)
    assert isinstance(made, cs.TemperatureDesign)
    assert made.to_json() == same.to_json()
    assert (made.duration, made.worst) == (same.soak.course.duration, same.soak.worst)
    assert (
        tomllib.loads(file.read_text(encoding="utf-8"))["schedule"]["temperature"]["points_c"]
        == (same.soak.schedule["points_c"])
    )


def test_python_refuses_properties_of_a_chamber_for_a_product_of_one_temperature() -> None:
    with raises_code(ConfigurationError, "design.without_temperature"):
        cs.design("mems_c_fast", time_constant=270.0)
