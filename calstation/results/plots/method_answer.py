"""Solves a recording by a method that needs no table and computes its plot data from the same samples and result."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calstation.errors import InputError
from calstation.estimation.common import StageData, stage_data
from calstation.physics import INDEX, NAMES, FloatArray
from calstation.records import (
    Log,
    LogMeta,
    context_from_meta,
    estimated_rows,
    open_log,
    prior_from_meta,
    read_truth,
)
from calstation.results import Parameter, Resolved, Result, resolve
from calstation.results.plots.gimbal import GimbalPlotData, gimbal_plot_data
from calstation.results.plots.pairs import PairPlotData, pair_plot_data, stored_values
from calstation.results.plots.positions import PositionPlotData, position_plot_data
from calstation.schema import validate
from procedures import method

#: Fractions of the work after reading and after solving.
_READ, _SOLVED = 0.3, 0.8


@dataclass(frozen=True)
class Recording:
    """A recording before it is solved."""

    path: Path
    serial: str
    rate: float
    duration: float  #: Seconds.
    truth: Mapping[str, float]  #: True parameters, SI, of a recording of the virtual bench.


@dataclass(frozen=True)
class MethodAnswer:
    """Solution of a recording."""

    recording: Recording
    stage: str
    resolved: Resolved
    #: Previous value and sigma of each parameter, SI; no sigma for a stored value.
    before: Mapping[str, tuple[float, float | None]]
    schedule: Mapping[str, Any]  #: Of the method, as in a product file.
    picture: PositionPlotData | GimbalPlotData | PairPlotData  #: Plot data of the method.

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """The parameters of the result."""
        return self.resolved.result.parameters


def solve_method(tell: Callable[..., None], path: Path, stage: str) -> MethodAnswer:
    """Job: solve a whole recording by the stage ``multi_position``, ``gimbal`` or ``cross_calibration``.

    Raises InputError or ConfigurationError.
    """
    tell(0.0, note="reading")
    log = open_log(path)
    total = estimated_rows(path)
    first: list[int] = []

    def watch(_: str, seq: int, solved: float) -> None:
        if not first:
            first.append(seq)
        read = min(1.0, (seq - first[0]) / total)
        tell(_READ * read + (_SOLVED - _READ) * solved, note="solving" if solved or read > 0.9 else "reading")

    resolved = resolve(path, (stage,), progress=watch)
    tell(_SOLVED, note="drawing")
    schedule = validate(method(stage).schedule, log.meta.schedule.get(stage, {}), f"schedule of {stage}", InputError)
    in_force = schedule.model_dump(mode="json")
    return MethodAnswer(
        _recording(log, resolved),
        stage,
        resolved,
        _before(log.meta, stage),
        in_force,
        _picture(log, stage, resolved.result, in_force),
    )


def found_vector(meta: LogMeta, parameters: Mapping[str, Parameter]) -> FloatArray:
    """All 30 parameters, SI, shape (30,): the solved ones, and the prior means of the others."""
    values = prior_from_meta(meta).mean.copy()
    for name, row in parameters.items():
        if name in INDEX:
            values[INDEX[name]] = row.value
    return values


def _picture(
    log: Log, stage: str, result: Result, schedule: Mapping[str, Any]
) -> PositionPlotData | GimbalPlotData | PairPlotData:
    details = result.details.get(stage, {})
    if stage == "gimbal":
        return gimbal_plot_data(details, schedule)
    context = context_from_meta(log.meta)
    data = data_of(log, stage)
    if stage == "cross_calibration":
        return pair_plot_data(data, context, prior_from_meta(log.meta), details)
    found = found_vector(log.meta, result.parameters)
    return position_plot_data(data, context, prior_from_meta(log.meta).mean, found, log.meta.product)


def data_of(log: Log, stage: str) -> StageData:
    """The samples that `resolve` uses for `stage`: those of the stage, or all if there are none."""
    blocks = list(log.blocks())
    named = [block for block in blocks if block.stage == stage]
    return stage_data(named or blocks, context_from_meta(log.meta).imu)


def _before(meta: LogMeta, stage: str) -> dict[str, tuple[float, float | None]]:
    if stage == "cross_calibration":
        return {name: (value, None) for name, value in stored_values(context_from_meta(meta)).items()}
    prior = prior_from_meta(meta)
    sigma = np.asarray(prior.sigma)
    return {name: (float(prior.mean[k]), float(sigma[k])) for k, name in enumerate(NAMES)}


def _recording(log: Log, resolved: Resolved) -> Recording:
    rate = log.meta.imu.sample_rate_hz
    solved = resolved.result.log
    duration = (solved.last_seq - solved.first_seq + 1) / rate
    return Recording(log.path, log.meta.imu.serial, rate, duration, read_truth(log.path))
