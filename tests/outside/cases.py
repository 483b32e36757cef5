"""Known causes of wrong verdicts in both simulators: a table of which calibrations pass, and which cause is named.

python -m tests.outside.cases --seeds 5 --json cases.json
"""

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from calstation.estimation.common import SampleBlock
from tests.judgement import faulty_samples as faulty
from tests.outside.sweep import Case, Change, Outcome, run

#: Largest error over sigma with which a run may pass.
MOST_SIGMAS = 5.0


@dataclass(frozen=True)
class Row:
    """One kind of case; `causes` are those that name it, none for a sound unit."""

    title: str
    product: str
    causes: tuple[str, ...] = ()
    entries: dict[str, Any] = field(default_factory=dict)  #: Entries of `Case`.

    def cases(self, seeds: int) -> Iterator[Case]:
        """Yield a case for each seed and simulator."""
        grade = self.product.split("_")[0]
        for seed in range(1, seeds + 1):
            for simulator in ("bench", "plain"):
                case = Case(grade=grade, product=self.product, seed=seed)
                yield replace(case, simulator=simulator, **self.entries)


#: Motions of a table, which no sound unit may be blamed for.
MOTIONS = {
    "sway of 0.3 mm/s at 8 Hz": {"sway_mm_s": 0.3},
    "sway of 0.3 mm/s at 10.03 Hz": {"sway_mm_s": 0.3, "sway_hz": 10.03},
    "sway of 0.5 mm/s at 50.02 Hz": {"sway_mm_s": 0.5, "sway_hz": 50.02},
    "velocity of 0.5 mm/s, smoothed over 0.3 s": {"slow_mm_s": 0.5, "slow_s": 0.3},
    "velocity of 0.5 mm/s, smoothed over 1 s": {"slow_mm_s": 0.5, "slow_s": 1.0},
    "rocking of 1 µrad at 3 Hz": {"rocking_urad": 1.0},
    "rocking of 20 µrad at 3 Hz": {"rocking_urad": 20.0},
    "creep of 100 µrad within 10 s of a move": {"creep_urad": 100.0},
}


def rows() -> Iterator[Row]:
    """Yield all kinds of cases, in the order of the table."""
    yield from _tables()
    yield from _units()
    yield from _samples()
    yield from configurations()


def _tables() -> Iterator[Row]:
    for title, motion in MOTIONS.items():
        for product in ("nav_a", "nav_a_fast", "mems_c_fast"):
            yield Row(title, product, entries={"settings": {"table_motion": motion}})
    for ratio in (1.03, 1.1, 1.3, 2.0, 2.9):
        for product in ("mems_c", "nav_a_fast"):
            settings = {"velocity_sigma": 1e-3 * ratio}
            title = f"table with {ratio:g} times its noise"
            yield Row(title, product, ("table_vibrates",), entries={"settings": settings})
    for product in ("nav_a", "nav_a_fast", "mems_c_fast"):
        yield Row("axes of the table 2 mm apart", product, entries={"settings": {"axis_offset_mm": 2.0}})
        yield Row("axes 15 mm apart", product, ("axis_offset",), {"settings": {"axis_offset_mm": 15.0}})
    cross = {"settings": {"axis_offset_mm": 2.0}, "states": ("accel_cross",)}
    yield Row("axes 2 mm apart, state `accel_cross`", "nav_a_fast", ("state_not_unique", "axis_offset"), cross)


