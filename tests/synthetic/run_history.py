"""A synthetic history of runs: small result files of several products, stations and operators over a year.

It contains effects that quality statistics should reveal: a drift of one station, a station with a shorter schedule, a
table whose axes shift, a step in one lot, a tired operator, failing checks, repeated runs of failed units, a golden
unit of every product, and a study of units by operators.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from calstation.config import library, load_product
from calstation.jobs import ProgressCallback
from calstation.physics import NAMES, PARAMETERS, FloatArray
from calstation.quality import GaugePlan, limit_interval
from calstation.records import CheckId
from calstation.results import History
from tests.check_rows import check_row

#: Time of the first run and length of the history.
BEGIN = datetime(2025, 11, 3, tzinfo=UTC)
_SECONDS = 365 * 86400.0

#: Products and their shares of the runs.
_PRODUCTS = {"nav_a": 0.5, "tactical_b": 0.3, "mems_c": 0.2}
STATIONS = ("bench 1", "bench 2", "bench 3", "bench 4")
OPERATORS = ("Li Wei", "Zhang Min", "Wang Fang", "Chen Jie", "Liu Yang", "Zhao Lei")

#: Standard deviation of the units' values relative to half the width of the limits, and measurement noise relative to
#: the limit of its sigma, for the complete schedule.
_SPREAD, _NOISE = 0.27, 0.15
#: Station with a short schedule, and the ratio of its sigmas to those of the complete schedule.
_SHORT, _COARSER = "bench 4", 3.0
_STAGES = ["rate", "six_position", "excitation", "azimuth_flip"]
#: Geometry of the tables and its standard deviation from run to run, rad; station and size of the shift halfway.
_GEOMETRY = {"orthogonality": (3e-4, 1e-5), "tilt_x": (1e-3, 5e-5), "tilt_y": (-5e-4, 5e-5)}
_SHIFTED, _SHIFT = "bench 2", 2e-5
#: One of this many runs is made with the golden unit.
_GOLDEN_EVERY = 50
#: Fractions of runs that are stopped, and of runs in which only the data are bad.
_STOPPED, _BAD_DATA = 0.01, 0.015
#: Checks that fail for bad data.
_DATA_CHECKS: tuple[CheckId, ...] = (
    CheckId("consistency", "excitation"),
    CheckId("table_noise", "six_position"),
    CheckId("imu_noise", "rate"),
)

#: Units, operators and trials of the study, and the smallest number of runs of a history that contains it.
_STUDY = (10, 3, 3)
_STUDY_FROM = 500


@dataclass(frozen=True)
class _Product:
    """Distribution of the values of a product's units; all arrays have shape (30,), SI."""

    name: str
    prefix: str  #: Prefix of the serial numbers.
    low: FloatArray
    high: FloatArray
    spread: FloatArray  #: Standard deviation of the units.
    sigma: FloatArray  #: Standard deviation of a measurement.


def synthesise_runs(report: ProgressCallback, folder: Path, runs: int, seed: int) -> Path:
    """Job: write the results of `runs` synthetic runs into a folder, index them, and return the plan of the study.

    Each result is a file of about 3 KB without a log: the history index is rebuilt from them as from real results.
    """
    folder.mkdir(parents=True, exist_ok=True)
    plan = _plan(seed)
    for done, (name, result) in enumerate(_results(runs, np.random.default_rng(seed), plan)):
        text = json.dumps(result, ensure_ascii=False, separators=(",", ":"))
        (folder / f"{name}.json").write_text(text, encoding="utf-8")
        if done % 500 == 0:
            report(0.3 * done / runs)
    History(folder).refresh(lambda fraction: report(0.3 + 0.7 * fraction))
    path = folder / "studies" / "gauge.json"
    path.parent.mkdir(exist_ok=True)
    plan.save(path)
    return path


def _plan(seed: int) -> GaugePlan:
    units, operators, trials = _STUDY
    serials = [f"STUDY-{k + 1:02d}" for k in range(units)]
    return GaugePlan.random(_product("nav_a").name, serials, OPERATORS[:operators], (), trials, seed, BEGIN)


