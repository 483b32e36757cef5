"""Uncertainty budget of a result: the contribution of each source to the variance of every quantity.

Because the variance P of an optimal estimate is stationary with respect to the gain, a small change of the variance q
of a source changes P only directly, and the contribution of the source is q dP/dq. P is a homogeneous function of
degree one of all variances, so that the contributions add up to P (Euler's theorem). The derivatives are differences
between solutions of the same log by the same solvers. The remainder of the variance is noise that the solvers
estimated from the data.
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

#: Callback that receives the completed fraction and the name of the stage.
BudgetProgress = Callable[[float, str], None]

#: Number of blocks into which the samples of a monitored chain are divided.
_BLOCK_COUNT = 160
#: Relative change of the variance of a source from which the derivative is computed.
_STEP = 1e-3
#: Latitude error for which the effect is stated, °.
LATITUDE_ERROR_DEG = 0.01

#: Entries of the IMU section whose squares are the variances of a source.
_IMU_ENTRIES = {
    "sensor_noise": ("gyro_arw", "accel_vrw"),
    "quantisation": ("gyro_quantisation", "accel_quantisation"),
    "bias_instability": ("gyro_bias_instability", "accel_bias_instability"),
}
#: Entries of the table section whose squares are the variances of a source.
_TABLE_ENTRIES = {
    "angles": ("encoder_sigma_deg", "mount_sigma_deg", "azimuth_sigma_deg", "base_tilt_sigma_deg"),
    "motion": ("velocity_sigma",),
}
#: Sources in the order of a budget; ``other`` is the noise in the data that exceeds the noise of the profiles.
SOURCES = (*_IMU_ENTRIES, *_TABLE_ENTRIES, "gravity", "prior", "other")


@dataclass(frozen=True)
class Budget:
    """Contributions of the sources to the variances of the quantities."""

    #: Contribution of each source by quantity, SI squared; the sum is the variance of the quantity.
    variance: Mapping[str, Mapping[str, float]]
    #: Change of each quantity due to a latitude error of `LATITUDE_ERROR_DEG`, SI; not included in the variance.
    latitude: Mapping[str, float]


def uncertainty_budget(log: Log, result: Result, meta: LogMeta, base: StageChain, progress: BudgetProgress) -> Budget:
    """Return the uncertainty budget of a result. Raises InputError.

    The log is solved once more for every source except ``gravity`` and ``other``, and for a different latitude.

    Parameters
    ----------
    log, result : log and its result
    meta : configuration with which the log was solved
    base : chain that has solved the log
    progress : called with the completed fraction and the stage
    """
    changes = [source for source in SOURCES if source not in ("gravity", "other")]
    before = _variances(base)
    names = list(before)
    total = np.array(list(before.values()))
    parts: dict[str, FloatArray] = {}
    for number, source in enumerate(changes):
        chain = solve_again(
            log, result, _change_source(meta, source), partial(_report_part, progress, number, len(changes) + 1)
        )
        after = _variances(chain)
        parts[source] = (np.array([after[name] for name in names]) - total) / _STEP
    # gravity is independent of the other sources, so that its contribution is the variance that it adds
    gravity = base.solutions[-1].posterior.covariance - base.posterior.covariance
    parts["gravity"] = np.array([gravity[INDEX[n], INDEX[n]] if n in INDEX else 0.0 for n in names])
    parts["other"] = total - np.sum([parts[source] for source in changes], axis=0)
    rows = {name: {source: float(parts[source][k]) for source in SOURCES} for k, name in enumerate(names)}
    latitude = meta.site.latitude_deg - float(np.copysign(LATITUDE_ERROR_DEG, meta.site.latitude_deg))
    shifted_meta = meta.model_copy(update={"site": meta.site.model_copy(update={"latitude_deg": latitude})})
    chain = solve_again(log, result, shifted_meta, partial(_report_part, progress, len(changes), len(changes) + 1))
    values, shifted = (solved_parameters(tuple(each.solutions)) for each in (base, chain))
    return Budget(
        rows,
        {name: abs(shifted[name].value - parameter.value) for name, parameter in values.items() if name in shifted},
    )


def solve_again(
    log: Log,
    result: Result,
    meta: LogMeta,
    progress: Callable[[float, str], None],
    chain: StageChain | None = None,
    on_block: Callable[[SampleBlock], None] | None = None,
) -> StageChain:
    """Solve the stages of a result again with the configuration `meta`.

    Parameters
    ----------
    log, result : log, and the result whose stages are solved
    meta : configuration
    progress : called with the completed fraction and the stage
    chain : new chain that the caller monitors; without it, data and model are not tested
    on_block : called after every block; the samples are then divided into `_BLOCK_COUNT` blocks
    """
    first, last = result.log.first_seq, result.log.last_seq

    def on_progress(stage: str, seq: int, done: float) -> None:
        progress(min(max((seq - first) / max(last - first, 1), 0.0), 1.0), stage)

    def blocks() -> Iterator[SampleBlock]:
        if on_block is None:
            yield from log.blocks(first, last)
            return
        size = -(-(last - first + 1) // _BLOCK_COUNT)
        for block in log.blocks(first, last):
            on_block(block)
            for begin in range(0, len(block), size):
                yield block.part(begin, min(begin + size, len(block)))

    chain = chain or StageChain(meta, diagnostics=False)
    return solve(blocks, meta, tuple(result.stages), source=log.path, progress=on_progress, chain=chain)


def _report_part(progress: BudgetProgress, number: int, count: int, done: float, stage: str) -> None:
    progress((number + done) / count, stage)


def _variances(chain: StageChain) -> dict[str, float]:
    """Return the variances of the solved quantities without the gravity error, SI squared."""
    solutions = tuple(chain.solutions)
    variances = {
        name: float(chain.posterior.covariance[INDEX[name], INDEX[name]]) for name in estimated_stage(solutions)
    }
    return variances | {name: estimate.sigma**2 for s in solutions for name, estimate in s.estimates.items()}


def _change_source(meta: LogMeta, source: str) -> LogMeta:
    """Return the configuration with the variances of a source increased by the factor 1 + `_STEP`."""
    factor = float(np.sqrt(1.0 + _STEP))
    if source == "prior":
        sigma = factor * prior_from_meta(meta).sigma
        values = {name: section.value for name, section in meta.prior.items()}
        prior = {
            p.name: PriorSection(value=values.get(p.name), sigma=float(sigma[i])) for i, p in enumerate(PARAMETERS)
        }
        return meta.model_copy(update={"prior": prior})
    if source in _TABLE_ENTRIES:
        scaled = {name: factor * getattr(meta.table, name) for name in _TABLE_ENTRIES[source]}
        return meta.model_copy(update={"table": meta.table.model_copy(update=scaled)})
    imus = {"imu": meta.imu, **{f"imu{number}": imu for number, imu in meta.secondaries.items()}}
    return meta.model_copy(update={key: _scale_imu(imu, _IMU_ENTRIES[source], factor) for key, imu in imus.items()})


def _scale_imu(imu: ImuSection, names: tuple[str, ...], factor: float) -> ImuSection:
    counts = {"gyro_quantisation": imu.gyro_lsb, "accel_quantisation": imu.accel_lsb}
    values = {name: getattr(imu, name) for name in names}
    return imu.model_copy(
        update={name: factor * (counts[name] if value is None else value) for name, value in values.items()}
    )