def _units() -> Iterator[Row]:
    four = {
        "gyro bias with a random walk": ("gyro_random_walk_dph_sqrt_h", (1.2, None), ("gyro_bias",)),
        "hysteresis of a gyro bias": ("gyro_hysteresis_dph", (0.14, 8.0), ("gyro_hysteresis",)),
        "hysteresis of a gyro scale factor": ("gyro_scale_hysteresis_ppm", (14.0, 600.0), ("gyro_scale_hysteresis",)),
        "flexure of the gyros": ("gyro_flex_urad_g", (26.0, 900.0), ("gyro_flex",)),
        "accelerometer term in rate²": ("accel_rate_square_ug", (2000.0, 15000.0), ("accel_rate_square",)),
        "g² term of a gyro": ("gyro_g_square_dph_g2", (0.17, 16.0), ("gyro_g_square",)),
        "fifth-order term of an accelerometer": ("accel_fifth_ug_g5", (25.0, 270.0), ("accel_fifth", "accel_cubic")),
        "gyro bias while a joint turns": ("gyro_moving_bias_dph", (1.0, 25.0), ("gyro_moving_bias",)),
        "accelerometer bias while a joint turns": ("accel_moving_bias_ug", (25.0, 240.0), ("accel_moving_bias",)),
        "accelerometer noise twice that of the profile": ("accel_noise", (2.0, 2.0), ("imu noise",)),
    }
    for title, (effect, sizes, causes) in four.items():
        for product, size in zip(("nav_a", "mems_c"), sizes, strict=True):
            if size is not None:
                yield Row(title, product, causes, {"effect": effect, "magnitude": size})
    designed = {
        "warm-up of a gyro scale factor": ("warm_up_gyro_scale_ppm.x", (60.0, 2000.0), ("gyro_scale",)),
        "accelerometer term in rate²": ("accel_rate_square_ug", (150.0, 3000.0), ("accel_rate_square",)),
        "cubic term of an accelerometer": ("accel_cubic_ug_g3.x", (130.0, 2000.0), ("accel_cubic", "accel_fifth")),
        "low-pass of 2 ms": ("low_pass_ms", (2.0, None), ("low_pass",)),
        "low-pass of 5 ms": ("low_pass_ms", (5.0, None), ("low_pass",)),
        "low-pass of 10 ms": ("low_pass_ms", (10.0, 20.0), ("low_pass",)),
        "increments compensated for coning": ("coning_compensation", (1.0, None), ("coning",)),
        "one gyro 0.02 ms late": ("gyro_delay_ms.y", (0.02, None), ("channel_delay",)),
        "accelerometers 0.1 ms late": ("accel_delay_ms", (0.1, None), ("time_skew",)),
    }
    for title, (effect, sizes, causes) in designed.items():
        for product, size in zip(("nav_a_fast", "mems_c_fast"), sizes, strict=True):
            if size is not None:
                yield Row(title, product, causes, {"effect": effect, "magnitude": size})
    states = {
        "gyro_square": ("gyro_square_ppm", 100.0, ()),
        "gyro_cubic": ("gyro_cubic_ppm", 1200.0, ("state_not_unique",)),
        "accel_asymmetry": ("accel_asymmetry_ppm", 60.0, ("state_not_corrected",)),
        "accel_off_axis": ("accel_off_axis_mm", 5.0, ("lever_x sigma below",)),
        "accel_cross": ("accel_cross_ug_g2", 30.0, ()),
    }
    for state, (effect, size, causes) in states.items():
        entries = {"effect": effect, "magnitude": size, "states": (state,)}
        yield Row(f"effect `{state}` as a state", "nav_a", causes, entries)
    yield Row("state `accel_off_axis` without the effect", "nav_a", entries={"states": ("accel_off_axis",)})


def _samples() -> Iterator[Row]:
    expected = {
        "lost": ("samples_lost",),
        "doubled": ("samples_repeated", "samples_doubled"),
        "repeated": ("samples_repeated", "samples_doubled"),
        "spikes": ("spikes",),
        "stuck": ("stuck",),
        "clipped": ("clipped",),
        "dead zone": ("dead_zone", "lock_in"),
        "stiction": ("stiction",),
        "wrapped": ("count_wrapped", "count_offset"),
    }
    titles = {
        "lost": "5 samples lost without a gap in the counter",
        "doubled": "5 samples doubled without a gap in the counter",
        "repeated": "5 samples replaced by the ones before",
        "spikes": "2 single spikes of 30 times the noise",
        "stuck": "gyro x stuck for 5 samples while it turns",
        "clipped": "gyro clipped at 99.8 % of its largest rate, remainder carried over",
        "dead zone": "gyro x reads 0 below 1 °/s",
        "stiction": "accelerometer x keeps its value until it changes by 8 times its noise",
        "wrapped": "a count of gyro x wraps by 65536 while it turns",
    }
    for change, causes in expected.items():
        for product in ("nav_a_fast", "mems_c_fast"):
            yield Row(titles[change], product, causes, {"change": change})


def configurations() -> Iterator[Row]:
    """Yield gross errors of the configuration."""
    axes = {"gyro x reversed": "reversed", "gyros x and y exchanged": "exchanged", "angles exchanged": "angles"}
    for title, change in axes.items():
        for product in ("nav_a", "mems_c_fast"):
            yield Row(title, product, ("angles_or_axes",), {"change": change})
    for title, change, causes in (
        ("force in g instead of m/s²", "g", ("accel_unit",)),
        ("rate in °/s instead of rad/s", "degrees", ("gyro_unit",)),
        ("count of gyro x wrong by 65536", "offset", ("count_offset",)),
    ):
        for product in ("nav_a", "mems_c_fast"):
            yield Row(title, product, causes, {"change": change})
    for title, entries, causes in (
        ("half the sample rate", {"sample_rate_hz": 100.0}, ("sample_rate_wrong",)),
        ("increments read as rates", {"output": "rate"}, ("output_kind",)),
    ):
        for product in ("nav_a", "mems_c_fast"):
            yield Row(title, product, causes, {"imu_entries": entries})
    for title, azimuth in (("heading wrong by 45°", 45.0), ("heading wrong by 180°", 180.0)):
        yield Row(title, "nav_a", ("heading",), {"site_entries": {"azimuth_deg": azimuth}})
    opposite = {"site_entries": {"azimuth_deg": -30.0}, "settings": {"azimuth_deg": 30.0}}
    yield Row("heading of the opposite sense", "nav_a", ("heading",), opposite)


