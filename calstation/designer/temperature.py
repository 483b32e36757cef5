"""Design of a stage `temperature`: temperatures or a ramp, and the number of cycles of moves at each temperature."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np

from calstation.config import (
    RunRequest,
    check_chamber,
    check_manual_rig,
    edit_toml,
    load_configuration,
)
from calstation.designer.design import SERIAL, DesignRequest, Reached, multiline
from calstation.designer.designer import design_schedule
from calstation.designer.prediction import Prediction, optimal_nodes, with_assumed_orders
from calstation.designer.soaking import Course, Thermal, course_of, measured_thermal
from calstation.errors import ConfigurationError
from calstation.estimation.common import TemperatureModel
from calstation.jobs import ProgressCallback
from calstation.parsing import parse_toml
from calstation.physics import GROUPS, NAMES, Dwell, FloatArray, Move, Step
from calstation.records import Log
from calstation.results import one_blas_thread
from calstation.schema import KeyPath, validate
from calstation.sequencer import chamber_limits, check_limits
from procedures import method

_STAGE = "temperature"
#: Assumed time constant of a unit, s.
TIME_CONSTANT = 600.0
#: Number of temperatures minus the order of the polynomial, which includes one to test the order; smallest number of
#: temperatures.
_BEYOND_ORDER, _LEAST = 2, 3
#: Largest number of cycles at a temperature, and largest number of additional temperatures.
_MAX_CYCLES, _MAX_FURTHER = 16, 6
#: Largest difference of a set point from the required one, K, and factor by which the longest soak is extended.
_TOLERANCE, _RESERVE = 2.0, 1.5
#: Smallest distance of a temperature from a held-out temperature, K.
_APART = 5.0
#: Largest rate of a ramp relative to the largest rate of the chamber, for which it leaves a reserve; and the tried
#: rates relative to this rate.
_FASTEST, _RATES = 0.8, (1.0, 0.8, 0.6, 0.45, 0.3, 0.2, 0.1, 0.05)
#: Rate below which a unit is steady between two ramps, relative to the rate of the ramps, and largest distance of the
#: unit from its final temperature at this rate, K.
_STEADY, _SHORT = 0.1, 1.5


@dataclass(frozen=True)
class TemperatureSchedule(Reached):
    """A schedule; `sigma` contains the largest sigmas over the range."""

    at: FloatArray  #: Temperatures of the largest sigmas, °C, shape (30,).
    schedule: dict[str, Any]  #: Values of `[schedule.temperature]`.
    temperatures: int  #: Number of different temperatures of the fit; 0 for a ramp.
    cycles: int  #: Number of cycles of moves at a temperature.
    course: Course


@dataclass(frozen=True)
class TemperatureDesign:
    """The shortest schedule with soaks, the shortest ramp, and schedules with other numbers of temperatures."""

    soak: TemperatureSchedule
    ramp: TemperatureSchedule
    fewer: TemperatureSchedule | None  #: With two temperatures fewer and the same moves; None if too few.
    more: TemperatureSchedule  #: With two temperatures more and the same moves.
    is_ramp: bool  #: Whether the ramp is chosen.
    margin: float
    thermal: Thermal
    model: TemperatureModel

    @property
    def chosen(self) -> TemperatureSchedule:
        """The schedule that is written to the product."""
        return self.ramp if self.is_ramp else self.soak

    @property
    def duration(self) -> float:
        """Time in the chamber with the chosen schedule, s."""
        return self.chosen.course.duration

    @property
    def worst(self) -> float:
        """Largest sigma over the range with the chosen schedule, relative to its limit."""
        return self.chosen.worst

    @property
    def rows(self) -> Iterator[tuple[str, TemperatureSchedule | None]]:
        """The schedules by name: ``soak``, ``fewer``, ``more`` and ``ramp``."""
        yield from (("soak", self.soak), ("fewer", self.fewer), ("more", self.more), ("ramp", self.ramp))

    def to_json(self) -> dict[str, Any]:
        """Return the design as JSON data."""

        def shown(each: TemperatureSchedule) -> dict[str, Any]:
            names = [name for name, ratio in zip(NAMES, each.ratios, strict=True) if ratio > 0.0]
            return {
                "duration_s": each.course.duration,
                "points_c": each.schedule["points_c"],
                "ramp_c_per_min": each.schedule["ramp_c_per_min"],
                "cycles": each.cycles,
                "worst_sigma_over_limit": each.worst,
                "limiting": each.limiting,
                "sigma_over_limit": {name: float(each.ratios[NAMES.index(name)]) for name in names},
                "worst_at_c": {name: float(each.at[NAMES.index(name)]) for name in names},
            }

        return {
            "schema": "calstation.temperature_design/1",
            "chosen": "ramp" if self.is_ramp else "soak",
            "time_constant_s": self.thermal.time_constant,
            "self_heating_c": self.thermal.self_heating,
            "margin": self.margin,
            "order": {group: self.model.order.get(group, 0) for group in GROUPS},
            "schedule": self.chosen.schedule,
            **{name: None if each is None else shown(each) for name, each in self.rows},
        }


def design_temperature(
    report: ProgressCallback,
    request: DesignRequest,
    time_constant: float = TIME_CONSTANT,
    self_heating: float = 0.0,
) -> TemperatureDesign:
    """Job: find the shortest schedule over temperature that meets the limits of a product over its range.

    Raises ConfigurationError if there is none, or if chamber, table or unit do not permit the range.

    Parameters
    ----------
    report : callback for the progress
    request : product, station, margin and speeds
    time_constant : time constant of the unit's temperature in the air of the chamber, s
    self_heating : steady-state difference of the unit from the air, K
    """
    with one_blas_thread():
        return _Designer(report, request, time_constant, self_heating).run()


def unit_properties(
    measured: Log | None, time_constant: float | None, self_heating: float | None
) -> tuple[float, float]:
    """Return the time constant of a unit, s, and its self-heating, K: the stated, measured or assumed values.

    Raises InputError if the log does not determine them.

    Parameters
    ----------
    measured : log of the unit in a chamber; None if there is none
    time_constant : stated time constant, s; None for the measured or the assumed one
    self_heating : stated self-heating, K; None for the measured or the assumed one
    """
    tau, heating = (TIME_CONSTANT, 0.0) if measured is None else measured_thermal(measured)
    return time_constant or tau, heating if self_heating is None else self_heating


def temperature_product(text: str, design: TemperatureDesign) -> str:
    """Return the text of a product file with the designed stage as its only stage."""
    changes: dict[KeyPath, Any] = {("stages",): [_STAGE]}
    present = parse_toml(text).get("schedule", {})
    changes |= {("schedule", stage): None for stage in present if stage != _STAGE}
    for key, value in design.chosen.schedule.items():
        if key == "soak":
            changes |= {("schedule", _STAGE, key, name): number for name, number in value.items()}
        elif value != present.get(_STAGE, {}).get(key):
            changes["schedule", _STAGE, key] = multiline(value) if key == "moves" else value
    return edit_toml(text, changes)


class _Designer:
    def __init__(self, report: ProgressCallback, request: DesignRequest, time_constant: float, heating: float) -> None:
        self._report, self._margin = report, request.margin
        setup = load_configuration(RunRequest(SERIAL, request.station, request.product, stages=(_STAGE,)))
        check_manual_rig(setup)
        check_chamber(setup)
        chamber, section = chamber_limits(setup), setup.product.temperature
        if chamber is None or section is None:
            raise ConfigurationError("temperature.no_chamber")
        self._chamber = chamber
        self._thermal = Thermal(chamber.max_rate, chamber.ambient, time_constant, heating)
        limits = setup.sigma_limits()
        self._limits = np.array([limits.get(name, np.inf) for name in NAMES])
        if not np.isfinite(self._limits).any():
            raise ConfigurationError("design.no_limits", product=setup.product.name)
        self._geometry, self._settle = setup.table.geometry(), setup.table.settle_s
        self._values = setup.schedules[_STAGE].model_dump()
        if "moves" not in setup.product.schedule.get(_STAGE, {}):
            design = design_schedule(report, request)
            speeds = {"rate_dps": design.rate_dps, "acceleration_dps2": design.acceleration_dps2}
            self._values |= {"moves": design.moves[: design.planned], **speeds}
        for name, value in (("rate_dps", request.rate_dps), ("acceleration_dps2", request.acceleration_dps2)):
            if value is not None:
                self._values[name] = value
        self._model = with_assumed_orders(section.model())
        highest = max(self._model.order.values(), default=0)
        self._least = max(highest + _BEYOND_ORDER, _LEAST)  #: Smallest number of temperatures.
        self._determined = max(highest + 1, _LEAST)  #: Smallest number of temperatures without a test of the order.
        steps = [step for step in self._plan(self._schedule([0.0])) if isinstance(step, Move | Dwell)]
        for step in steps:
            if isinstance(step, Move):
                check_limits(self._geometry.limits, step)
        self._prediction = Prediction(setup.log_meta(), self._model, steps[1:], self._settle)
        self._ends = tuple(self._set_point(end) for end in self._model.range)

    def _set_point(self, temperature: float) -> float:
        """Return the set point for a temperature of the unit, °C. Raises ConfigurationError if it is not permitted."""
        low, high = self._chamber.range
        ideal = temperature - self._thermal.self_heating
        point = min(max(ideal, low), high)
        if abs(point - ideal) > _TOLERANCE:
            self._chamber.check(ideal)
        return round(float(point), 1)

    def _schedule(self, points: Sequence[float], cycles: int = 1, ramp: float | None = None) -> dict[str, Any]:
        """Return the values of a schedule, points in °C and ramp in K/min. Raises ConfigurationError if invalid."""
        moves = [list(move) for move in self._values["moves"]] * cycles
        return {**self._values, "points_c": list(points), "ramp_c_per_min": ramp, "moves": moves}

    def _plan(self, values: dict[str, Any]) -> list[Step]:
        schedule = validate(method(_STAGE).schedule, values, f"schedule.{_STAGE}")
        return list(method(_STAGE).plan(self._geometry, schedule))

    def run(self) -> TemperatureDesign:
        """Find the soaks and the ramp, and compare them."""
        soaks = list(self._soaks())
        reached = [each for each in soaks if self._reached(each)]
        soak = min(reached, key=lambda each: each.course.duration) if reached else min(soaks, key=lambda s: s.worst)
        ramp = self._ramp()
        if not (reached or self._reached(ramp)):
            best = min(soak, ramp, key=lambda each: each.worst)
            raise ConfigurationError("design.temperature_unreachable", parameter=best.limiting, worst=best.worst)
        count = soak.temperatures
        return TemperatureDesign(
            soak=soak,
            ramp=ramp,
            fewer=self._soak(count - 2, soak.cycles) if count - 2 >= self._determined else None,
            more=self._soak(count + 2, soak.cycles),
            is_ramp=self._reached(ramp) and (not reached or self._is_shorter(ramp, soak)),
            margin=self._margin,
            thermal=self._thermal,
            model=self._model,
        )

    def _reached(self, schedule: TemperatureSchedule) -> bool:
        return schedule.worst <= self._margin

    def _is_shorter(self, ramp: TemperatureSchedule, soak: TemperatureSchedule) -> bool:
        """Return whether a ramp is shorter and the product contains one.

        At useful rates, effects of a changing temperature, such as hysteresis, may not agree with the model.
        """
        return self._values["ramp_c_per_min"] is not None and ramp.course.duration < soak.course.duration

    def _soaks(self) -> Iterator[TemperatureSchedule]:
        """Yield a schedule for every number of temperatures while more temperatures may save time."""
        shortest = np.inf
        for further in range(_MAX_FURTHER + 1):
            self._report(further / (_MAX_FURTHER + 2))
            schedule = self._soak(self._least + further)
            yield schedule
            if schedule.course.duration > shortest:
                return
            if self._reached(schedule):
                shortest = schedule.course.duration

    def _soak(self, count: int, cycles: int | None = None) -> TemperatureSchedule:
        """Return the schedule for a number of temperatures, by default with the fewest cycles that meet the limits."""
        temperatures = self._temperatures(count)
        if cycles is not None:
            return self._evaluated(temperatures, cycles)
        cycles = 1
        while True:
            schedule = self._evaluated(temperatures, cycles)
            if self._reached(schedule) or cycles >= _MAX_CYCLES:
                return schedule
            needed = ceil(cycles * min((schedule.worst / self._margin) ** 2, 2.0))
            cycles = min(max(needed, cycles + 1), _MAX_CYCLES)

    def _evaluated(self, temperatures: FloatArray, cycles: int) -> TemperatureSchedule:
        reference, others = self._model.reference, {*temperatures[1:-1], *self._model.held_out}
        between = [self._set_point(t) for t in sorted(others - {reference})]
        points = self._tour([self._ends[0], *between, self._ends[1]])
        return self._result(self._schedule(points, cycles), cycles, len(temperatures))

    def _tour(self, rising: Sequence[float]) -> list[float]:
        """Return set points: the reference, all points in ascending order, and the reference again."""
        reference = self._set_point(self._model.reference)
        return [point for point, _ in itertools.groupby([reference, *rising, reference])]

    def _result(self, values: dict[str, Any], cycles: int, temperatures: int) -> TemperatureSchedule:
        """Return a schedule with its course and sigmas."""
        is_ramp = values["ramp_c_per_min"] is not None
        course = course_of(self._plan(values), len(values["moves"]), self._thermal, self._settle)
        sigmas = self._prediction.sigmas(course.cycles, cycles, after_soak=not is_ramp)
        at = self._model.temperatures[sigmas.argmax(axis=0)]
        soak = values["soak"]
        longest = 60.0 * ceil(_RESERVE * course.longest_soak / 60.0)
        values["soak"] = {**soak, "at_most_s": max(soak["at_most_s"], longest)}
        return TemperatureSchedule(sigmas.max(axis=0), self._limits, at, values, temperatures, cycles, course)

    def _temperatures(self, count: int) -> FloatArray:
        """Return `count` temperatures over the range, ends and reference included, °C.

        They minimise the largest sigma of a polynomial with `count` coefficients, and are then shifted so that one of
        them is the reference, and none is close to a held-out temperature.
        """
        (low, high), reference = self._model.range, self._model.reference
        temperatures = low + (high - low) * 0.5 * (1.0 + optimal_nodes(count))
        if low < reference < high:
            nearest = temperatures[1 + int(np.abs(temperatures[1:-1] - reference).argmin())]
            temperatures = np.interp(temperatures, [low, nearest, high], [low, reference, high])
        for held_out in self._model.held_out:
            k = int(np.abs(temperatures - held_out).argmin())
            is_fixed = k in (0, count - 1) or temperatures[k] == reference
            if abs(temperatures[k] - held_out) < _APART and not is_fixed:
                temperatures[k] = held_out + (_APART if temperatures[k] > held_out else -_APART)
        return temperatures

    def _ramp(self) -> TemperatureSchedule:
        """Return the fastest ramp that meets the limits, otherwise the slowest ramp."""
        points, chamber = self._tour(self._ends), 60.0 * self._thermal.rate
        largest = min(self._values["ramp_c_per_min"] or _FASTEST * chamber, chamber)
        for share in _RATES:
            rate = min(float(f"{share * largest:.2g}"), largest)
            values = self._schedule(points, 1, rate)
            slope = min(_STEADY * rate, 60.0 * _SHORT / self._thermal.time_constant)
            steady = float(f"{max(values['soak']['unit_rate_below_c_per_min'], slope):.2g}")
            values["soak"] = {**values["soak"], "unit_rate_below_c_per_min": steady}
            schedule = self._result(values, 1, 0)
            if self._reached(schedule):
                break
        return schedule
