"""Calibrations without a rate table of units with an unmodelled error: which pass, and with which errors.

python -m tests.outside.methods --stage cross_calibration --effect accel_cubic=30,100,300 --seeds 5

The error is added to the output of the unit in a recording of the virtual bench.
"""

import argparse
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import product
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from scipy.ndimage import uniform_filter1d

from calstation.errors import CalstationError
from calstation.estimation import Diagnosis
from calstation.estimation.common import SampleBlock
from calstation.judgement import estimated_stage, judge
from calstation.physics import NAMES, FloatArray
from calstation.records import LogMeta, context_from_meta, open_log
from calstation.results import StageChain, one_blas_thread
from calstation.simulation import GradeName, Kind, make_recording
from tests.outside.sweep import PRODUCTS, SOUND, Case, Outcome, described, summary

STAGES: dict[str, Kind] = {"multi_position": "hand", "cross_calibration": "pair"}
G, DPH, FAST = 9.8, np.pi / 180.0 / 3600.0, np.deg2rad(100.0)
UG = 1e-6 * G
#: Signs of the terms of a matrix.
_SIGNS = np.array([[1.0, -1.0, 1.0], [1.0, 1.0, -1.0], [-1.0, 1.0, 1.0]])
#: Samples over which the measured rate and force are averaged, so that their noise does not become part of the error.
_WIDTH = 5

Error = Callable[[FloatArray, FloatArray, FloatArray], tuple[FloatArray | float, FloatArray | float]]
#: (rate, force, time) -> error of rate and force per unit of the size, SI.
EFFECTS: dict[str, Error] = {
    "g_sensitivity_dph_g": lambda w, f, t: (DPH / G * f @ _SIGNS.T, 0.0),
    "gyro_asymmetry_ppm": lambda w, f, t: (1e-6 * np.abs(w), 0.0),
    "gyro_square_ppm": lambda w, f, t: (1e-6 / FAST * w**2, 0.0),
    "gyro_cubic_ppm": lambda w, f, t: (1e-6 / FAST**2 * w**3, 0.0),
    "accel_cubic_ug_g3": lambda w, f, t: (0.0, UG / G**3 * f**3),
    "accel_cross_ug_g2": lambda w, f, t: (0.0, UG / G**2 * f[:, [1, 2, 0]] * f[:, [2, 0, 1]]),
    "accel_asymmetry_ppm": lambda w, f, t: (0.0, 1e-6 * np.abs(f)),
    "accel_delay_ms": lambda w, f, t: (0.0, -1e-3 * np.gradient(f, t, axis=0)),
    "warm_up_gyro_bias_dph": lambda w, f, t: (DPH * _settled(t), 0.0),
    "warm_up_accel_bias_ug": lambda w, f, t: (0.0, UG * _settled(t)),
    "warm_up_gyro_scale_ppm": lambda w, f, t: (1e-6 * _settled(t) * w, 0.0),
    "warm_up_accel_scale_ppm": lambda w, f, t: (0.0, 1e-6 * _settled(t) * f),
}


def _settled(time: FloatArray) -> FloatArray:
    return -np.expm1(-time / 300.0)[:, None]


def with_error(stage: str, block: SampleBlock, meta: LogMeta, case: Case) -> SampleBlock:
    """Return a recording with the error of a case, of the secondary if there is one."""
    context = context_from_meta(meta)
    imu = context.imu if stage == "multi_position" else context.secondaries[0].imu
    unit = imu.rate_factor * np.repeat([imu.gyro_lsb, imu.accel_lsb], 3)
    counts = np.asarray(block.counts if stage == "multi_position" else block.others[:, 0], float)
    measured = uniform_filter1d(unit * counts, _WIDTH, axis=0)
    rate, force = EFFECTS[case.effect](measured[:, :3], measured[:, 3:], block.time)
    still = np.zeros((len(counts), 3))
    counts = counts + case.magnitude * np.hstack([still + rate, still + force]) / unit
    if stage == "multi_position":
        return replace(block, counts=counts)
    others = np.asarray(block.others, float).copy()
    others[:, 0] = counts
    return replace(block, others=others)


def run(stage: str, case: Case) -> Outcome:
    """Make a recording, add the error, solve and judge it."""
    grade: GradeName = case.grade  # type: ignore[assignment]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "recording.h5"
        _, truth = make_recording(STAGES[stage], path, grade, case.seed)
        log = open_log(path)
        meta, blocks = log.meta, list(log.blocks())
    chain = StageChain(meta)
    failed: tuple[str, ...] = ()
    causes: list[str] = []
    errors = {"": np.nan}
    try:
        with one_blas_thread():
            chain.start(stage)
            for block in blocks:
                chain.feed(block if case.effect == SOUND else with_error(stage, block, meta, case))
            solution = chain.finish()
        checks = judge(meta, chain.prior, tuple(chain.solutions)).checks
        failed = tuple(check.name for check in checks if not check.passed)
        causes = [f"{check.name}: {_described(check.diagnosis)}" for check in checks if check.diagnosis is not None]
        mean, sigma = (dict(zip(NAMES, x.tolist(), strict=True)) for x in (chain.posterior.mean, chain.posterior.sigma))
        found = {name: (mean[name], sigma[name]) for name in estimated_stage(chain.solutions)}
        found |= {name: (e.value, e.sigma) for name, e in solution.estimates.items() if e.determined}
        errors = {name: abs(value - truth[name]) / s for name, (value, s) in found.items() if s > 0.0}
    except CalstationError as exc:
        failed = (exc.code,)
    worst = max(errors, key=lambda name: errors[name])
    return Outcome(case, not failed, float(errors[worst]), worst, failed, causes[0] if causes else "", 0.0)


def _described(diagnosis: Diagnosis) -> str:
    return described(diagnosis).replace("pair_effect", str(diagnosis.values.get("effect")))


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--stage", choices=STAGES, required=True)
    about = "name and values, separated by commas; sound units without"
    parser.add_argument("--effect", action="append", default=[], metavar="NAME=VALUES", help=about)
    parser.add_argument("--grade", choices=PRODUCTS, default="mems")
    parser.add_argument("--seeds", type=int, default=1, help="number of units")
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    named = [each.split("=") for each in args.effect]
    effects = [(name, float(value)) for name, values in named for value in values.split(",")] or [(SOUND, 0.0)]
    seeds = range(1, args.seeds + 1)
    cases = [Case(effect, magnitude, seed, args.grade) for seed, (effect, magnitude) in product(seeds, effects)]
    with get_context("spawn").Pool(args.workers) as pool:
        print(summary(list(pool.imap_unordered(partial(run, args.stage), cases))))
    return 0


if __name__ == "__main__":
    sys.exit(main())
