"""Monte Carlo study of the errors of many units and tables, normalised by their sigmas and by the Cramér-Rao bound.

The solvers use the distributions from which the bench draws; `docs/explanation/study.md` explains tests and bands.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from multiprocessing import get_context
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel

from calstation.bench import BenchConfig
from calstation.bench.truth import GRADES, BenchTruth, Effects, GradeName, Simulated, Simulator
from calstation.config import RunRequest, library, load_configuration
from calstation.estimation import StageSolver
from calstation.estimation.common import (
    ImuModel,
    Posterior,
    SampleBlock,
    Site,
    SolveContext,
    TableModel,
    consider_update,
    stage_data,
)
from calstation.estimation.effects import known_effects, plausible_changes
from calstation.estimation.navigation import solve_navigation
from calstation.jobs import deferred_signals, receive_stop_signals
from calstation.judgement import ModelTests
from calstation.physics import (
    AXIS_OFFSET_SIGMA,
    NAMES,
    PARAMETERS,
    EffectName,
    FloatArray,
    TableGeometry,
    group_indices,
    targets_reached,
)
from calstation.results import StageChain, one_blas_thread
from calstation.simulation.instability import normalised_error_covariance
from calstation.simulation.study_table import UnitResult, summary
from procedures import DEFAULT_STAGES, method

SEEDS: dict[GradeName, int] = {"nav": 100, "tactical": 30, "mems": 30}
SAMPLE_RATE = 100.0
MOUNT_DEG = (0.1, 0.3)
_LOW, _HIGH = np.deg2rad(MOUNT_DEG)
#: Sigma per axis, rad, of a mounting rotation about a random direction by an angle uniform in `MOUNT_DEG`.
MOUNT_SIGMA = float(np.sqrt((_LOW**2 + _LOW * _HIGH + _HIGH**2) / 3.0 / 3.0))
#: Tilt of the base and sigma of the table's azimuth, deg.
TILT_DEG = 0.1
NAVIGATION_STAGES = ("excitation", "azimuth_flip", "designed")
#: Product with a designed schedule, by grade.
FAST_PRODUCTS: dict[GradeName, str] = {"nav": "nav_a_fast", "tactical": "tactical_b_fast", "mems": "mems_c_fast"}

Lever = Literal["estimated", "fixed"]
#: Changes to the default schedules, by stage.
Schedules = dict[str, dict[str, Any]]


@dataclass(frozen=True)
class Case:
    """One case of the study: the solved stages, and whether the units have an outer lever arm and bias instability.

    The units of a case with optional `states` have the effects in `STUDY_EFFECTS`.
    """

    name: str
    stages: tuple[str, ...]
    outer_lever: Lever = "estimated"
    instability: bool = False
    states: tuple[EffectName, ...] = ()


_Job = tuple[GradeName, int, tuple[Case, ...], Schedules]

CASES = (
    Case("full", DEFAULT_STAGES),
    Case("full, no outer lever", DEFAULT_STAGES, outer_lever="fixed"),
    Case("rate", ("rate",)),
    Case("six_position", ("six_position",)),
    Case("scale factors", ("rate", "six_position")),
    Case("excitation", ("excitation",)),
    Case("azimuth_flip", ("azimuth_flip",)),
    Case("designed", ("designed",)),
    Case("excitation, bias instability", ("excitation",), instability=True),
    Case(
        "full, optional states",
        DEFAULT_STAGES,
        states=("g_sensitivity", "gyro_asymmetry", "accel_cubic", "accel_cross", "accel_off_axis", "time_skew"),
    ),
)


def _present(dph_g: float, ppm: float, ug_g3: float, ug_g2: float, mm: float, ms: float) -> Effects:
    """Return effects for all states; accelerometer displacements along an axis are opposite, so their mean is zero."""
    displacements = ((0.0, -mm, mm), (mm, 0.0, -mm), (-mm, mm, 0.0))
    return Effects(
        g_sensitivity_dph_g=dph_g,
        gyro_asymmetry_ppm=ppm,
        accel_cubic_ug_g3=ug_g3,
        accel_cross_ug_g2=ug_g2,
        accel_off_axis_mm=displacements,
        accel_delay_ms=ms,
    )


#: Effects of a grade's units in the cases with optional states: many sigmas of the parameters that they resemble.
STUDY_EFFECTS: dict[GradeName, Effects] = {
    "nav": _present(0.1, 30.0, 10.0, 30.0, 5.0, 0.5),
    "tactical": _present(3.0, 100.0, 100.0, 100.0, 10.0, 1.0),
    "mems": _present(30.0, 500.0, 500.0, 500.0, 20.0, 2.0),
}


def run_study(
    grade: GradeName | None = None,
    seeds: int | None = None,
    progress: Callable[[int, int], None] = lambda done, count: None,
    *,
    cases: tuple[Case, ...] = CASES,
    schedules: Schedules | None = None,
    workers: int = 2,
) -> dict[str, Any]:
    """Run the study; return JSON data.

    Parameters
    ----------
    grade : grade of the units; None for all grades
    seeds : number of units per grade; None for 100 of grade nav and 30 of each other grade
    progress : function that is called with the number of finished units and the number of all units
    cases : cases to study
    schedules : changes to the default schedules, by stage
    workers : number of processes; 1 runs the study in the calling process
    """
    grades: list[GradeName] = [grade] if grade else list(SEEDS)
    jobs = [(g, s, cases, fast_schedule(g) | (schedules or {})) for g in grades for s in range(seeds or SEEDS[g])]
    collected: dict[tuple[GradeName, str], list[UnitResult]] = {}
    for done, (name, results) in enumerate(_map(jobs, workers), 1):
        for result in results:
            collected.setdefault((name, result.case), []).append(result)
        progress(done, len(jobs))
    rows = []
    for g in grades:
        for case in cases:
            ratio = normalised_error_covariance(*_excitation_problem(g, schedules or {})) if case.instability else None
            rows.append({"grade": g, "case": case.name, **summary(collected[g, case.name], ratio)})
    return {"schema": "calstation.study/1", "rows": rows, "passed": all(r["passed"] for r in rows)}


def fast_schedule(grade: GradeName) -> Schedules:
    """Return the designed schedule of a grade's product."""
    product = library.find("products", FAST_PRODUCTS[grade])
    setup = load_configuration(RunRequest("study", None, product))
    return {"designed": setup.schedules["designed"].model_dump()}


