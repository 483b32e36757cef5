"""Solution of a recording by a method that needs no table, and the plot data of the solution."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from calstation.errors import InputError
from calstation.estimation.common import SolveContext, StageData, stage_data
from calstation.estimation.gimbal import contraction, largest_gain
from calstation.estimation.positions import gather, gravity_errors, turn_between
from calstation.jobs import ProgressCallback
from calstation.physics import AXES, INDEX, NAMES, PAIR_PARAMETERS, FloatArray, pair_name
from calstation.records import (
    Log,
    LogMeta,
    ProductSection,
    context_from_meta,
    estimated_rows,
    open_log,
    prior_from_meta,
    read_truth,
)
from calstation.results.plots.pairs import PairPlotData, pair_plot_data
from calstation.results.resolving import Resolved, resolve
from calstation.results.result import Result
from calstation.results.sections import Parameter
from calstation.schema import validate
from calstation.sequencer import GimbalTurned
from procedures import method

#: Progress fractions after reading and after solving.
_READ, _SOLVED = 0.3, 0.8


@dataclass(frozen=True)
class PositionPlotData:
    """Rests and motions of a recording, with the parameters before and after the calibration."""

    gravity: float  #: Local gravity, m/s².
    up: FloatArray  #: Unit vector opposite to gravity in the body frame at each rest, shape (n, 3).
    force_before: FloatArray  #: Magnitude of the force at each rest minus gravity, before, m/s², shape (n,).
    force_after: FloatArray  #: Magnitude of the force at each rest minus gravity, after, m/s², shape (n,).
    angle_before: FloatArray  #: Angle between measured and propagated up after each motion, before, rad, shape (m,).
    angle_after: FloatArray  #: Angle between measured and propagated up after each motion, after, rad, shape (m,).
    force_limit: float | None  #: Limit from the product's checks, m/s².
    angle_limit: float | None  #: Limit from the product's checks, rad.


@dataclass(frozen=True)
class GimbalAxis:
    """Turns about one axis."""

    axis: str
    angle: float  #: Mean size of the turns, rad.
    drift: FloatArray  #: Larger drift of the other two joints in each turn, rad, shape (turns,).
    predicted: FloatArray  #: Drift predicted from the first drift and the gain, rad, shape (turns,).
    gain: float  #: Gain used, rad/rad.
    largest_gain: float  #: Largest convergent gain, rad/rad.
    fastest_gain: float  #: Gain with the fastest convergence, rad/rad; 0 if there is none.
    contraction: float  #: Remaining fraction of the error after each turn at `gain`.
    converged: bool  #: Whether the last drift is below the threshold.

    @property
    def observed_contraction(self) -> float | None:
        """Mean remaining fraction of the drift after each turn; None for a single turn or without a drift."""
        turns = len(self.drift) - 1
        if turns < 1 or self.drift[0] == 0.0:
            return None
        return float((self.drift[-1] / self.drift[0]) ** (1.0 / turns))


@dataclass(frozen=True)
class GimbalPlotData:
    """All axes in the order of their turns."""

    axes: tuple[GimbalAxis, ...]
    threshold: float  #: Threshold of the drift, rad.
    #: Value and sigma of each misalignment from a joint fit to all samples, rad.
    least_squares: Mapping[str, tuple[float, float]]

    @property
    def excessive_sigma(self) -> float | None:
        """Largest misalignment sigma, rad, if it exceeds the threshold although the drift of an axis is below it."""
        largest = max((sigma for _, sigma in self.least_squares.values()), default=0.0)
        return largest if largest > self.threshold and any(axis.converged for axis in self.axes) else None


@dataclass(frozen=True)
class Recording:
    """A recording before it is solved."""

    path: Path
    serial: str
    sample_rate: float  #: Hz.
    duration: float  #: Duration, s.
    truth: Mapping[str, float]  #: True parameters, SI, of a recording of the virtual bench.
    registers: Mapping[str, float]  #: Registers with which the unit corrected the output, SI; {} for none.


@dataclass(frozen=True)
class MethodSolution:
    """Solution of a recording."""

    recording: Recording
    stage: str
    resolved: Resolved
    #: Previous value and sigma of each parameter, SI; the sigma of a stored value is None.
    before: Mapping[str, tuple[float, float | None]]
    schedule: Mapping[str, Any]  #: Schedule of the method, as in a product file.
    plot_data: PositionPlotData | GimbalPlotData | PairPlotData  #: Plot data of the method.

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """The parameters of the result."""
        return self.resolved.result.parameters


def solve_method(report: ProgressCallback, path: Path, stage: str) -> MethodSolution:
    """Job: solve a recording as the stage ``multi_position``, ``gimbal`` or ``cross_calibration``.

    Only the samples of this stage are solved or, if there are none, the whole recording. Raises InputError or
    ConfigurationError.
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
    recording = Recording(path, meta.imu.serial, rate, duration, read_truth(path), meta.registers)
    plot_data = _plot_data(log, stage, resolved.result, schedule)
    return MethodSolution(recording, stage, resolved, _before(meta, stage), schedule, plot_data)


