"""Calibrations of units with an unmodelled error: which still pass, and with which errors.

python -m tests.outside.sweep --effect accel_cubic_ug_g3=1,3,10 --grade nav --table quiet --seeds 4
"""

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from calstation.bench import BenchConfig
from calstation.bench.truth import GRADES, Effects, Simulator, unit_axes
from calstation.config import RunRequest, load_configuration
from calstation.errors import CalstationError
from calstation.estimation import Diagnosis
from calstation.estimation.common import SampleBlock
from calstation.judgement import Check, estimated_stage, judge
from calstation.messages import Text
from calstation.physics import INDEX, NAMES, FloatArray, group_indices, parameter_vector
from calstation.records import ModelSection
from calstation.results import StageChain, one_blas_thread
from calstation.simulation import bench_config
from calstation.simulation.study import feed_until_targets
from procedures import method
from tests.outside.plain_bench import PlainBench, Site, Unit

PRODUCTS = {"nav": "nav_a", "tactical": "tactical_b", "mems": "mems_c"}
#: Rms velocity of a table that is quieter than its profile says, m/s.
QUIET = 1e-5
SOUND = "none"
#: A change of the samples of a stage.
Change = Callable[[SampleBlock], SampleBlock]


@dataclass(frozen=True)
class Case:
    """One calibration.

    `effect` is a setting of `[bench.effects]` or of `[bench]`; `.x`, `.y` or `.z` limits it to one axis.
    `settings` are further settings.
    """

    effect: str = SOUND
    magnitude: float = 0.0
    seed: int = 1
    grade: str = "nav"
    table: Literal["profile", "quiet"] = "profile"
    simulator: Literal["bench", "plain"] = "bench"
    sample_rate_hz: float | None = None  #: None for that of the profile.
    settings: dict[str, Any] = field(default_factory=dict)
    product: str = ""  #: Default: the product of the grade with four stages.
    table_entries: dict[str, Any] = field(default_factory=dict)  #: Entries of [table] in the log.
    imu_entries: dict[str, Any] = field(default_factory=dict)  #: Entries of [imu] in the log.
    site_entries: dict[str, Any] = field(default_factory=dict)  #: Entries of [site] in the log.
    states: tuple[str, ...] = ()  #: Effects in the model.
    change: str = ""  #: Name of a change of the samples.


@dataclass(frozen=True)
class Outcome:
    """Verdict of a case; `worst` is the largest error over sigma of the estimated parameters, for `parameter`."""

    case: Case
    passed: bool
    worst: float
    parameter: str
    failed: tuple[str, ...]  #: Names of the failed checks, or the code of the error that ended the calibration.
    cause: str  #: First failed check that has a cause, this cause, and the parameter or group that changed.
    seconds: float  #: Processor time.
    estimates: dict[str, tuple[float, float]] = field(default_factory=dict)  #: Sizes of the states and their sigmas.


def bench_settings(case: Case, settings: dict[str, Any]) -> dict[str, Any]:
    """Return the bench configuration of a case, derived from its station."""
    chosen = dict(case.settings)
    if case.effect != SOUND:
        name, _, axis = case.effect.partition(".")
        chosen[name] = [case.magnitude * (axis == each) for each in "xyz"] if axis else case.magnitude
    effects = {name: value for name, value in chosen.items() if name in Effects.model_fields}
    others = {name: value for name, value in chosen.items() if name not in effects}
    quiet = {"velocity_sigma": QUIET} if case.table == "quiet" else {}
    rate = {} if case.sample_rate_hz is None else {"sample_rate_hz": case.sample_rate_hz}
    return {**settings, "seed": case.seed, "flash_file": None, **quiet, **rate, **others, "effects": effects}


