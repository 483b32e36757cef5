"""Random cases from all effects, tables, grades and simulators: false passes and wrong diagnoses.

python -m tests.outside.grid --cases 200 --sizes 1.5 4 --json grid.json
python -m tests.outside.grid --sound 200 --grade mems
"""

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np

from tests.outside.sweep import PRODUCTS, SOUND, Case, Outcome, outcomes, summary

#: Largest error over sigma with which a run may pass.
MOST_SIGMAS = 5.0
#: Size of each effect that docs/limits-of-judgement.md says is found, by grade, and the causes that name it rightly;
#: a cause with a group of parameters counts only if it names one of that group.
EFFECTS: dict[str, tuple[tuple[float, float, float], tuple[str, ...]]] = {
    "g_sensitivity_dph_g": ((0.022, 0.33, 2.3), ("g_sensitivity",)),
    "gyro_asymmetry_ppm": ((3.7, 29.0, 140.0), ("gyro_asymmetry", "gyro_square")),
    "gyro_square_ppm": ((25.0, 180.0, 790.0), ("gyro_square", "gyro_asymmetry")),
    "gyro_cubic_ppm": ((310.0, 2000.0, 11000.0), ("gyro_cubic",)),
    "accel_cubic_ug_g3": ((9.0, 33.0, 100.0), ("accel_cubic",)),
    "accel_cross_ug_g2": ((8.0, 35.0, 120.0), ("accel_cross",)),
    "accel_asymmetry_ppm": ((16.0, 82.0, 300.0), ("accel_asymmetry",)),
    "accel_off_axis_mm": ((1.3, 2.6, 5.5), ("accel_off_axis",)),
    "gyro_delay_ms": ((0.04, 0.1, 0.4), ("channel_delay", "time_skew")),
    "coning_compensation": ((1.0, 1.0, 1.0), ("coning",)),
    "low_pass_ms": ((12.0, 18.0, 29.0), ("low_pass",)),
    "gyro_flex_urad_g": ((6.4, 44.0, 230.0), ("gyro_flex",)),
    "gyro_g_square_dph_g2": ((0.043, 0.57, 4.0), ("gyro_g_square",)),
    "gyro_fifth_ppm": ((6200.0, 41000.0, 230000.0), ("gyro_fifth", "gyro_cubic")),
    "accel_fifth_ug_g5": ((6.2, 22.0, 68.0), ("accel_fifth", "accel_cubic")),
    "accel_rate_square_ug": ((500.0, 1400.0, 3700.0), ("accel_rate_square",)),
    "gyro_moving_bias_dph": ((0.24, 1.1, 6.2), ("gyro_moving_bias",)),
    "accel_moving_bias_ug": ((6.1, 19.0, 59.0), ("accel_moving_bias",)),
    "gyro_hysteresis_dph": ((0.034, 0.3, 2.0), ("gyro_hysteresis",)),
    "gyro_scale_hysteresis_ppm": ((3.5, 28.0, 150.0), ("gyro_scale_hysteresis",)),
    "axis_offset_mm": ((15.0, 15.0, 15.0), ("axis_offset",)),
    "accel_delay_ms": ((0.02, 0.06, 0.24), ("time_skew",)),
    "warm_up_gyro_bias_dph": ((0.22, 1.6, 11.0), ("gyro_bias",)),
    "warm_up_accel_bias_ug": ((5.0, 25.0, 80.0), ("accel_bias",)),
    "warm_up_gyro_scale_ppm": ((26.0, 200.0, 680.0), ("gyro_scale",)),
    "warm_up_accel_scale_ppm": ((7.0, 26.0, 78.0), ("accel_scale",)),
    "gyro_jump_dph": ((0.10, 1.2, 8.5), ("gyro_bias",)),
    "accel_jump_ug": ((5.0, 37.0, 190.0), ("accel_bias",)),
    "gyro_random_walk_dph_sqrt_h": ((0.3, 2.0, 14.0), ("gyro_bias",)),
    "accel_random_walk_ug_sqrt_h": ((20.0, 80.0, 250.0), ("accel_bias",)),
    "gyro_noise": ((1.5, 1.5, 1.5), ("imu noise",)),
    "sample_clock_ppm": ((150.0, 150.0, 150.0), ("sample clock",)),
}
#: Times of the excitation and the azimuth flips, s.
_LATE = (700.0, 1850.0)


def drawn(random: np.random.Generator, sizes: list[float], sample_rate: float) -> Case:
    """Return a case of a random effect, `sizes` times its detectable size."""
    effect, grade = str(random.choice(list(EFFECTS))), str(random.choice(list(PRODUCTS)))
    size = EFFECTS[effect][0][list(PRODUCTS).index(grade)] * float(random.choice(sizes))
    settings = {"jump_at_s": round(float(random.uniform(*_LATE)))} if "jump" in effect else {}
    table, simulator = random.choice(["profile", "quiet"]), random.choice(["bench", "plain"])
    return Case(effect, size, int(random.integers(1, 100_000)), grade, table, simulator, sample_rate, settings)


def is_right(outcome: Outcome) -> bool:
    """Whether the first cause of a failed run names its effect."""
    named = EFFECTS[outcome.case.effect][1]
    return any(name in outcome.cause for name in named)


def report(found: list[Outcome]) -> Iterator[str]:
    """Yield a line for each effect and for all of them."""
    yield f"{'effect':30} {'runs':>5} {'failed':>6} {'right name':>10} {'passed, over 5 sigma':>21}"
    effects = sorted({o.case.effect for o in found})
    for name, group in [(e, [o for o in found if o.case.effect == e]) for e in effects] + [("all", found)]:
        failed, wrong = [o for o in group if not o.passed], [o for o in group if o.passed and o.worst > MOST_SIGMAS]
        yield f"{name:30} {len(group):5} {len(failed):6} {sum(map(is_right, failed)):10} {len(wrong):21}"
    for o in found:
        c = o.case
        where = f"{c.effect} {c.magnitude:.4g} {c.settings or ''}, {c.grade}, {c.table}, {c.simulator}, seed {c.seed}"
        if not o.passed and not is_right(o):
            yield f"named {o.cause or o.failed}: {where}"
        if o.passed and o.worst > MOST_SIGMAS:
            yield f"passed with {o.worst:.1f} sigma of {o.parameter}: {where}"


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--sizes", type=float, nargs="+", default=[1.5, 4.0], help="times the size that is found")
    parser.add_argument("--sound", type=int, help="sound units instead")
    parser.add_argument("--grade", choices=PRODUCTS, default="nav", help="of sound units")
    parser.add_argument("--sample-rate", type=float, default=100.0, help="Hz")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    random = np.random.default_rng(args.seed)
    if args.sound:
        tables, simulators = ("profile", "quiet"), ("bench", "plain")
        cases = [
            Case(SOUND, 0.0, args.seed + k, args.grade, tables[k % 2], simulators[k // 2 % 2], args.sample_rate)
            for k in range(args.sound)
        ]
    else:
        cases = [drawn(random, args.sizes, args.sample_rate) for _ in range(args.cases)]
    found: list[Outcome] = []
    for outcome in outcomes(cases, args.workers):
        found.append(outcome)
        print(f"{len(found)}/{len(cases)}", end="\r", file=sys.stderr, flush=True)
        if args.json:
            args.json.write_text(json.dumps([asdict(o) for o in found], indent=1), encoding="utf-8")
    print(summary(found) if args.sound else "\n".join(report(found)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