def _map(jobs: list[_Job], workers: int) -> Iterator[tuple[GradeName, list[UnitResult]]]:
    """Yield results in order of completion; the worker processes end with the iteration."""
    if workers == 1:
        yield from map(_unit, jobs)
        return
    with ExitStack() as stack:
        with deferred_signals():
            pool = stack.enter_context(get_context("spawn").Pool(workers, receive_stop_signals))
        yield from pool.imap_unordered(_unit, jobs)


def _unit(job: _Job) -> tuple[GradeName, list[UnitResult]]:
    grade, seed, cases, schedules = job
    results = []
    with one_blas_thread():
        for lever, instability, states in dict.fromkeys((c.outer_lever, c.instability, c.states) for c in cases):
            selected = [c for c in cases if (c.outer_lever, c.instability, c.states) == (lever, instability, states)]
            present, along, across = STUDY_EFFECTS[grade] if states else Effects(), *_draw_offset(seed)
            offset = along, across if lever == "fixed" else 0.0
            truth, context = draw_unit(grade, seed, lever, instability, present, offset)
            stages = [s for s in (*DEFAULT_STAGES, "designed") if any(s in c.stages for c in selected)]
            data = simulate_stages(truth, seed, stages, schedules)
            results += [_solve(c, truth, context, data, schedules) for c in selected]
    return grade, results


def _draw_offset(seed: int) -> tuple[float, float]:
    """Draw the offset between the axes of a table as a profile bounds it by default, mm."""
    along, across = 1e3 * AXIS_OFFSET_SIGMA * np.random.default_rng([seed, 4]).standard_normal(2)
    return float(along), float(across)


def draw_unit(
    grade: GradeName,
    seed: int,
    outer_lever: Lever,
    instability: bool,
    effects: Effects | None = None,
    axis_offset: tuple[float, float] = (0.0, 0.0),
) -> tuple[BenchTruth, SolveContext]:
    """Draw a bench of the study; return it with the context of its solvers.

    Parameters
    ----------
    grade : grade of the unit
    seed : seed of the unit and table
    outer_lever : whether the unit has an outer lever arm
    instability : whether the unit has bias instability
    effects : effects outside the 30 parameters
    axis_offset : offset of the inner from the outer axis, mm
    """
    truth = BenchConfig(
        grade=grade,
        seed=seed,
        sample_rate_hz=SAMPLE_RATE,
        outer_lever=outer_lever,
        mount_deg=MOUNT_DEG,
        base_tilt_deg=TILT_DEG,
        azimuth_error_deg=TILT_DEG,
        instability=instability,
        effects=effects or Effects(),
        axis_offset_mm=axis_offset,
    ).truth()
    imu = truth.imu
    noise = (imu.gyro_arw, imu.accel_vrw, imu.gyro_bias_instability, imu.accel_bias_instability)
    context = SolveContext(
        Site(truth.table.latitude, 0.0, truth.table.height, truth.azimuth),
        ImuModel(f"{grade}-{seed}", SAMPLE_RATE, imu.output, imu.gyro_lsb, imu.accel_lsb, *noise),
        TableModel(
            outer_lever=outer_lever,
            encoder_sigma=truth.encoder.stop_sigma,
            mount_sigma=MOUNT_SIGMA,
            azimuth_sigma=np.deg2rad(TILT_DEG),
            base_tilt_sigma=np.deg2rad(TILT_DEG) / np.sqrt(2.0),
        ),
    )
    return truth, context


