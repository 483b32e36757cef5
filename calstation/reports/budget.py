"""Uncertainty budget of a result: the share of each source in the variance of every quantity.

The gain of an optimal estimator is stationary, so that a small change of a source's variance q changes the variance P
of the estimate only directly: the contribution of the source is q dP/dq. P is homogeneous of degree one in all
variances together, so that the contributions add up to P (Euler's theorem). The derivatives are differences between
solutions of the same log by the same solvers. The remainder of the variance is noise that the solvers estimated from
the data.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from calstation.estimation.common import SampleBlock
from calstation.judgement import estimated_stage
from calstation.physics import INDEX, PARAMETERS, FloatArray
from calstation.records import ImuSection, Log, LogMeta, PriorSection, prior_from_meta
from calstation.results import Result, StageChain, solve, solved_parameters

#: Callback that gets the finished fraction and the stage.
BudgetProgress = Callable[[float, str], None]

#: Number of pieces in which a monitored chain is fed.
_PIECES = 160
#: Relative change of a source's variance for its derivative.
_STEP = 1e-3
#: Error of the latitude for which the effect is stated, °.
LATITUDE_ERROR_DEG = 0.01

#: Entries of an IMU whose squares are variances of a source.
_OF_IMU = {
    "sensor_noise": ("gyro_arw", "accel_vrw"),
    "quantisation": ("gyro_quantisation", "accel_quantisation"),
    "bias_instability": ("gyro_bias_instability", "accel_bias_instability"),
}
#: Entries of the table whose squares are variances of a source.
_OF_TABLE = {
    "angles": ("encoder_sigma_deg", "mount_sigma_deg", "azimuth_sigma_deg", "base_tilt_sigma_deg"),
    "motion": ("velocity_sigma",),
}
#: Sources in the order of a budget. ``other`` is noise in the data in excess of the profiles.
SOURCES = (*_OF_IMU, *_OF_TABLE, "gravity", "prior", "other")


@dataclass(frozen=True)
class Budget:
    """Contributions to the variance of the quantities."""

    #: Variance from each source by quantity, SI squared; the sum is the variance of the quantity.
    variance: Mapping[str, Mapping[str, float]]
    #: Change of each quantity due to an error `LATITUDE_ERROR_DEG` of the latitude, SI; not included in its variance.
    latitude: Mapping[str, float]


def uncertainty_budget(log: Log, result: Result, meta: LogMeta, base: StageChain, progress: BudgetProgress) -> Budget:
    """Return the budget of a result; the chain `base` solved its log with the configuration `meta`. Raises InputError.

    The log is solved once more for every source and for a different latitude.
    """
    changes = [source for source in SOURCES if source not in ("gravity", "other")]
    before = _variances(base)
    names = list(before)
    total = np.array(list(before.values()))
    parts: dict[str, FloatArray] = {}
    for number, source in enumerate(changes):
        chain = solve_again(log, result, _changed(meta, source), partial(_part, progress, number, len(changes) + 1))
        after = _variances(chain)
        parts[source] = (np.array([after[name] for name in names]) - total) / _STEP
    # The change of the estimate with gravity contributes its square, whatever the other sources are.
    gravity = base.solutions[-1].posterior.covariance - base.posterior.covariance
    parts["gravity"] = np.array([gravity[INDEX[n], INDEX[n]] if n in INDEX else 0.0 for n in names])
    parts["other"] = total - np.sum([parts[source] for source in changes], axis=0)
    rows = {name: {source: float(parts[source][k]) for source in SOURCES} for k, name in enumerate(names)}
    latitude = meta.site.latitude_deg - float(np.copysign(LATITUDE_ERROR_DEG, meta.site.latitude_deg))
    elsewhere = meta.model_copy(update={"site": meta.site.model_copy(update={"latitude_deg": latitude})})
    chain = solve_again(log, result, elsewhere, partial(_part, progress, len(changes), len(changes) + 1))
    here, there = (solved_parameters(tuple(each.solutions)) for each in (base, chain))
    return Budget(rows, {name: abs(there[name].value - found.value) for name, found in here.items() if name in there})


def solve_again(
    log: Log,
    result: Result,
    meta: LogMeta,
    progress: Callable[[float, str], None],
    chain: StageChain | None = None,
    on_block: Callable[[SampleBlock], None] | None = None,
) -> StageChain:
    """Solve the stages of a result again with the configuration `meta`; `progress` gets a fraction and the stage.

    `chain` is a new chain that the caller monitors while it is fed; without it, data and model are not tested. With
    `on_block`, which is called for every block, the chain is fed in `_PIECES` pieces.
    """
    first, last = result.log.first_seq, result.log.last_seq

    def watch(stage: str, seq: int, done: float) -> None:
        progress(min(max((seq - first) / max(last - first, 1), 0.0), 1.0), stage)

    def blocks() -> Iterator[SampleBlock]:
        if on_block is None:
            yield from log.blocks(first, last)
            return
        size = -(-(last - first + 1) // _PIECES)
        for block in log.blocks(first, last):
            on_block(block)
            for begin in range(0, len(block), size):
                yield block.part(begin, min(begin + size, len(block)))

    chain = chain or StageChain(meta, diagnostics=False)
    return solve(blocks, meta, tuple(result.stages), source=log.path, progress=watch, chain=chain)


def _part(progress: BudgetProgress, number: int, count: int, done: float, stage: str) -> None:
    progress((number + done) / count, stage)


def _variances(chain: StageChain) -> dict[str, float]:
    """Return the variances of the solved quantities without the error of gravity, SI squared."""
    solutions = tuple(chain.solutions)
    variances = {
        name: float(chain.posterior.covariance[INDEX[name], INDEX[name]]) for name in estimated_stage(solutions)
    }
    return variances | {name: found.sigma**2 for s in solutions for name, found in s.estimates.items()}


def _changed(meta: LogMeta, source: str) -> LogMeta:
    """Return the configuration with the variances of a source increased by `_STEP`."""
    factor = float(np.sqrt(1.0 + _STEP))
    if source == "prior":
        sigma = factor * prior_from_meta(meta).sigma
        values = {name: section.value for name, section in meta.prior.items()}
        prior = {
            p.name: PriorSection(value=values.get(p.name), sigma=float(sigma[i])) for i, p in enumerate(PARAMETERS)
        }
        return meta.model_copy(update={"prior": prior})
    if source in _OF_TABLE:
        grown = {name: factor * getattr(meta.table, name) for name in _OF_TABLE[source]}
        return meta.model_copy(update={"table": meta.table.model_copy(update=grown)})
    imus = {"imu": meta.imu, **{f"imu{number}": imu for number, imu in meta.secondaries.items()}}
    return meta.model_copy(update={key: _grown(imu, _OF_IMU[source], factor) for key, imu in imus.items()})


def _grown(imu: ImuSection, names: tuple[str, ...], factor: float) -> ImuSection:
    counts = {"gyro_quantisation": imu.gyro_lsb, "accel_quantisation": imu.accel_lsb}
    before = {name: getattr(imu, name) for name in names}
    return imu.model_copy(
        update={name: factor * (counts[name] if value is None else value) for name, value in before.items()}
    )
