"""Units over temperature with a fault, in the virtual bench without protocols: which pass, and which cause is named.

python -m tests.outside.thermal_cases --seeds 3
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from calstation.bench import BenchConfig
from calstation.bench.chamber import ChamberMachine
from calstation.bench.truth import GRID, SensorStream, Simulator, UnitThermal
from calstation.config import RunConfiguration, RunRequest, load_configuration
from calstation.errors import CalstationError
from calstation.estimation.common import SampleBlock
from calstation.judgement import judge
from calstation.messages import Text
from calstation.physics import INDEX, Dwell, FloatArray, Move
from calstation.results import StageChain, one_blas_thread
from calstation.simulation import bench_config
from tests.outside.sweep import described

#: Largest time of a soak, s, and distance of the air from its target with which a soak begins, K.
LONGEST, ARRIVED = 5400.0, 1.0
#: Sample rate, Hz, below that of the profile, because it determines the time of simulating. At 50 Hz, samples do not
#: resolve the moves: lever arms are wrong by up to 9 sigma, and navigation units fail with a cubic term of a gyro.
RATE = 100.0
#: Largest error over sigma with which a run may pass.
MOST_SIGMAS = 5.0

#: Orders with which the polynomials describe the units of the bench.
ORDERS = {
    "gyro_bias": 4,
    "gyro_scale": 3,
    "gyro_misalign": 2,
    "accel_bias": 4,
    "accel_scale": 3,
    "accel_misalign": 2,
    "accel_quadratic": 1,
}


@dataclass(frozen=True)
class ThermalRow:
    """One kind of unit; `causes` are those that name it, none for a sound unit."""

    title: str
    product: str
    causes: tuple[str, ...] = ()
    thermal: dict[str, Any] = field(default_factory=dict)  #: Entries of [bench.thermal].
    section: dict[str, Any] = field(default_factory=lambda: {"order": ORDERS})  #: Entries of [temperature].
    settings: dict[str, Any] = field(default_factory=dict)  #: Entries of [bench].
    #: Called with the number of each temperature, from 0, before its soak.
    before: Callable[[int, UnitThermal], None] = lambda number, thermal: None
    has_chamber: bool = True  #: Whether the temperature of the air is recorded.


@dataclass(frozen=True)
class ThermalOutcome:
    """Verdict of a unit; `worst` is the largest error over sigma at any temperature of the range."""

    row: ThermalRow
    seed: int
    worst: float
    parameter: str
    failed: tuple[str, ...]  #: Names of the failed checks, or the code of the error that ended the calibration.
    cause: str  #: First cause of a failed check.
    causes: tuple[str, ...]
    seconds: float  #: Processor time.

    @property
    def is_right(self) -> bool:
        """Whether the unit fails with its cause first, or passes with small errors."""
        if self.failed:
            return any(cause in (self.cause or self.failed[0]) for cause in self.row.causes)
        return self.worst < MOST_SIGMAS


class ThermalSimulator(Simulator):
    """Simulates soaks and moves of a unit in the chamber of the bench."""

    def __init__(self, config: BenchConfig, seed: int) -> None:
        truth, thermal = config.truth(), config.unit_thermal()
        assert thermal is not None
        assert config.chamber is not None
        super().__init__(truth, seed)
        self.thermal, self.base = thermal, truth.parameters
        self.chamber, self._chamber_time = ChamberMachine(config.chamber), 0.0
        self.chamber.start()
        self._sensed: list[tuple[int, float, float]] = []
        self._stream = SensorStream(truth.imu, truth.table, seed, thermal=thermal, air=self._measured_air)

    def _measured_air(self) -> float:
        """Advance the chamber; return the temperature of the air."""
        self._chamber_time += GRID
        self.chamber.advance(self._chamber_time)
        self._sensed.append((self._stream.produced, self.thermal.sensor_output(self.time), self.chamber.temperature))
        return self.chamber.truth.air

    def soak(self, target: float, rate: float, hold: float) -> None:
        """Go to a temperature until that of the unit changes by less than `rate`, K/min, without samples."""
        self.chamber.set_point = target
        for _ in range(round(LONGEST / hold)):
            before, has_arrived = self.thermal.temperatures[0], abs(self.chamber.temperature - target) <= ARRIVED
            for _ in range(round(hold / GRID)):
                self.thermal.step(self._measured_air(), np.array([0.0, 0.0, 1.0]))
            if has_arrived and abs(self.thermal.temperatures[0] - before) < rate * hold / 60.0:
                return

    def temperatures(self, seq: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the temperatures of sensor and air at samples, °C, shape (n,) each."""
        at, sensed, air = np.array(self._sensed).T
        index = np.searchsorted(at, seq, side="right") - 1
        return np.round(sensed[index], 2), np.round(air[index], 2)