def study_prior(grade: GradeName, outer_lever: str) -> Posterior:
    """Return the distribution from which the units of a grade are drawn."""
    sigma = np.array([GRADES[grade].sigma[p.group] for p in PARAMETERS])
    if outer_lever == "fixed":
        sigma[group_indices("outer_lever")] = 0.0
    return Posterior(np.zeros(len(sigma)), np.diag(sigma**2))


def simulate_stages(truth: BenchTruth, seed: int, stages: list[str], schedules: Schedules) -> dict[str, SampleBlock]:
    """Simulate the stages in sequence; return one block per stage.

    Parameters
    ----------
    truth : simulated table and unit
    seed : seed of the noise
    stages : stages in order
    schedules : changes to the default schedules, by stage
    """
    simulator = Simulator(truth, seed + 10_000)
    blocks = {}
    for stage in stages:
        m = method(stage)
        schedule = m.schedule(**schedules.get(stage, {}))
        steps = m.plan(TableGeometry(), schedule)
        blocks[stage] = block_of(simulator.run(steps, stage, getattr(schedule, "rounds", None)))
    return blocks


def block_of(s: Simulated) -> SampleBlock:
    """Return the samples of a simulated stage as one block."""
    valid = np.ones(len(s.seq), dtype=np.bool_)
    return SampleBlock(s.stage, s.seq, s.time, s.counts, s.angles, s.step, valid, s.temperature)


def _solve(
    case: Case, truth: BenchTruth, context: SolveContext, data: dict[str, SampleBlock], schedules: Schedules
) -> UnitResult:
    """Solve the stages of a case as in a run, and compute the bound from the same stages linearised at the true values.

    Optional states and the offset of the table's axes increase the bound by the same amount as the covariance.
    """
    posterior = study_prior(truth.grade, case.outer_lever)
    bound = Posterior(truth.parameters, posterior.covariance)
    estimated = np.zeros(len(NAMES), dtype=np.bool_)
    nis, seconds = {}, 0.0
    context = replace(context, states=case.states)
    priors = known_effects(posterior.sigma, context)
    model, joint = ModelTests(plausible_changes(context.imu, {}), case.states, priors), posterior
    effects_covariance: FloatArray = np.zeros_like(posterior.covariance)
    for stage in case.stages:
        m = method(stage)
        schedule = m.schedule(**schedules.get(stage, {}))
        solver = m.solver(context, posterior, schedule)
        samples = feed_until_targets(solver, data[stage], schedule)
        seconds += len(samples.seq) / context.imu.sample_rate
        solution = solver.finish()
        posterior = solution.posterior
        solution = model.with_states(solution)
        joint = solution.posterior
        effects_covariance = joint.covariance - posterior.covariance
        mask = np.array([n in solution.estimated for n in NAMES])
        if stage in NAVIGATION_STAGES:
            samples_data = stage_data([samples], context.imu)
            at_truth = solve_navigation(samples_data, context, bound, np.zeros_like(mask)).posterior
            bound = consider_update(bound, at_truth, mask)
        else:
            bound_solver = m.solver(context, bound, schedule)
            bound_solver.feed(samples)
            bound = bound_solver.finish().posterior
        bound = Posterior(truth.parameters, bound.covariance)
        estimated |= mask
        c = solution.consistency
        nis[stage] = (c.nis_mean, c.nis_low, c.nis_high)
    error = joint.mean - truth.parameters
    cost = None
    if case.states:
        with np.errstate(invalid="ignore"):
            cost = joint.sigma / posterior.sigma
    bound_covariance = bound.covariance + effects_covariance
    return UnitResult(case.name, estimated, error, joint.covariance, bound_covariance, nis, cost, seconds)


def feed_until_targets(solver: StageSolver | StageChain, samples: SampleBlock, schedule: BaseModel) -> SampleBlock:
    """Feed the samples of a designed stage until its targets are reached, as in a run; return the fed samples."""
    targets, least = getattr(schedule, "targets", {}), getattr(schedule, "least_moves", None)
    if not targets or least is None:
        solver.feed(samples)
        return samples
    ends = np.append(np.flatnonzero(np.diff(samples.step)) + 1, len(samples.step))
    first = 0
    for move, end in enumerate(ends, start=1):
        solver.feed(samples.part(first, int(end)))
        first = int(end)
        if move >= least and targets_reached(solver.sigma(), targets):
            break
    return samples.part(0, first)


def _excitation_problem(grade: GradeName, schedules: Schedules) -> tuple[SampleBlock, SolveContext, Posterior]:
    truth, context = draw_unit(grade, 0, "estimated", instability=True)
    block = simulate_stages(truth, 0, ["excitation"], schedules)["excitation"]
    return block, context, Posterior(truth.parameters, study_prior(grade, "estimated").covariance)
