"""Sizes of unmodelled effects that the default schedules cannot detect: the table of docs/limits-of-judgement.md.

python -m tests.outside.limits
python -m tests.outside.limits --designed
"""

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from calstation.bench.truth import GradeName
from calstation.config import RunRequest, library, load_configuration
from calstation.estimation.common import Posterior
from calstation.estimation.effects import EffectLimit, EffectTests, known_effects, last_turns
from calstation.physics import DEGREE_PER_HOUR, INDEX, MICRO_G
from calstation.results import one_blas_thread
from calstation.simulation.study import (
    FAST_PRODUCTS,
    GRADES,
    draw_unit,
    fast_schedule,
    feed_until_targets,
    simulate_stages,
    study_prior,
)
from procedures import DEFAULT_STAGES, method

#: χ² at which a test fails.
CHI_SQUARE = 31.0
_G = 9.8
_FAST = float(np.deg2rad(100.0))
#: Practical unit of an effect, and its size in SI.
UNITS = {
    "g_sensitivity": ("°/h/g", DEGREE_PER_HOUR / _G),
    "gyro_asymmetry": ("ppm", 1e-6),
    "gyro_square": ("ppm at 100 °/s", 1e-6 / _FAST),
    "gyro_cubic": ("ppm at 100 °/s", 1e-6 / _FAST**2),
    "accel_cubic": ("µg/g³", 1e-6 / _G**2),
    "accel_cross": ("µg/g²", 1e-6 / _G),
    "accel_asymmetry": ("ppm", 1e-6),
    "accel_off_axis": ("mm", 1e-3),
    "time_skew": ("ms", 1e-3),
    "axis_offset": ("mm", 1e-3),
    "channel_delay": ("ms", 1e-3),
    "low_pass": ("ms²", 1e-6),
    "coning": ("ms²", 1e-6),
    "gyro_flex": ("µrad/g", 1e-6 / _G),
    "gyro_g_square": ("°/h/g²", DEGREE_PER_HOUR / _G**2),
    "gyro_fifth": ("ppm at 100 °/s", 1e-6 / _FAST**4),
    "accel_fifth": ("µg/g⁵", 1e-6 / _G**4),
    "accel_rate_square": ("µg at 100 °/s", MICRO_G / _FAST**2),
    "gyro_moving_bias": ("°/h", DEGREE_PER_HOUR),
    "accel_moving_bias": ("µg", MICRO_G),
    "gyro_hysteresis": ("°/h", DEGREE_PER_HOUR),
    "gyro_scale_hysteresis": ("ppm", 1e-6),
    "gyro_bias": ("°/h", DEGREE_PER_HOUR),
    "accel_bias": ("µg", MICRO_G),
    "gyro_scale": ("ppm", 1e-6),
    "accel_scale": ("ppm", 1e-6),
}


def limits_of(grade: GradeName, designed: bool = False) -> tuple[list[EffectLimit], Posterior]:
    """Return the limits of all effects after the default stages of a unit, or after the designed stage; and its result.

    The designed stage is that of the grade's fast product.
    """
    stages = ("designed",) if designed else DEFAULT_STAGES
    schedules = fast_schedule(grade) if designed else {}
    truth, context = draw_unit(grade, 1, "estimated", instability=False)
    data = simulate_stages(truth, 1, list(stages), schedules)
    posterior = study_prior(grade, "estimated")
    tests = EffectTests(posterior.sigma, (), known_effects(posterior.sigma, context))
    for stage in stages:
        schedule = method(stage).schedule(**schedules.get(stage, {}))
        solver = method(stage).solver(context, posterior, schedule)
        feed_until_targets(solver, data[stage], schedule)
        solution = solver.finish()
        posterior = solution.posterior
        context = replace(
            context,
            initial_turn_senses=last_turns(solver.buffer.data(), posterior.mean, context.initial_turn_senses),
        )
        assert solution.sensitivity is not None
        tests.add(stage, solution.sensitivity, solution.estimated)
    return tests.limits(posterior, CHI_SQUARE), posterior


def worst_by_kind(
    limits: list[EffectLimit], weights: Mapping[str, float]
) -> Iterator[tuple[tuple[str, str, str], EffectLimit]]:
    """Yield for each effect, parameter group and stage the component that hides the largest error.

    An error in sigmas is multiplied by the weight of its parameter, 1 by default.
    """
    found: dict[tuple[str, str, str], EffectLimit] = {}
    largest: dict[tuple[str, str, str], float] = {}
    for limit in limits:
        key = (limit.cause, limit.parameter.rpartition("_")[0], limit.stage)
        hidden = limit.move * weights.get(limit.moved, 1.0)
        if key not in found or hidden > largest[key]:
            found[key], largest[key] = limit, hidden
    yield from found.items()


def _over_limit(grade: GradeName, posterior: Posterior) -> dict[str, float]:
    """Return the sigmas over the limits of the grade's fast product, by parameter."""
    product = library.find("products", FAST_PRODUCTS[grade])
    limits = load_configuration(RunRequest("SN-000001", product=product)).sigma_limits()
    return {name: posterior.sigma[INDEX[name]] / limit for name, limit in limits.items()}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--designed", action="store_true", help="of the fast products, with errors over sigma limits")
    designed = parser.parse_args().designed
    by_grade, over_limit = {}, {}
    with one_blas_thread():
        for grade in GRADES:
            limits, posterior = limits_of(grade, designed)
            over_limit[grade] = _over_limit(grade, posterior) if designed else {}
            by_grade[grade] = dict(worst_by_kind(limits, over_limit[grade]))
    print("| effect | during or before | unit |", " | ".join(f"{grade}: size, error" for grade in by_grade), "|")
    print("|---" * (3 + len(by_grade)), "|", sep="")
    for key in next(iter(by_grade.values())):
        cause, group, stage = key
        unit, size = UNITS[group or cause]
        cells = (
            f"{f[key].size / size:.2g}, {f[key].move:.1f} σ of {f[key].moved}"
            + (f", {f[key].move * over_limit[grade][f[key].moved]:.1f} limits" if designed else "")
            for grade, f in by_grade.items()
        )
        print(f"| {cause} {group} | {stage} | {unit} |", " | ".join(cells), "|")


if __name__ == "__main__":
    main()