def _turning(block: SampleBlock, count: int, channel: int = 0) -> list[int]:
    """Return samples spread over the turns of a gyro."""
    rate = np.abs(block.counts[:, channel])
    at = np.flatnonzero(rate > 0.95 * rate.max())
    return [int(at[k * len(at) // (count + 1)]) for k in range(1, count + 1)]


def _noise(block: SampleBlock, channel: int) -> float:
    """Return the noise of a channel, counts."""
    return float(np.median(np.abs(np.diff(block.counts[:, channel]))) / 0.954)


def _scaled(factor: float, channels: slice) -> faulty.Change:
    def change(counts: np.ndarray, angles: np.ndarray) -> None:
        counts[:, channels] = np.rint(factor * counts[:, channels])

    return change


def _wrapped(block: SampleBlock) -> SampleBlock:
    at = _turning(block, 1)[0]

    def change(counts: np.ndarray, angles: np.ndarray) -> None:
        counts[at : at + 40, 0] -= 2.0**16

    return faulty.with_columns(block, change)


#: Changes of the samples by name.
CHANGES: dict[str, Change] = {
    "lost": lambda block: faulty.lose(block, _turning(block, 5)),
    "doubled": lambda block: faulty.double(block, _turning(block, 5)),
    "repeated": lambda block: faulty.repeat(block, _turning(block, 5)),
    "spikes": lambda block: faulty.spike(block, 1, _turning(block, 2), 30.0 * _noise(block, 1) + 10.0),
    "stuck": lambda block: faulty.stick(block, 0, _turning(block, 3)[1], 5),
    "clipped": lambda block: faulty.clip(block, 0, np.floor(0.998 * np.abs(block.counts[:, 0]).max())),
    "dead zone": lambda block: faulty.dead_zone(block, 0, np.abs(block.counts[:, 0]).max() / 100.0),
    "stiction": lambda block: faulty.stiction(block, 3, 8.0 * _noise(block, 3)),
    "wrapped": _wrapped,
    "reversed": lambda block: faulty.with_columns(block, faulty.reverse(0)),
    "exchanged": lambda block: faulty.with_columns(block, faulty.exchange(0, 1)),
    "angles": lambda block: faulty.with_columns(block, faulty.exchange_angles),
    "g": lambda block: faulty.with_columns(block, _scaled(1.0 / 9.80665, slice(3, 6))),
    "degrees": lambda block: faulty.with_columns(block, _scaled(float(np.rad2deg(1.0)), slice(0, 3))),
    "offset": lambda block: faulty.with_columns(block, faulty.offset(0, 2.0**16)),
}


def outcomes(cases: list[Case], workers: int) -> Iterator[Outcome]:
    """Yield the outcomes in the order of the cases."""
    if workers == 1:
        yield from map(_run, cases)
        return
    with get_context("spawn").Pool(workers) as pool:
        yield from pool.imap(_run, cases)


def _run(case: Case) -> Outcome:
    return run(case, CHANGES)


def is_right(row: Row, outcome: Outcome) -> bool:
    """Whether the first cause of a failed run names the kind."""
    return any(cause in (outcome.cause or outcome.failed[0]) for cause in row.causes)


def line(row: Row, found: list[Outcome]) -> str:
    """Return the row of the table."""
    passed = [o for o in found if o.passed]
    right = [o for o in found if not o.passed and is_right(row, o)]
    other = Counter(o.cause.split(": ")[-1] or o.failed[0] for o in found if not o.passed and not is_right(row, o))
    worst = f" ({max(o.worst for o in passed):.1f} σ)" if passed else ""
    others = ", ".join(f"{count} × {cause}" for cause, count in other.most_common())
    named = Counter(c for o in right for c in row.causes if c in (o.cause or o.failed[0]))
    causes = f"{len(right)}: {named.most_common(1)[0][0]}" if right else ""
    return f"| {row.title} | {row.product} | {len(passed)}{worst} | {causes} | {others} |"


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--seeds", type=int, default=5, help="number of units, each in both simulators")
    parser.add_argument("--only", default="", help="part of a title")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    chosen = [row for row in rows() if args.only in row.title]
    per_row = 2 * args.seeds
    found: list[Outcome] = []
    begin = time.monotonic()
    for outcome in outcomes([case for row in chosen for case in row.cases(args.seeds)], args.workers):
        found.append(outcome)
        if len(found) % per_row == 0:
            row = chosen[len(found) // per_row - 1]
            left = (time.monotonic() - begin) * (len(chosen) * per_row / len(found) - 1.0)
            print(line(row, found[-per_row:]), flush=True)
            print(f"{len(found)} runs, {left:.0f} s left", file=sys.stderr)
            if args.json:
                args.json.write_text(json.dumps([asdict(outcome) for outcome in found], indent=1), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
