"""Solve simulated logs of all grades, stages and schedules by calstation and by the second opinion, and compare them.

python -m tests.verify.compare --count 200 --json compare.json
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from calstation.bench import BenchConfig
from calstation.config import RunRequest, library, load_configuration
from calstation.estimation.common import SampleBlock
from calstation.records import RawLogWriter
from calstation.results import resolve
from calstation.schema import validate
from calstation.simulation import bench_config
from calstation.simulation.chamber_simulator import ChamberSimulator
from calstation.simulation.temperature_study import PRODUCTS as THERMAL_PRODUCTS
from calstation.simulation.temperature_study import RAMP_SCHEDULE, RATE_TERM
from calstation.verify import samples, verify
from procedures import method
from tests.make_references import SHORT
from tests.outside.sweep import PRODUCTS, bench_settings, simulator_of
from tests.outside.sweep import Case as SweepCase

#: Stages of a kind of log; `designed` uses the schedule that was designed for the product.
KINDS: dict[str, tuple[str, ...]] = {
    "four stages": ("rate", "six_position", "excitation", "azimuth_flip"),
    "designed": ("designed",),
    "rate and six_position": ("rate", "six_position"),
    "excitation": ("excitation",),
    "excitation and azimuth_flip": ("excitation", "azimuth_flip"),
}
#: Kinds of logs over temperature, with the entries of the schedule that differ from those of the product.
OVER_TEMPERATURE: dict[str, dict[str, Any]] = {"soaks": {}, "ramp": RAMP_SCHEDULE}
#: Short soaks, in which the temperature still changes, and their section `[temperature]`.
SHORT_SOAKS: dict[str, Any] = {
    "points_c": [25.0, 40.0, 20.0, 40.0, 20.0],
    "soak": {"unit_rate_below_c_per_min": 1.0, "hold_s": 30.0, "at_most_s": 2000.0},
}
SHORT_SECTION: dict[str, Any] = {
    "range_c": (24.0, 41.0),
    "order": dict.fromkeys(("gyro_bias", "gyro_scale", "accel_bias", "accel_scale"), 1),
    "rate_term": ["gyro_bias"],
}


@dataclass(frozen=True)
class Case:
    """A log; all of it follows from its number."""

    number: int
    grade: str
    kind: str
    simulator: Literal["bench", "plain"]
    is_short: bool  #: Whether the schedule is that of the reference logs instead of the product's.
    length: float  #: Ratio of the duration of rests to that of the product.
    outer_lever: Literal["estimated", "fixed"]
    latitude_deg: float
    gap: bool  #: Whether samples of the last stage are missing.


@dataclass(frozen=True)
class Comparison:
    """Differences of the results of a log."""

    case: Case
    samples: int
    largest: float  #: Largest difference of a value, sigma.
    parameter: str
    sigma_ratio: float  #: The ratio of two sigmas that is farthest from 1.
    findings: tuple[str, ...]
    seconds: float


def cases(count: int) -> Iterator[Case]:
    """Yield logs that cover all kinds, grades and simulators evenly."""
    for number in range(count):
        random = np.random.default_rng([number, 34])
        kind = [*KINDS][number % len(KINDS)]
        grade = [*PRODUCTS][number // len(KINDS) % len(PRODUCTS)]
        simulator: Literal["bench", "plain"] = "plain" if random.random() < 0.3 else "bench"
        is_short, length = bool(random.random() < 0.9), float(random.choice([0.25, 0.5, 1.0]))
        lever: Literal["estimated", "fixed"] = "fixed" if random.random() < 0.2 else "estimated"
        latitude, gap = float(random.uniform(-60.0, 60.0)), bool(random.random() < 0.2)
        yield Case(number, grade, kind, simulator, is_short, length, lever, latitude, gap)


def cases_over_temperature(count: int) -> Iterator[Case]:
    """Yield whole calibrations over temperature, soaks and ramps of both grades evenly."""
    for number in range(count):
        kind, grade = ("soaks", "ramp")[number // 2 % 2], ("mems", "nav")[number % 2]
        yield Case(number + 1, grade, kind, "bench", False, 1.0, "estimated", 34.25, gap=False)


def write_log_over_temperature(case: Case, path: Path) -> int:
    """Simulate a log of the stage `temperature` in the virtual chamber, see `write_log`."""
    stage, station = "temperature", library.find("stations", "virtual_chamber")
    product = library.find("products", THERMAL_PRODUCTS[case.grade])
    setup = load_configuration(RunRequest(f"SN-{case.number:06d}", station, product))
    meta, offset = setup.log_meta(), float(np.random.default_rng([case.number, 34]).normal(0.0, 0.5))
    rate = 100.0 if case.is_short else meta.imu.sample_rate_hz
    settings = {**(bench_config(setup) or {}), "flash_file": None, "sample_rate_hz": rate, "seed": case.number}
    config = BenchConfig.model_validate({**settings, "axis_offset_mm": offset})
    changed = SHORT_SOAKS if case.is_short else OVER_TEMPERATURE[case.kind]
    schedule = validate(method(stage).schedule, {**setup.schedules[stage].model_dump(), **changed}, stage)
    section = SHORT_SECTION if case.is_short else {"rate_term": sorted(RATE_TERM)} if case.kind == "ramp" else {}
    assert meta.temperature is not None
    imu = meta.imu.model_copy(update={"sample_rate_hz": rate})
    over = meta.temperature.model_copy(update=section)
    schedules = {stage: schedule.model_dump(mode="json")}
    writer = RawLogWriter(path, meta.model_copy(update={"imu": imu, "temperature": over, "schedule": schedules}))
    simulator = ChamberSimulator(config.truth(), config, case.number)
    s = simulator.run(method(stage).plan(setup.table.geometry(), schedule), stage)
    valid = np.ones(len(s.seq), np.bool_)
    writer.append(SampleBlock(stage, s.seq, s.time, s.counts, s.angles, s.step, valid, s.temperature))
    return writer.close("stopped").samples


def write_log(case: Case, path: Path) -> int:
    """Simulate a log, write it as a station does, and return its number of samples."""
    if case.kind in OVER_TEMPERATURE:
        return write_log_over_temperature(case, path)
    product = PRODUCTS[case.grade] + ("_fast" if case.kind == "designed" else "")
    setup = load_configuration(RunRequest("SN-000001", product=Path("data/products") / f"{product}.toml"))
    meta = setup.log_meta()
    lever = {"outer_lever": case.outer_lever}
    swept = SweepCase(grade=case.grade, seed=case.number, simulator=case.simulator, settings=lever)
    station = bench_config(setup)
    assert station is not None
    config = BenchConfig.model_validate({**bench_settings(swept, station), "latitude_deg": case.latitude_deg})
    site = meta.site.model_copy(update={"latitude_deg": case.latitude_deg, "gravity_mps2": None})
    gravity = config.truth().table.up_force_n[2]
    site = site.model_copy(update={"gravity_mps2": float(gravity), "gravity_sigma_mps2": 1e-5})
    table = meta.table.model_copy(update={"outer_lever": case.outer_lever})
    run = None if meta.run is None else meta.run.model_copy(update={"stages": [*KINDS[case.kind]]})
    meta = meta.model_copy(update={"site": site, "table": table, "run": run})
    simulator, writer = simulator_of(swept, config), RawLogWriter(path, meta)
    for stage in KINDS[case.kind]:
        schedule = setup.schedules[stage]
        entries = schedule.model_dump()
        rounds = max(round(min(case.length, 1.0) * entries.get("rounds", 0)), 1)
        rests = {name: case.length * value for name, value in entries.items() if name.endswith("dwell_s")}
        rounds = 1 if case.is_short else rounds
        schedule = schedule.model_copy(update=SHORT.get(stage, rests) if case.is_short else rests)
        s = simulator.run(method(stage).plan(setup.table.geometry(), schedule), stage, rounds)
        valid = np.ones(len(s.seq), dtype=np.bool_)
        block = SampleBlock(stage, s.seq, s.time, s.counts, s.angles, s.step, valid, s.temperature)
        middle = len(block) // 2
        writer.append(block.part(0, middle))
        writer.append(block.part(middle + 37 * (case.gap and stage == KINDS[case.kind][-1]), len(block)))
    return writer.close("stopped").samples


def compare(case: Case, folder: Path) -> Comparison:
    """Simulate a log in a folder, solve it twice, and compare the results."""
    begin = time.process_time()
    path = folder / f"{case.number}.h5"
    size = write_log(case, path)
    result = path.with_suffix(".json")
    result.write_text(json.dumps(resolve(path).result.to_json()), encoding="utf-8")
    report: dict[str, Any] = verify.verify(result)
    path.unlink()
    rows = report["parameters"]
    worst = max(rows, key=lambda name: abs(rows[name]["difference"]))
    ratio = max((row["sigma_ratio"] for row in rows.values()), key=lambda each: abs(each - 1.0))
    findings = tuple(f"{each['subject']}: {each['text']}" for each in report["findings"])
    seconds = time.process_time() - begin
    return Comparison(case, size, abs(rows[worst]["difference"]), worst, ratio, findings, seconds)


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--count", type=int, default=200, help="number of logs")
    parser.add_argument("--first", type=int, default=0, help="number of the first log")
    parser.add_argument("--over-temperature", action="store_true", help="logs of the stage temperature instead")
    parser.add_argument("--minutes", type=float, default=25.0, help="processor time after which no log is begun")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    compared: list[Comparison] = []
    with tempfile.TemporaryDirectory() as folder:
        chosen = cases_over_temperature if args.over_temperature else cases
        for case in chosen(args.first + args.count):
            if case.number < args.first or time.process_time() > 60.0 * args.minutes:
                continue
            try:
                done = compare(case, Path(folder))
            except (samples.NotCoveredError, samples.UnreadableError) as exc:
                print(case, "not covered:", exc, file=sys.stderr, flush=True)
                continue
            compared.append(done)
            print(
                f"{case.number}: {'short ' * case.is_short}{case.kind}, {case.grade}, {case.simulator}, "
                f"{case.length:g}, {case.outer_lever}: "
                f"{done.largest:.4f} sigma ({done.parameter}), sigma ratio {done.sigma_ratio:.4f}, {done.seconds:.1f} s"
                + "".join(f"\n    {each}" for each in done.findings),
                file=sys.stderr,
                flush=True,
            )
            if args.json:
                args.json.write_text(json.dumps([asdict(each) for each in compared], indent=1), encoding="utf-8")
    print(summary(compared))
    return 0


def summary(compared: list[Comparison]) -> str:
    """Return a table with a row for each kind of log and grade."""
    lines = ["| log | number | largest difference, sigma | sigmas |", "|---|---|---|---|"]
    for kind in (*KINDS, *OVER_TEMPERATURE):
        for grade in PRODUCTS:
            group = [each for each in compared if (each.case.kind, each.case.grade) == (kind, grade)]
            if group:
                worst = max(group, key=lambda each: each.largest)
                ratio = max(abs(each.sigma_ratio - 1.0) for each in group)
                largest = f"{worst.largest:.3f} ({worst.parameter})"
                lines.append(f"| {kind}, {grade} | {len(group)} | {largest} | {100 * ratio:.2f} % |")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