def run(case: Case, changes: Mapping[str, Change] = MappingProxyType({})) -> Outcome:
    """Simulate the default stages of the grade's product, solve and judge them as a run does.

    `changes` are the changes of the samples of a stage, by name.
    """
    begin = time.process_time()
    product_file = Path("data/products") / f"{case.product or PRODUCTS[case.grade]}.toml"
    resolved = load_configuration(RunRequest("SN-000001", product=product_file))
    meta = resolved.log_meta()
    settings = bench_config(resolved)
    assert settings is not None
    config = BenchConfig.model_validate(bench_settings(case, settings))
    imu = meta.imu.model_copy(update={"sample_rate_hz": config.sample_rate_hz, **case.imu_entries})
    table = meta.table.model_copy(update=case.table_entries)
    model = ModelSection(states=list(case.states)) if case.states else meta.model
    site = meta.site.model_copy(update=case.site_entries)
    meta = meta.model_copy(update={"imu": imu, "table": table, "model": model, "site": site})
    simulator = simulator_of(case, config)
    chain = StageChain(meta)
    failed: tuple[str, ...] = ()
    checks: tuple[Check, ...] = ()
    try:
        with one_blas_thread():
            for stage, schedule in resolved.schedules.items():
                steps = method(stage).plan(resolved.table.geometry(), schedule)
                s = simulator.run(steps, stage, getattr(schedule, "rounds", None))
                valid = np.ones(len(s.seq), dtype=np.bool_)
                block = SampleBlock(stage, s.seq, s.time, s.counts, s.angles, s.step, valid, s.temperature)
                station = s.time / (1.0 + 1e-6 * config.effects.sample_clock_ppm)
                block = replace(block, station=station[:, None])
                if case.change:
                    block = changes[case.change](block)
                chain.start(stage)
                fed = feed_until_targets(chain, block, schedule)
                chain.finish()
                if len(fed) < len(block):  # the truth is that at the end of the stage
                    moves = schedule.model_dump()["moves"][: len(np.unique(fed.step))]
                    simulator = simulator_of(case, config)
                    shorter = schedule.model_copy(update={"moves": moves})
                    simulator.run(method(stage).plan(resolved.table.geometry(), shorter), stage)
        checks = judge(meta, chain.prior, tuple(chain.solutions)).checks
        failed = tuple(check.name for check in checks if not check.passed)
    except CalstationError as exc:
        what = exc.values.get("what")
        failed = (what.code if isinstance(what, Text) else exc.code,)
    causes = [f"{check.name}: {described(check.diagnosis)}" for check in checks if check.diagnosis is not None]
    found = simulator.parameters
    truth = found.copy() if isinstance(found, np.ndarray) else parameter_vector(found)
    # Two accelerometers moved along the axis of the third are a lever arm of all, and the third moved back.
    common = 0.5 * apart(simulator, config).sum(axis=0)
    # The lever arm is measured from the point of the inner axis that the profile states.
    table = config.truth().table
    along_inner = table.axis_offset[1] - 1e-3 * meta.table.axis_offset_mm[1]
    platform_lever = along_inner * unit_axes(table.orientation).T @ table.inner_axis
    truth[group_indices("outer_lever")] += common + platform_lever
    truth[group_indices("inner_lever")] -= common
    worst, parameter = worst_error(chain, truth)
    seconds = time.process_time() - begin
    estimates = {name: (e.value, e.sigma) for s in chain.solutions for name, e in s.estimates.items()}
    return Outcome(case, not failed, worst, parameter, failed, causes[0] if causes else "", seconds, estimates)


def simulator_of(case: Case, config: BenchConfig) -> Simulator | PlainBench:
    """Return a new simulator of the unit and the table of a case."""
    return Simulator(config.truth(), case.seed) if case.simulator == "bench" else plain_bench_of(config)


def apart(simulator: Simulator | PlainBench, config: BenchConfig) -> FloatArray:
    """Return the displacements of the accelerometers off their axes, m, shape (3, 3)."""
    if isinstance(simulator, PlainBench):
        return np.asarray(1e-3 * simulator.effects["accel_off_axis_mm"])
    return config.truth().imu.effects.off_axis


def described(diagnosis: Diagnosis) -> str:
    """Return a cause and the parameter or group that changed."""
    changed = diagnosis.values.get("parameter") or diagnosis.values.get("group") or ""
    return f"{diagnosis.cause} {changed}".rstrip()


def plain_bench_of(config: BenchConfig) -> PlainBench:
    """Return the second simulator with the unit and the table that the bench draws."""
    truth = config.truth()
    imu, table = truth.imu, truth.table
    site = Site(
        table.latitude,
        float(table.up_force_n[2]),
        table.azimuth,
        table.base_tilt,
        table.mount,
        table.outer_axis,
        table.inner_axis,
        table.non_orthogonality,
        table.axis_offset,
        table.velocity_sigma,
        truth.encoder.stop_sigma,
        table.motion.model_dump(),
    )
    grade = GRADES[config.grade]
    parameters = dict(zip(NAMES, truth.parameters.tolist(), strict=True))
    output = (imu.sample_rate, imu.output, imu.gyro_lsb, imu.accel_lsb, grade.gyro_arw, grade.accel_vrw)
    return PlainBench(site, Unit(parameters, *output, effects=config.effects.model_dump()), config.seed)