def _results(count: int, random: np.random.Generator, plan: GaugePlan) -> Iterator[tuple[str, dict[str, object]]]:
    """Yield names and results in chronological order."""
    products = [_product(name) for name in _PRODUCTS]
    made = [0] * len(products)
    again: list[tuple[int, str, FloatArray, int]] = []  # failed units, their true values and attempts
    golden = [random.normal(0.0, each.spread) for each in products]
    study = list(plan.order) if count >= _STUDY_FROM else []
    study_units = {serial: random.normal(0.0, products[0].spread) for serial in plan.units}
    step = _SECONDS / count
    for k in range(count):
        phase = k / count
        start = BEGIN + timedelta(seconds=(k + 0.8 * random.random()) * step)
        station, operator = str(random.choice(STATIONS)), str(random.choice(OPERATORS))
        attempt, which = 1, int(random.choice(len(products), p=list(_PRODUCTS.values())))
        drifts = True
        if study and count - k <= len(study):
            entry = study.pop(0)
            which, serial, operator, station, drifts = 0, entry.unit, entry.appraiser, STATIONS[0], False
            true = study_units[serial]
        elif k % _GOLDEN_EVERY == 0:
            serial, true = f"GOLDEN-{products[which].prefix}", golden[which]
        elif again and random.random() < 0.5:
            which, serial, true, attempt = again.pop(0)
        else:
            made[which] += 1
            serial = f"{products[which].prefix}-{made[which]:06d}"
            true = random.normal(0.0, products[which].spread)
            if 0.6 < phase < 0.7:  # a lot of accelerometers with a different scale
                true = true + _on("accel_scale_x", 1.0 * products[which].spread)
        product = products[which]
        sigma = product.sigma * (_COARSER if station == _SHORT else 1.0)
        value = true + random.normal(0.0, sigma)
        if drifts and station == "bench 3":
            value = value + _on("gyro_bias_z", (20.0 * phase) * product.sigma)
        if operator == "Wang Fang":
            value = value + _on("outer_lever_x", 2.0 * product.sigma)
        failed = _failed_checks(product, value)
        if random.random() < _BAD_DATA and not serial.startswith(("GOLDEN", "STUDY")):
            check = _DATA_CHECKS[random.choice(len(_DATA_CHECKS))]
            failed.append(check_row(*check, 3.0, 1.0, passed=False, unit="1"))
        outcome = "stopped" if random.random() < _STOPPED and drifts else "failed" if failed else "passed"
        if outcome == "failed" and attempt < 3 and not serial.startswith("GOLDEN"):
            again.append((which, serial, true, attempt + 1))
        name = f"{serial}_{start:%Y%m%dT%H%M%S%f}"
        result = _result(name, product, serial, start, station, operator, attempt, outcome, value, sigma, failed)
        yield name, result | {"table": _table(random, station, phase)}


def _table(random: np.random.Generator, station: str, phase: float) -> dict[str, object]:
    """Return the geometry of a station's table as measured by a run."""
    coarser = _COARSER if station == _SHORT else 1.0
    rows: dict[str, object] = {}
    for name, (true, sigma) in _GEOMETRY.items():
        shift = _SHIFT if (station, name) == (_SHIFTED, "orthogonality") and phase > 0.5 else 0.0
        value = random.normal(true + shift, coarser * sigma)
        rows[name] = {"value": float(f"{value:.5g}"), "sigma": coarser * sigma, "unit": "rad"}
    return rows


def _product(name: str) -> _Product:
    _, product = load_product(library.find("products", name))
    limits = np.array([limit_interval(product, parameter) for parameter in NAMES], dtype=float)
    sigmas = [limit.sigma_below for p in PARAMETERS if (limit := product.limits.get(p.group)) is not None]
    half = 0.5 * (limits[:, 1] - limits[:, 0])
    return _Product(
        product.name,
        name.upper().replace("_", ""),
        limits[:, 0],
        limits[:, 1],
        _SPREAD * half,
        _NOISE * np.array(sigmas),
    )


def _on(parameter: str, values: FloatArray) -> FloatArray:
    """Return the value of one parameter, and 0 for all others."""
    return np.where(np.array(NAMES) == parameter, values, 0.0)


def _failed_checks(product: _Product, value: FloatArray) -> list[dict[str, object]]:
    """Return the checks of limits that the values fail, as in a result JSON."""
    return [
        check_row("within", p.name, float(value[i]), [product.low[i], product.high[i]], passed=False, unit=p.unit)
        for i, p in enumerate(PARAMETERS)
        if not product.low[i] <= value[i] <= product.high[i]
    ]


def _result(
    name: str,
    product: _Product,
    serial: str,
    start: datetime,
    station: str,
    operator: str,
    attempt: int,
    outcome: str,
    value: FloatArray,
    sigma: FloatArray,
    failed: list[dict[str, object]],
) -> dict[str, object]:
    stopped = outcome == "stopped"
    rows = {
        p.name: {"value": float(f"{value[i]:.7g}"), "sigma": float(f"{sigma[i]:.3g}"), "unit": p.unit}
        for i, p in enumerate(PARAMETERS)
    }
    return {
        "schema": "calstation.result/1",
        "unit": {"serial": serial},
        "stages": [] if stopped else ["designed"] if station == _SHORT else _STAGES,
        "passed": None if stopped else not failed,
        "parameters": {} if stopped else rows,
        "checks": [] if stopped else failed,
        "outcome": outcome,
        "attempt": attempt,
        "operator": operator,
        "station": station,
        "product": product.name,
        "log": {"file": f"{name}.h5"},
        "started_utc": start.isoformat(),
        "duration_s": 750.0,
    }