def _plot_data(
    log: Log, stage: str, result: Result, schedule: Mapping[str, Any]
) -> PositionPlotData | GimbalPlotData | PairPlotData:
    details: Mapping[str, Any] = result.details.get(stage, {})
    if stage == "gimbal":
        threshold = float(np.deg2rad(schedule["threshold_arcsec"] / 3600.0))
        axes = tuple(_axis(row, str(schedule["order"]), threshold) for row in details["axes"])
        fit = {name: (row["value"], row["sigma"]) for name, row in details["least_squares"].items()}
        return GimbalPlotData(axes, threshold, fit)
    context, prior = context_from_meta(log.meta), prior_from_meta(log.meta)
    blocks = list(log.blocks())
    stage_blocks = [block for block in blocks if block.stage == stage]
    data = stage_data(stage_blocks or blocks, context.imu)  # the samples that `resolve` uses
    if stage == "cross_calibration":
        return pair_plot_data(data, context, prior, details, schedule)
    after = prior.mean.copy()
    for name, row in result.parameters.items():
        if name in INDEX:
            after[INDEX[name]] = row.value
    return _position_plot_data(data, context, prior.mean, after, log.meta.product)


def _before(meta: LogMeta, stage: str) -> dict[str, tuple[float, float | None]]:
    if stage == "cross_calibration":
        return {
            pair_name(p.name, s.number): (float(s.stored.values.get(p.name, p.neutral)), None)
            for s in context_from_meta(meta).secondaries
            for p in PAIR_PARAMETERS
        }
    prior = prior_from_meta(meta)
    return {name: (float(prior.mean[k]), float(prior.sigma[k])) for k, name in enumerate(NAMES)}


def _position_plot_data(
    data: StageData, context: SolveContext, before: FloatArray, after: FloatArray, product: ProductSection | None
) -> PositionPlotData:
    gravity = context.site.local_gravity
    evidence = gather("multi_position", data, context, before, after)
    rests, motions = evidence.rests, evidence.motions
    lengths = [[float(np.linalg.norm(rest.compensated(p)[1])) - gravity for rest in rests] for p in (before, after)]
    turns = [turn_between(evidence, motion.before, motion.after, after) for motion in motions]
    angles = np.array([gravity_errors(evidence, turn, after) for turn in turns if turn]).reshape(-1, 2)
    force = np.array([rest.compensated(after)[1] for rest in rests]).reshape(-1, 3)
    checks = product.checks if product is not None else None
    force_check, angle_check = (checks.gravity_at_rest, checks.motion_angle) if checks is not None else (None, None)
    return PositionPlotData(
        gravity=gravity,
        up=force / np.linalg.norm(force, axis=1, keepdims=True),
        force_before=np.array(lengths[0]),
        force_after=np.array(lengths[1]),
        angle_before=angles[:, 0],
        angle_after=angles[:, 1],
        force_limit=None if force_check is None else force_check.within,
        angle_limit=None if angle_check is None else angle_check.within,
    )


def gimbal_plot_data(turns: Sequence[GimbalTurned], order: str) -> GimbalPlotData:
    """Return the plot data of the turns of a run so far; `order` contains the joints from base to body."""
    axes = []
    for axis in dict.fromkeys(turn.axis for turn in turns):
        about_axis = [turn for turn in turns if turn.axis == axis]
        angle, gain = float(np.mean([abs(turn.angle) for turn in about_axis])), about_axis[-1].gain
        row = {
            "axis": AXES[axis],
            "angles": [turn.angle for turn in about_axis],
            "drifts": [list(turn.drift) for turn in about_axis],
            "gain": gain,
            "largest_gain": largest_gain(order, axis, angle),
            "contraction": contraction(order, axis, angle, gain),
        }
        axes.append(_axis(row, order, about_axis[-1].threshold))
    return GimbalPlotData(tuple(axes), turns[-1].threshold if turns else 0.0, {})


def _axis(row: Mapping[str, Any], order: str, threshold: float) -> GimbalAxis:
    axis, angle = AXES.index(row["axis"]), float(np.mean(np.abs(row["angles"])))
    drift = np.abs(np.array(row["drifts"])).max(axis=1)
    largest, remaining = float(row["largest_gain"]), float(row["contraction"])
    fastest = 0.0
    if largest > 0.0:
        from scipy.optimize import minimize_scalar  # slow to import and rarely needed

        found = minimize_scalar(partial(contraction, order, axis, angle), bounds=(0.0, largest), method="bounded")
        fastest = float(found.x)
    return GimbalAxis(
        axis=row["axis"],
        angle=angle,
        drift=drift,
        predicted=drift[0] * remaining ** np.arange(len(drift)),
        gain=float(row["gain"]),
        largest_gain=largest,
        fastest_gain=fastest,
        contraction=remaining,
        converged=bool(drift[-1] < threshold),
    )
