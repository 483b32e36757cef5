"""Simulated stages in the form that solvers process, with the context of a station."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from calstation.bench import BenchConfig
from calstation.bench.truth import GRADES, BenchTruth, Simulated, Simulator
from calstation.estimation.common import Posterior, SampleBlock, Site, SolveContext, TableModel
from calstation.physics import COUNT, EFFECTS, PARAMETERS, Motion, TableGeometry, compensate, compensation
from calstation.records import LogMeta, RawLogWriter
from procedures import method
from tests.imu_models import imu_model

QUICK = {"rate_dps": 30.0, "acceleration_dps2": 40.0}
SCHEDULES = {
    "rate": {"turns": 1, "dwell_s": 5.0, **QUICK},
    "six_position": {"dwell_s": 10.0, **QUICK},
    "excitation": {"rounds": 1, "dwell_s": 8.0, "place_dwell_s": 3.0, **QUICK},
    "azimuth_flip": {"rounds": 1, "dwell_s": 30.0, **QUICK},
}


def context_of(truth: BenchTruth) -> SolveContext:
    """Return the context of a station: nominal axes, known azimuth, noise of the grade."""
    imu, table = truth.imu, truth.table
    return SolveContext(
        Site(table.latitude, 0.0, table.height, truth.azimuth, table.gravity),
        imu_model(imu),
        TableModel(table.outer_axis, table.inner_axis, truth.outer_lever),
    )


def prior_of(truth: BenchTruth, factor: float = 2.0) -> Posterior:
    """Return a prior with zero mean and `factor` times the sigmas of the grade; a fixed outer lever arm is known."""
    sigma = factor * np.array([GRADES[truth.grade].sigma[p.group] for p in PARAMETERS])
    if truth.outer_lever == "fixed":
        sigma[[p.group == "outer_lever" for p in PARAMETERS]] = 0.0
    return Posterior(np.zeros(COUNT), np.diag(sigma**2))


def geometry_of(truth: BenchTruth) -> TableGeometry:
    """Return the nominal geometry of the table."""
    return TableGeometry(truth.table.outer_axis, truth.table.inner_axis)


def block_of(samples: Simulated, keep: np.ndarray | None = None) -> SampleBlock:
    """Return the samples, or only the samples in `keep`, as one block."""
    keep = np.ones(len(samples.seq), dtype=bool) if keep is None else keep
    return SampleBlock(
        samples.stage,
        samples.seq[keep],
        samples.time[keep],
        samples.counts[keep],
        samples.angles[keep],
        samples.step[keep],
        np.ones(int(keep.sum()), dtype=bool),
        samples.temperature[keep],
    )


def simulate(simulator: Simulator, truth: BenchTruth, stage: str, **schedule: object) -> Simulated:
    """Simulate one stage with a short schedule."""
    chosen = method(stage)
    settings = chosen.schedule(**{**SCHEDULES[stage], **schedule})
    return simulator.run(chosen.plan(geometry_of(truth), settings), stage, getattr(settings, "rounds", None))


def cut(block: SampleBlock, places: list[int]) -> list[SampleBlock]:
    """Split the block before each index in `places`."""
    edges = [0, *sorted(places), len(block)]
    return [block.part(a, b) for a, b in pairwise(edges)]


def solver_of(truth: BenchTruth, prior: Posterior, stage: str, context: SolveContext | None = None):
    """Return a new solver of a stage."""
    chosen = method(stage)
    return chosen.solver(context or context_of(truth), prior, chosen.schedule(**SCHEDULES[stage]))


def solved(truth, prior, blocks, context=None):
    """Return the solution of the blocks of one stage."""
    solver = solver_of(truth, prior, blocks[0].stage, context)
    for block in blocks:
        solver.feed(block)
    return solver.finish()


def errors_in_sigma(posterior: Posterior, truth: BenchTruth) -> np.ndarray:
    """Return error over sigma of every parameter, 0 for exactly known parameters, shape (30,)."""
    known = posterior.sigma == 0.0
    assert np.all(posterior.mean[known] == truth.parameters[known])
    return (posterior.mean - truth.parameters) / np.where(known, 1.0, posterior.sigma)


def log_with(path: Path, stage: str, **effects: Any) -> BenchTruth:
    """Write the log of one stage of a navigation-grade unit with unmodelled effects; return the truth."""
    truth = BenchConfig(grade="nav", seed=7, sample_rate_hz=100.0, effects=effects).truth()
    table, imu = truth.table, truth.imu
    site = {"latitude_deg": float(np.rad2deg(table.latitude)), "longitude_deg": 108.9, "height_m": table.height}
    unit = {"serial": "SIM", "sample_rate_hz": 100.0, "output": "increment", "gyro_lsb": imu.gyro_lsb}
    unit |= {"accel_lsb": imu.accel_lsb, "gyro_arw": imu.gyro_arw, "accel_vrw": imu.accel_vrw}
    writer = RawLogWriter(path, LogMeta.model_validate({"site": {**site, "azimuth_deg": 0.0}, "imu": unit}))
    writer.append(block_of(simulate(Simulator(truth, 7), truth, stage)))
    writer.close("imported")
    return truth


def with_effect(
    block: SampleBlock, context: SolveContext, parameters: np.ndarray, cause: str, size: float, component: int = 0
) -> SampleBlock:
    """Add a component of an effect, computed from the samples themselves, to a simulated block."""
    raw = block.counts * context.imu.count_size
    smooth = np.ones(10) / 10.0
    rate, force = (
        np.stack([np.convolve(column, smooth, "same") for column in x.T], axis=1)
        for x in compensate(compensation(parameters), raw[:, :3], raw[:, 3:])
    )
    dt = 1.0 / context.imu.sample_rate
    motion = Motion(rate, force, np.gradient(rate, dt, axis=0), np.gradient(force, dt, axis=0), block.time)
    errors = next(c for c in EFFECTS if c.cause == cause).errors(motion)[:, :, component]
    return replace(block, counts=block.counts + size * errors / context.imu.count_size)