def worst_error(chain: StageChain, truth: FloatArray) -> tuple[float, str]:
    """Return the largest error over sigma of the estimated parameters, and its parameter."""
    sigma = chain.posterior.sigma
    errors = {
        name: float(abs(chain.posterior.mean[i] - truth[i]) / sigma[i])
        for name in estimated_stage(chain.solutions)
        if sigma[i := INDEX[name]] > 0.0
    }
    parameter = max(errors, key=lambda name: errors[name], default="")
    return errors.get(parameter, float("nan")), parameter


def outcomes(cases: list[Case], workers: int = 2) -> Iterator[Outcome]:
    """Yield the outcomes in the order of completion."""
    if workers == 1:
        yield from map(run, cases)
        return
    with get_context("spawn").Pool(workers) as pool:
        yield from pool.imap_unordered(run, cases)


def summary(found: list[Outcome]) -> str:
    """Return a table with a row for each effect and magnitude."""
    groups: dict[tuple[str, float], list[Outcome]] = {}
    for outcome in sorted(found, key=lambda o: (o.case.effect, abs(o.case.magnitude))):
        groups.setdefault((outcome.case.effect, outcome.case.magnitude), []).append(outcome)
    lines = [f"{'effect':30} {'magnitude':>9} {'passed':>7} {'worst if passed':>24}  first failed check with a cause"]
    for (effect, magnitude), group in groups.items():
        passed = [outcome for outcome in group if outcome.passed]
        worst = max(passed, key=lambda o: o.worst, default=None)
        missed = "" if worst is None else f"{worst.worst:.1f} {worst.parameter}"
        causes = Counter(o.cause or o.failed[0] for o in group if o.failed)
        shown = "; ".join(f"{count} × {cause}" for cause, count in causes.most_common())
        lines.append(f"{effect:30} {magnitude:9.4g} {f'{len(passed)}/{len(group)}':>7} {missed:>24}  {shown}")
    return "\n".join(lines)


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    about = "setting of [bench.effects] or [bench] and its values, separated by commas; sound units without"
    parser.add_argument("--effect", action="append", default=[], metavar="NAME=VALUES", help=about)
    parser.add_argument("--with", dest="settings", action="append", default=[], metavar="NAME=VALUE")
    parser.add_argument("--grade", choices=PRODUCTS, default="nav")
    parser.add_argument("--table", choices=("profile", "quiet"), default="profile")
    parser.add_argument("--simulator", choices=("bench", "plain"), default="bench")
    parser.add_argument("--sample-rate", type=float, help="Hz; that of the profile without")
    parser.add_argument("--product", default="", help="default: the product of the grade with four stages")
    parser.add_argument("--state", dest="states", action="append", default=[], help="effect in the model")
    parser.add_argument("--seeds", type=int, default=1, help="number of units")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    settings = {name: json.loads(value) for name, value in (each.split("=") for each in args.settings)}
    named = [each.split("=") for each in args.effect]
    effects = [(name, float(value)) for name, values in named for value in values.split(",")] or [(SOUND, 0.0)]
    seeds = range(args.first_seed, args.first_seed + args.seeds)
    base = Case(
        grade=args.grade,
        table=args.table,
        simulator=args.simulator,
        sample_rate_hz=args.sample_rate,
        settings=settings,
        product=args.product,
        states=tuple(args.states),
    )
    cases = [
        replace(base, effect=effect, magnitude=magnitude, seed=seed)
        for seed, (effect, magnitude) in product(seeds, effects)
    ]
    begin, found = time.monotonic(), []
    for outcome in outcomes(cases, args.workers):
        found.append(outcome)
        left = (time.monotonic() - begin) / len(found) * (len(cases) - len(found))
        c = outcome.case
        what = "passed" if outcome.passed else f"failed: {', '.join(outcome.failed[:3])} [{outcome.cause}]"
        print(
            f"{len(found)}/{len(cases)}, {left:.0f} s left: {c.effect} {c.magnitude:g}, seed {c.seed}: {what}, "
            f"{outcome.worst:.1f} sigma {outcome.parameter}, {outcome.seconds:.1f} s",
            file=sys.stderr,
        )
    if args.json:
        args.json.write_text(json.dumps([asdict(outcome) for outcome in found], indent=1), encoding="utf-8")
    print(summary(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
