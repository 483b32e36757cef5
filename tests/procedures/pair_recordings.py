"""Recordings of simulated IMUs on one body, with their context."""

from dataclasses import replace

import numpy as np
from hand_recordings import prior_of

from calstation.bench.truth import (
    ImuTruth,
    ManualRig,
    Mounting,
    SecondaryTruth,
    around,
    draw_imu,
    pair_truth,
    push,
    record_pair,
    rotation,
)
from calstation.estimation import Solution
from calstation.estimation.common import (
    Posterior,
    SampleBlock,
    Secondary,
    Site,
    SolveContext,
    StoredCrossCalibration,
    TableModel,
)
from calstation.physics import PAIR_PARAMETERS, group_indices
from procedures import method
from tests.imu_models import imu_model

RATE = 100.0
RIG = ManualRig(initial_rest=6.0, rest=2.0, speed=np.deg2rad(120.0))


def unit(grade: str, seed: int, **options: object) -> ImuTruth:
    """Return a unit without inner lever arms and second-order terms, because a pair has one lever arm."""
    imu = draw_imu(grade, np.random.default_rng(seed), sample_rate=RATE, **options)
    parameters = imu.parameters.copy()
    for group in ("inner_lever", "outer_lever", "accel_quadratic"):
        parameters[group_indices(group)] = 0.0
    return replace(imu, parameters=parameters)


def pair(seed: int, grade: str = "mems", **options: object) -> tuple[ImuTruth, SecondaryTruth]:
    """Return a primary, and a secondary with misalignment, displacement and a clock offset up to 30 ms."""
    random = np.random.default_rng([seed, 1])
    place = Mounting(rotation(random.standard_normal(3) * 0.03), random.uniform(-0.1, 0.1, 3))
    offset = float(random.uniform(-0.03, 0.03))
    return unit(grade, 2 * seed, **options), SecondaryTruth(unit(grade, 2 * seed + 1, **options), place, offset)


def recording(
    primary: ImuTruth,
    secondaries: list[SecondaryTruth],
    seed: int,
    rig: ManualRig = RIG,
    step: float = np.deg2rad(60.0),
) -> SampleBlock:
    """Return the recording of all units moved through the positions of the rig."""
    motion, duration = push(rig, around(step), np.random.default_rng([seed, 2]))
    counts, others = record_pair(primary, secondaries, motion, duration, rig.field, seed)
    seq = np.arange(len(counts))
    return SampleBlock(
        "cross_calibration",
        seq,
        (seq + 1) / RATE,
        counts,
        np.full((len(seq), 2), np.nan),
        seq * 0,
        np.ones(len(seq), np.bool_),
        np.full(len(seq), np.nan),
        others,
    )


def context_of(
    primary: ImuTruth, secondaries: list[SecondaryTruth], stored: dict[int, StoredCrossCalibration] | None = None
) -> SolveContext:
    """Return the context with site, profiles and stored calibrations of the secondaries."""
    further = tuple(
        Secondary(number, imu_model(s.imu, f"S{number}"), (stored or {}).get(number, StoredCrossCalibration()))
        for number, s in enumerate(secondaries, 2)
    )
    return SolveContext(Site(RIG.latitude, 0.0, RIG.height), imu_model(primary), TableModel(), further)


def primary_errors(primary: ImuTruth) -> Posterior:
    """Return the known errors of the primary, which was calibrated before."""
    prior = prior_of("mems")
    return Posterior(primary.parameters, 1e-6 * prior.covariance)


def truth_of(primary: ImuTruth, secondary: SecondaryTruth) -> np.ndarray:
    """Return the true pair parameters, shape (28,)."""
    t = pair_truth(primary, secondary)
    parts = [
        t["gyro_bias"],
        t["gyro_matrix"],
        t["accel_bias"],
        t["accel_matrix"],
        t["lever"],
        t["clock_offset"],
    ]
    return np.concatenate([np.ravel(p) for p in parts])


def solver_of(context: SolveContext, prior: Posterior, **schedule: object):
    chosen = method("cross_calibration")
    return chosen.solver(context, prior, chosen.schedule(**schedule))


def solved(block: SampleBlock, context: SolveContext, prior: Posterior, **schedule: object) -> Solution:
    """Solve the block as a cross_calibration stage."""
    solver = solver_of(context, prior, **schedule)
    solver.feed(block)
    return solver.finish()


def vector(solution: Solution, key: str = "value") -> np.ndarray:
    """Return values or sigmas of the second IMU, shape (28,), neutral or 0 for parameters not fitted."""
    return np.array(
        [
            getattr(solution.estimates[p.name], key) if p.name in solution.estimates else p.neutral * (key == "value")
            for p in PAIR_PARAMETERS
        ]
    )