def simulate(row: ThermalRow, resolved: RunConfiguration, seed: int) -> tuple[SampleBlock, ThermalSimulator]:
    """Return the samples of the stage and the simulator after it."""
    settings = bench_config(resolved)
    assert settings is not None
    changed = {"sample_rate_hz": RATE, "thermal": row.thermal, **row.settings}
    entries = {**settings, "seed": seed, "flash_file": None, **changed}
    simulator = ThermalSimulator(BenchConfig.model_validate(entries), seed)
    schedule: Any = resolved.schedules["temperature"]
    soak = schedule.soak
    steps: list[Move | Dwell] = [step for pair in schedule.cycle for step in pair]
    parts = []
    for number, air in enumerate(schedule.points_c):
        row.before(number, simulator.thermal)
        simulator.soak(air, soak.unit_rate_below_c_per_min, soak.hold_s)
        parts.append(simulator.run([steps[0], Dwell(soak.hold_s + 2.0), *steps], "temperature"))
    seq, time_s, counts, angles, step = (
        np.concatenate([getattr(p, name) for p in parts]) for name in ("seq", "time", "counts", "angles", "step")
    )
    sensed, air = simulator.temperatures(seq)
    block = SampleBlock("temperature", seq, time_s, counts, angles, step, np.ones(len(seq), np.bool_), sensed)
    return (replace(block, chamber=air[:, None]) if row.has_chamber else block), simulator


def run(row: ThermalRow, seed: int) -> ThermalOutcome:
    """Simulate, solve and judge the stage as a run does."""
    begin = time.process_time()
    files = (Path("data/stations/virtual_chamber.toml"), Path("data/products") / f"{row.product}.toml")
    resolved = load_configuration(RunRequest("SN-000001", *files))
    meta = resolved.log_meta()
    section = meta.temperature.model_copy(update=row.section)
    imu = meta.imu.model_copy(update={"sample_rate_hz": RATE})
    meta = meta.model_copy(update={"temperature": section, "imu": imu, "run": None})
    block, simulator = simulate(row, resolved, seed)
    chain, failed, causes, worst, parameter = StageChain(meta), (), (), float("nan"), ""
    try:
        with one_blas_thread():
            chain.start("temperature")
            chain.feed(block)
            chain.finish()
        checks = judge(meta, chain.prior, tuple(chain.solutions)).checks
        failed = tuple(check.name for check in checks if not check.passed)
        causes = tuple(f"{c.name}: {described(c.diagnosis)}" for c in checks if c.diagnosis is not None)
        worst, parameter = worst_error(chain, simulator)
    except CalstationError as exc:
        what = exc.values.get("what")
        failed = (what.code if isinstance(what, Text) else exc.code,)
    seconds = time.process_time() - begin
    return ThermalOutcome(row, seed, worst, parameter, failed, causes[0] if causes else "", causes, seconds)


