"""A simulated station with a golden unit: calibrations with the fast MEMS schedule, charts of the table's geometry.

A run consists of the bench's truth, the solver and the fit of the table, without protocols and logs, and takes 0.15 s.
Every run draws new mounting, noise, bias drift and encoder errors. The golden unit and the table remain the same; the
production units between two golden runs are all different.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from multiprocessing import get_context
from typing import Any

import numpy as np

from calstation.bench import BenchConfig
from calstation.bench.truth import BenchTruth
from calstation.estimation.common import Posterior, SolveContext, stage_data
from calstation.estimation.positions import TABLE_QUANTITIES, table_axes, table_rests
from calstation.physics import FloatArray
from calstation.quality import BASELINE, WEIGHT, WIDTH, alarms
from calstation.results import one_blas_thread
from calstation.simulation.study import (
    MOUNT_DEG,
    TILT_DEG,
    Schedules,
    draw_unit,
    fast_schedule,
    feed_until_targets,
    simulate_stages,
    study_prior,
)
from procedures import method

#: Number of runs after a shift within which an alarm is expected, and accepted number of alarms in control.
WITHIN, MOST_ALARMS = 10, 3

#: Standard deviation of the true values of the bench's axes from table to table, rad.
AXIS_ERROR = (
    float(np.deg2rad(BenchConfig().non_orthogonality_arcsec / 3600.0)),
    *2 * (float(np.deg2rad(TILT_DEG)) / np.sqrt(2.0),),
)

_STAGE = "designed"
#: Number of resampled series for the probabilities, and of runs before the shift in each.
_TRIALS, _BEFORE = 1000, 60

Shift = tuple[float, float, float]
_NO_SHIFT: Shift = (0.0, 0.0, 0.0)
#: Seed of the first production unit.
_OTHERS = 1_000_000


@dataclass(frozen=True)
class GoldenRun:
    """A calibration of the golden unit."""

    posterior: Posterior
    estimated: tuple[str, ...]
    table: FloatArray  #: Values of `TABLE_QUANTITIES`, rad, shape (3,).


@cache
def _schedules() -> Schedules:
    return fast_schedule("mems")


def golden_unit(unit: int) -> tuple[BenchTruth, SolveContext]:
    """Return the bench with the golden unit of a seed, and the context of its solver."""
    return draw_unit("mems", unit, "estimated", instability=True)


def golden_run(number: int, seed: int, shift: Shift = _NO_SHIFT, unit: int | None = None) -> GoldenRun:
    """Calibrate the golden unit of a seed, or another `unit` on the same table.

    `number` selects mounting, noise, and errors of the encoders. `shift` is added to the table's true geometry, in the
    order of `TABLE_QUANTITIES`, rad.
    """
    truth, context = golden_unit(seed)
    if unit is not None:
        other, context = golden_unit(unit)
        truth = replace(truth, imu=other.imu)
    random = np.random.default_rng([seed, number])
    direction = random.standard_normal(3)
    mount = direction / np.linalg.norm(direction) * np.deg2rad(random.uniform(*MOUNT_DEG))
    noise = int(random.integers(2**31))
    chosen, schedules = method(_STAGE), _schedules()
    schedule = chosen.schedule(**schedules[_STAGE])
    with one_blas_thread():
        block = simulate_stages(_moved(truth, mount, shift), noise, [_STAGE], schedules)[_STAGE]
        solver = chosen.solver(context, study_prior("mems", "estimated"), schedule)
        samples = feed_until_targets(solver, block, schedule)
        solution = solver.finish()
        rests = table_rests(stage_data([samples], context.imu), context, solution.posterior)
        found = table_axes([rests], context, solution.posterior)
    table = np.array([found[name].value for name in TABLE_QUANTITIES])
    return GoldenRun(solution.posterior, tuple(solution.estimated), table)


def _moved(truth: BenchTruth, mount: FloatArray, shift: Shift) -> BenchTruth:
    """Return the bench with another mounting, rad, shape (3,), and shifted axes; a tilt is about x and y at home."""
    table, cosine, sine = truth.table, np.cos(truth.table.azimuth), np.sin(truth.table.azimuth)
    east = table.base_tilt[0] + cosine * shift[1] + sine * shift[2]
    north = table.base_tilt[1] - sine * shift[1] + cosine * shift[2]
    x, y, z = mount.tolist()
    apart = table.non_orthogonality + shift[0]
    return replace(
        truth,
        table=replace(table, mount=(x, y, z), non_orthogonality=apart, base_tilt=(float(east), float(north), 0.0)),
    )


def golden_demo(
    runs: int = 370,
    shift: float = 1.0,
    seed: int = 1,
    quantity: str = "orthogonality",
    production: int = 4,
    progress: Callable[[int, int], None] = lambda done, count: None,
    workers: int = 2,
) -> dict[str, Any]:
    """Chart the table over golden runs without a shift, and over runs after a shift of a table's axis.

    The first `BASELINE` runs determine center and standard deviation of each chart. `runs` golden runs without a shift
    follow, each after `production` runs of other units, which also measure the table. Then the axis of `quantity` is
    shifted by `shift` run-to-run standard deviations, and `WITHIN` golden runs follow, again with production runs. The
    same is repeated for a shift by `AXIS_ERROR`.

    Returns JSON data: the alarms of the charts, and the probabilities of `false_alarms` and `detection`. `passed` means
    at most `MOST_ALARMS` alarms of all charts without a shift, and an alarm of the chart of `quantity` within `WITHIN`
    golden runs after each shift.
    """
    period = production + 1
    steady, after = BASELINE + runs * period, WITHIN * period
    done = 0

    def measured(first: int, count: int, moved: FloatArray) -> FloatArray:
        nonlocal done
        rows = []
        shifts: Shift = (float(moved[0]), float(moved[1]), float(moved[2]))
        for row in _map(
            partial(_table_of, seed=seed, period=period, shift=shifts), range(first, first + count), workers
        ):
            rows.append(row)
            done += 1
            progress(done, steady + 2 * after)
        return np.array(rows)

    values = measured(0, steady, np.zeros(3))
    baseline, tested = values[:BASELINE], values[BASELINE:]
    center, sigma = baseline.mean(axis=0), baseline.std(axis=0, ddof=1)
    at = TABLE_QUANTITIES.index(quantity)
    count = sum(len(alarms(tested[:, i], center[i], sigma[i])) for i in range(3))
    axis = AXIS_ERROR[at] / sigma[at]
    alarmed = []
    for number, size in enumerate((shift, axis)):
        moved = measured(steady + number * after, after, size * sigma[at] * np.eye(3)[at])
        found = alarms(np.concatenate([tested, moved])[:, at], center[at], sigma[at])
        later = [k - len(tested) + 1 for k in found if k >= len(tested)]
        alarmed.append(later[0] if later else None)
    return {
        "schema": "calstation.golden_demo/1",
        **{"runs": runs, "production": production, "shift": shift, "seed": seed, "quantity": quantity},
        **{"baseline": BASELINE, "weight": WEIGHT, "width": WIDTH, "within_runs": after},
        "sigma": dict(zip(TABLE_QUANTITIES, sigma.tolist(), strict=True)),
        "alarms": count,
        "alarmed_after_runs": alarmed[0],
        "axis_error": float(axis),
        "axis_alarmed_after_runs": alarmed[1],
        **false_alarms(tested, runs * period, seed),
        **detection(tested, after, shift, seed),
        "golden_alone": {
            "shift": detection(tested, WITHIN, shift, seed),
            "axis_error": detection(tested, WITHIN, np.array(AXIS_ERROR) / tested.std(axis=0, ddof=1), seed),
        },
        "passed": count <= MOST_ALARMS and None not in alarmed,
    }


def _map(work: Callable[[int], FloatArray], numbers: Iterable[int], workers: int) -> Iterator[FloatArray]:
    """Yield results in order; with 1 worker, they are computed in the calling process."""
    if workers == 1:
        yield from map(work, numbers)
        return
    with get_context("spawn").Pool(workers) as pool:
        yield from pool.imap(work, numbers, chunksize=10)


def _table_of(number: int, seed: int, period: int, shift: Shift) -> FloatArray:
    """Return the table's values of a run, rad, shape (3,); the last run of each period is golden."""
    golden = number % period == period - 1
    return golden_run(number, seed, shift, None if golden else _OTHERS + number).table


