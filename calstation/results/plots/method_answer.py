"""Solves a recording by a method that needs no table and computes its plot data from the same samples and result."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calstation.errors import InputError
from calstation.estimation.common import stage_data
from calstation.jobs import ProgressCallback
from calstation.physics import INDEX, NAMES
from calstation.records import Log, LogMeta, context_from_meta, estimated_rows, open_log, prior_from_meta, read_truth
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


def solve_method(report: ProgressCallback, path: Path, stage: str) -> MethodAnswer:
    """Job: solve a whole recording by the stage ``multi_position``, ``gimbal`` or ``cross_calibration``.

    Raises InputError or ConfigurationError.
    """
    report(0.0, note="reading")
    log = open_log(path)
    total = estimated_rows(path)
    first: list[int] = []

    def watch(_: str, seq: int, solved: float) -> None:
        if not first:
            first.append(seq)
        read = min(1.0, (seq - first[0]) / total)
        report(_READ * read + (_SOLVED - _READ) * solved, note="solving" if solved or read > 0.9 else "reading")

    resolved = resolve(path, (stage,), progress=watch)
    report(_SOLVED, note="drawing")
    meta, samples = log.meta, resolved.result.log
    checked = validate(method(stage).schedule, meta.schedule.get(stage, {}), f"schedule of {stage}", InputError)
    schedule = checked.model_dump(mode="json")
    rate = meta.imu.sample_rate_hz
    duration = (samples.last_seq - samples.first_seq + 1) / rate
    recording = Recording(path, meta.imu.serial, rate, duration, read_truth(path))
    picture = _plot_data(log, stage, resolved.result, schedule)
    return MethodAnswer(recording, stage, resolved, _before(meta, stage), schedule, picture)


def _plot_data(
    log: Log, stage: str, result: Result, schedule: Mapping[str, Any]
) -> PositionPlotData | GimbalPlotData | PairPlotData:
    details = result.details.get(stage, {})
    if stage == "gimbal":
        return gimbal_plot_data(details, schedule)
    context, prior = context_from_meta(log.meta), prior_from_meta(log.meta)
    blocks = list(log.blocks())
    named = [block for block in blocks if block.stage == stage]
    data = stage_data(named or blocks, context.imu)  # the samples that `resolve` uses
    if stage == "cross_calibration":
        return pair_plot_data(data, context, prior, details)
    found = prior.mean.copy()
    for name, row in result.parameters.items():
        if name in INDEX:
            found[INDEX[name]] = row.value
    return position_plot_data(data, context, prior.mean, found, log.meta.product)


def _before(meta: LogMeta, stage: str) -> dict[str, tuple[float, float | None]]:
    if stage == "cross_calibration":
        return {name: (value, None) for name, value in stored_values(context_from_meta(meta)).items()}
    prior = prior_from_meta(meta)
    return {name: (float(prior.mean[k]), float(prior.sigma[k])) for k, name in enumerate(NAMES)}