def worst_error(chain: StageChain, simulator: ThermalSimulator) -> tuple[float, str]:
    """Return the largest error over sigma at 12 temperatures of the range, and its parameter and temperature."""
    solution = chain.solutions[0]
    fit = solution.temperature
    assert fit is not None
    errors: dict[str, float] = {}
    for t in np.linspace(*fit.model.range, 12).tolist():
        found, truth = fit.at(t), simulator.thermal.steady(simulator.base, t)
        for name in solution.estimated:
            i = INDEX[name]
            if found.sigma[i] > 0.0:
                errors[f"{name} at {t:.0f} °C"] = float(abs(found.mean[i] - truth[i]) / found.sigma[i])
    worst = max(errors, key=lambda name: errors[name])
    return errors[worst], worst


def _offset_from(first: int, offset: float) -> Callable[[int, UnitThermal], None]:
    """Return a sensor that measures too much from a temperature on."""

    def before(number: int, thermal: UnitThermal) -> None:
        thermal.offset = offset * (number >= first)

    return before


def _stuck_from(first: int) -> Callable[[int, UnitThermal], None]:
    """Return a sensor that is stuck from a temperature on."""

    def before(number: int, thermal: UnitThermal) -> None:
        if number == first:
            thermal.stuck = thermal.sensor_output(0.0)

    return before


#: Causes that name a gradient, a hysteresis, and a wrong temperature sensor.
GRADIENT, HYSTERESIS = ("g_sensitivity", "gyro_g_square"), ("temperature_hysteresis",)
SENSOR, ORDER = ("temperature_sensor",), ("temperature_order gyro_bias",)


def rows() -> Iterator[ThermalRow]:
    """Yield all kinds of units, in the order of the table."""
    too_low = {"order": {**ORDERS, "gyro_bias": 1}}
    product = "mems_c_thermal"
    yield ThermalRow("sound unit, hysteresis of 0.5 %", product)
    for gradient in (1.0, 3.0, 10.0):
        title = f"gradient of {gradient:g} K that changes with the attitude"
        yield ThermalRow(title, product, GRADIENT, {"gradient_c": gradient})
    for percent in (2.0, 10.0):
        title = f"hysteresis of {percent:g} %"
        yield ThermalRow(title, product, HYSTERESIS, {"hysteresis": 2.0 * percent})
    yield ThermalRow("polynomial of the gyro bias of order 1", product, ORDER, section=too_low)
    for offset in (1.0, 5.0):
        title = f"temperature sensor wrong by {offset:g} K from the fourth temperature on"
        yield ThermalRow(title, product, SENSOR, before=_offset_from(3, offset))
    yield ThermalRow("temperature sensor stuck from the fourth temperature on", product, SENSOR, before=_stuck_from(3))
    yield ThermalRow("temperature sensor stuck at the last temperature", product, SENSOR, before=_stuck_from(7))


def line(row: ThermalRow, found: list[ThermalOutcome]) -> str:
    """Return the row of the table."""
    passed = [o for o in found if not o.failed]
    right = [o for o in found if o.failed and o.is_right]
    other = Counter(o.cause.split(": ")[-1] or o.failed[0] for o in found if o.failed and not o.is_right)
    worst = f" ({max(o.worst for o in passed):.1f} σ)" if passed else ""
    named = Counter((o.cause or o.failed[0]).split(": ")[-1] for o in right)
    causes = f"{len(right)}: {named.most_common(1)[0][0]}" if right else ""
    others = ", ".join(f"{count} × {cause}" for cause, count in other.most_common())
    return f"| {row.title} | {row.product} | {len(found)} | {len(passed)}{worst} | {causes} | {others} |"


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--seeds", type=int, default=3, help="number of units")
    parser.add_argument("--only", default="", help="part of a title")
    args = parser.parse_args()
    for row in rows():
        if args.only in row.title:
            found = []
            for seed in range(1, args.seeds + 1):
                o = run(row, seed)
                found.append(o)
                words = f"{seed}: {o.worst:.1f} sigma {o.parameter}, {o.failed} {o.causes}, {o.seconds:.1f} s"
                print(words, file=sys.stderr, flush=True)
            print(line(row, found), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