def false_alarms(values: FloatArray, runs: int, seed: int) -> dict[str, float]:
    """Return the alarm statistics of the charts over `_TRIALS` series drawn from runs without a shift, shape (n, 3).

    Each series has its own baseline. `run_length` is the mean number of runs between alarms of all charts
    together, `few_alarms` the probability of at most `MOST_ALARMS` alarms of all charts together in `runs` runs.
    """
    series = _Resampled(values, seed)
    total = np.array([sum(map(len, found)) for found in series.alarms(series.draw(runs))])
    return {
        "run_length": float(runs * _TRIALS / max(int(total.sum()), 1)),
        "few_alarms": float(np.mean(total <= MOST_ALARMS)),
    }


def detection(values: FloatArray, within: int, shift: float | FloatArray, seed: int) -> dict[str, dict[str, float]]:
    """Return the detection delay of a shift over `_TRIALS` series drawn from runs without a shift, shape (n, 3).

    `shift` is in standard deviations of `values`, the same for all quantities or of shape (3,). `alarmed_in_time` is
    the probability by quantity that its chart raises an alarm within `within` runs, `median_runs` the median number of
    runs.
    """
    series = _Resampled(values, seed)
    longest = max(within, 10 * WITHIN)
    # each chart is evaluated with a shift of its own quantity only
    moved = series.draw(longest) + shift * values.std(axis=0, ddof=1)
    found = series.alarms(np.concatenate([series.draw(_BEFORE), moved]))
    first = np.array(
        [[next((a - _BEFORE + 1 for a in each if a >= _BEFORE), longest + 1) for each in row] for row in found]
    )
    return {
        "alarmed_in_time": dict(zip(TABLE_QUANTITIES, np.mean(first <= within, axis=0).tolist(), strict=True)),
        "median_runs": dict(zip(TABLE_QUANTITIES, np.median(first, axis=0).tolist(), strict=True)),
    }


class _Resampled:
    """Series drawn from runs, each with its own baseline."""

    def __init__(self, values: FloatArray, seed: int) -> None:
        self._values, self._random = values, np.random.default_rng([seed, 1])
        drawn = self.draw(BASELINE)
        self._center, self._sigma = drawn.mean(axis=0), drawn.std(axis=0, ddof=1)

    def draw(self, count: int) -> FloatArray:
        """Draw `count` runs of every series, shape (count, series, quantities)."""
        return np.asarray(self._values[self._random.integers(len(self._values), size=(count, _TRIALS))])

    def alarms(self, series: FloatArray) -> list[list[tuple[int, ...]]]:
        """Return the alarms by series and quantity."""
        center, sigma = self._center, self._sigma
        return [
            [alarms(series[:, k, i], center[k, i], sigma[k, i]) for i in range(center.shape[1])] for k in range(_TRIALS)
        ]
