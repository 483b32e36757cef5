"""Sizes of unmodelled effects that the default schedules cannot detect: the table of docs/limits-of-judgement.md.

python -m tests.outside.limits
"""

from collections.abc import Iterator

import numpy as np

from calstation.estimation.effects import EffectLimit, EffectTests, known_effects
from calstation.physics import DEGREE_PER_HOUR, MICRO_G
from calstation.results import one_blas_thread
from calstation.simulation.study import GRADES, draw_unit, simulate_stages, study_prior
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
    "gyro_bias": ("°/h", DEGREE_PER_HOUR),
    "accel_bias": ("µg", MICRO_G),
    "gyro_scale": ("ppm", 1e-6),
    "accel_scale": ("ppm", 1e-6),
}


def limits_of(grade: str) -> list[EffectLimit]:
    """Return the limits of all effects after the default stages of a unit of this grade."""
    truth, context = draw_unit(grade, 1, "estimated", instability=False)
    data = simulate_stages(truth, 1, list(DEFAULT_STAGES), {})
    posterior = study_prior(grade, "estimated")
    tests = EffectTests(posterior.sigma, (), known_effects(posterior.sigma, (), context))
    for stage in DEFAULT_STAGES:
        solver = method(stage).solver(context, posterior, method(stage).schedule())
        solver.feed(data[stage])
        solution = solver.finish()
        posterior = solution.posterior
        assert solution.sensitivity is not None
        tests.add(stage, solution.sensitivity, solution.estimated)
    return tests.limits(posterior, CHI_SQUARE)


def worst_by_kind(limits: list[EffectLimit]) -> Iterator[tuple[tuple[str, str, str], EffectLimit]]:
    """Yield for each effect, parameter group and stage the component that hides the largest error."""
    found: dict[tuple[str, str, str], EffectLimit] = {}
    for limit in limits:
        key = (limit.cause, limit.parameter.rpartition("_")[0], limit.stage)
        if key not in found or limit.move > found[key].move:
            found[key] = limit
    yield from found.items()


def main() -> None:
    """Print the table."""
    with one_blas_thread():
        by_grade = {grade: dict(worst_by_kind(limits_of(grade))) for grade in GRADES}
    print("| effect | during or before | unit |", " | ".join(f"{grade}: size, error" for grade in by_grade), "|")
    print("|---" * (3 + len(by_grade)), "|", sep="")
    for key in next(iter(by_grade.values())):
        cause, group, stage = key
        unit, size = UNITS[group or cause]
        cells = (f"{f[key].size / size:.2g}, {f[key].move:.1f} σ of {f[key].moved}" for f in by_grade.values())
        print(f"| {cause} {group} | {stage} | {unit} |", " | ".join(cells), "|")


if __name__ == "__main__":
    main()
