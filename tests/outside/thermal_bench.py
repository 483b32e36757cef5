"""The second simulator with a unit whose parameters depend on its temperature, which lags behind its surroundings."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calstation.bench import BenchConfig
from calstation.config import RunRequest, load_configuration
from calstation.estimation.common import SampleBlock
from calstation.physics import Dwell, Move
from calstation.records import LogMeta, TemperatureSection
from calstation.results import StageChain, one_blas_thread
from calstation.simulation import bench_config
from procedures import method
from tests.outside.plain_bench import AXES, PAIRS, Array, PlainBench, Samples
from tests.outside.sweep import Case, bench_settings, plain_bench_of

#: Additions to a parameter at temperatures, °C, of shape (n,), by name.
Course = Callable[[Array], Array]
#: Time constant of the unit, s, and rest in which its temperature changes, s.
LAG, SOAK = 25.0, 120.0


class ThermalBench:
    """Runs the moves of a schedule at several temperatures."""

    def __init__(self, bench: PlainBench, courses: Mapping[str, Course], rate_courses: Mapping[str, float]) -> None:
        self.bench, self.courses, self.rate_courses = bench, courses, rate_courses
        self.changes: list[tuple[float, float]] = []  #: Times, s, and temperatures of the surroundings, °C.
        bench.sensed = self.sensed  # type: ignore[method-assign]
        self.times = np.zeros(1)

    def temperature(self, times: Array) -> tuple[Array, Array]:
        """Temperature of the unit, °C, and its rate of change, K/s."""
        value, rate = np.full(len(times), self.changes[0][1]), np.zeros(len(times))
        for (_, before), (start, after) in zip(self.changes, self.changes[1:], strict=False):
            passed = np.maximum(times - start, 0.0)
            value += (after - before) * (1.0 - np.exp(-passed / LAG))
            rate += np.where(times > start, (after - before) / LAG * np.exp(-passed / LAG), 0.0)
        return value, rate

    def value(self, name: str, base: float) -> Array:
        """A parameter at the times of the output, shape (n,)."""
        temperature, rate = self.temperature(self.times)
        course = self.courses.get(name)
        added = course(temperature) if course is not None else 0.0
        return base + added + self.rate_courses.get(name, 0.0) * rate

    def vector(self, group: str) -> Array:
        """The three values of a group, shape (n, 3), or (3,) for a lever arm."""
        base = self.bench.unit.parameters
        rows = [self.value(f"{group}_{a}", base.get(f"{group}_{a}", 0.0)) for a in AXES]
        return np.array([row[0] for row in rows]) if group.endswith("lever") else np.stack(rows, axis=1)

    def matrix(self, sensor: str) -> Array:
        """Scale factors and misalignments, shape (n, 3, 3)."""
        base = self.bench.unit.parameters
        found = np.eye(3) + self.vector(f"{sensor}_scale")[:, :, None] * np.eye(3)
        for i, j in PAIRS:
            name = f"{sensor}_misalign_{AXES[i]}{AXES[j]}"
            if name in base:
                found[:, i, j] += self.value(name, base[name])
        return found

    def sensed(self, times: Array) -> tuple[Array, Array]:
        """Output of gyros and accelerometers, without noise."""
        self.times = times
        _, w, a, f = self.bench.motion(times)
        lever, inner = self.vector("outer_lever"), self.vector("inner_lever")
        f = f.copy()
        for i in range(3):
            at = lever + inner * np.eye(3)[i]
            f[:, i] += (np.cross(w, np.cross(w, at)) + np.cross(a, at))[:, i]
        gyro = np.einsum("nij,nj->ni", self.matrix("gyro"), w) + self.vector("gyro_bias")
        accel = np.einsum("nij,nj->ni", self.matrix("accel"), f) + self.vector("accel_bias")
        return gyro, accel + self.vector("accel_quadratic") * f**2

    def run(self, moves: Sequence[Any], temperatures: Sequence[float]) -> Samples:
        """Soak and run the moves at each temperature."""
        parts = []
        for temperature in temperatures:
            self.changes.append((self.bench.now, temperature))
            parts.append(self.bench.run([moves[0], Dwell(SOAK), *moves], "temperature"))
        samples = Samples(*(np.concatenate([getattr(p, n) for p in parts]) for n in vars(parts[0])))
        measured, _ = self.temperature(samples.time - 0.5 * self.bench.interval)
        noise = 0.02 * self.bench.random.standard_normal(len(measured))
        return replace(samples, temperature=np.round(measured + noise, 2))


@dataclass
class ThermalCase:
    """A unit, the temperatures, and how its parameters depend on them."""

    product: str
    temperatures: tuple[float, ...]
    courses: Mapping[str, Course]
    section: TemperatureSection
    seed: int = 1
    rate_courses: Mapping[str, float] | None = None

    def meta(self) -> LogMeta:
        """Return the configuration of the log."""
        resolved = load_configuration(RunRequest("SN-000001", product=Path("data/products") / f"{self.product}.toml"))
        return resolved.log_meta().model_copy(update={"temperature": self.section, "run": None})

    def solve(self) -> tuple[StageChain, ThermalBench]:
        """Simulate and solve the stage."""
        resolved = load_configuration(RunRequest("SN-000001", product=Path("data/products") / f"{self.product}.toml"))
        settings = bench_config(resolved)
        assert settings is not None
        grade = self.product.split("_")[0]
        case = Case(grade=grade, product=self.product, seed=self.seed, simulator="plain")
        bench = plain_bench_of(BenchConfig.model_validate(bench_settings(case, settings)))
        thermal = ThermalBench(bench, self.courses, self.rate_courses or {})
        schedule = resolved.schedules["designed"]
        steps = [s for s in method("designed").plan(resolved.table.geometry(), schedule) if isinstance(s, Move | Dwell)]
        samples = thermal.run(steps, self.temperatures)
        n = len(samples.seq)
        block = SampleBlock(
            "temperature",
            samples.seq,
            samples.time,
            samples.counts,
            samples.angles,
            samples.step,
            np.ones(n, np.bool_),
            samples.temperature,
        )
        chain = StageChain(self.meta())
        with one_blas_thread():
            chain.start("temperature")
            chain.feed(block)
            chain.finish()
        return chain, thermal
