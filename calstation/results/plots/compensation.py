"""Plot data of a calibration applied to samples: force and rate before and after calibration over time and at rest."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from calstation.errors import InsufficientDataError
from calstation.estimation.common import (
    SHORTEST_REST,
    ImuModel,
    SampleBlock,
    StageData,
    compensated_means,
    find_stillness,
    join_blocks,
    rest_weights,
    stage_data,
)
from calstation.jobs import ProgressCallback
from calstation.judgement import Where
from calstation.physics import NAMES, RATE, FloatArray, compensate, compensation
from calstation.records import Correction, LogMeta, context_from_meta, open_log
from calstation.results.sections import Parameter
from calstation.results.temperature import TemperatureResult, compensate_samples, known_temperatures

_COLUMNS = 2000
#: Shortest averaging time of the curves, s; the noise of single samples is too large.
_AVERAGING_TIME = 0.25


@dataclass(frozen=True)
class Applied:
    """Samples compensated with the previous and with the new parameters."""

    path: Path | None  #: Recording; None for samples of the connected unit.
    serial: str
    time: FloatArray  #: Time since the start, s, shape (k,).
    #: Mean magnitude of the force minus gravity with the previous parameters, m/s², shape (k,).
    length_before: FloatArray
    length_after: FloatArray  #: Mean magnitude of the force minus gravity with the new parameters, m/s², shape (k,).
    rate_before: FloatArray  #: Magnitude of the mean rate with the previous parameters, rad/s, shape (k,).
    rate_after: FloatArray  #: Magnitude of the mean rate with the new parameters, rad/s, shape (k,).
    rests: FloatArray  #: Start and end of each rest, s, shape (r, 2).
    where: tuple[Where, ...]  #: Stage and number of each rest, as in the checks.
    rest_length: FloatArray  #: Mean force error of each rest, before and after, m/s², shape (r, 2).
    rest_rate: FloatArray  #: Mean rate of each rest, before and after, rad/s, shape (r, 2).
    length_rms: tuple[float, float]  #: Rms force error over all rests, before and after, m/s².
    rate_rms: tuple[float, float]  #: Rms rate over all rests, before and after, including earth rate, rad/s.
    earth: float = RATE  #: Earth rate, rad/s.
    corrected: bool = False  #: Whether the unit's registers corrected the samples; then before and after are equal.
    named: bool = True  #: Whether the unit reported its serial number.


def before_and_after(before: Mapping[str, float], parameters: Mapping[str, Parameter]) -> tuple[FloatArray, FloatArray]:
    """Return all parameters before and after a solution, SI, shape (30,) each; other parameters keep their values."""
    solved = {name: row.value for name, row in parameters.items() if name in NAMES}
    vectors = (np.array([values.get(name, 0.0) for name in NAMES]) for values in (before, {**before, **solved}))
    return next(vectors), next(vectors)


@dataclass(frozen=True)
class ImuOutput:
    """Samples of a unit, recorded or received."""

    meta: LogMeta
    blocks: list[SampleBlock]
    corrected: bool  #: Whether the samples were corrected by other registers than those in use for the solution.
    path: Path | None = None  #: Recording; None for samples of the connected unit.
    named: bool = True  #: Whether the unit reported its serial number.

    def __len__(self) -> int:
        """Return the number of samples."""
        return sum(map(len, self.blocks))

    def covered(self, over: TemperatureResult) -> "ImuOutput":
        """Return the samples at temperatures that a calibration covers, with interpolated temperatures.

        Raises InputError if there are none.
        """
        temperature = known_temperatures(np.concatenate([block.temperature for block in self.blocks]))
        if not over.covers(temperature).any():
            over.parameters_at(temperature)  # raises the error
        ends = np.cumsum([len(block) for block in self.blocks])[:-1]
        parts = zip(self.blocks, np.split(temperature, ends), strict=True)
        blocks = [replace(block, temperature=part).where(over.covers(part)) for block, part in parts]
        return replace(self, blocks=[block for block in blocks if len(block)])

    def correction(self, parameters: FloatArray, over: TemperatureResult | None) -> Correction:
        """Return the correction by parameters, SI, shape (30,), see `compensate_samples`; none if already corrected."""
        if self.corrected:
            return partial(compensate_samples, np.zeros(len(NAMES)), None)
        return partial(compensate_samples, parameters, over)

    def applied(self, before: FloatArray, after: FloatArray, over: TemperatureResult | None = None) -> Applied:
        """Apply parameters before and after a solution, SI, shape (30,) each; corrected output is left unchanged.

        The rests are those of the stages, as in the checks, or of all samples if none belongs to a stage.

        Raises InsufficientDataError if the unit never rests, and InputError if `over` does not cover the temperature of
        a sample.
        """
        if self.corrected:
            before = after = np.zeros(len(NAMES))
        context = context_from_meta(self.meta)
        data = stage_data(self.blocks, context.imu)
        block = join_blocks(self.blocks)
        block_after = block
        if over is not None and not self.corrected:
            raw = block.counts * context.imu.count_size
            rate, force = self.correction(after, over)(raw[:, :3], raw[:, 3:], block.temperature)
            block_after, after = replace(block, counts=np.hstack([rate, force]) / context.imu.count_size), 0.0 * after
        rests = [
            (part, Where(stage=stage, rest=k), a, b)
            for stage, part in self._stage_data(context.imu).items()
            for k, (a, b) in enumerate(find_stillness(part, context.imu).rests)
        ]
        if not rests:
            error = InsufficientDataError("solution.never_at_rest", shortest=SHORTEST_REST, seconds=len(data) * data.dt)
            if self.path is None:
                raise error
            raise InsufficientDataError("solution.in_log", file=self.path, what=error.as_text)
        gravity = context.site.local_gravity
        stride = max(1, round(_AVERAGING_TIME * context.imu.sample_rate), len(block) // _COLUMNS)
        count = len(block) // stride
        pairs = (block, before), (block_after, after)
        curves = [compensated_means(b, context.imu, p, stride) for b, p in pairs]
        start = float(data.time[0])
        lengths, rates = [], []
        for part, _, a, b in rests:
            first, last = (int(block.seq.searchsorted(part.seq[k])) for k in (a, b - 1))
            rests_of = [(samples.part(first, last + 1).counts * context.imu.count_size, p) for samples, p in pairs]
            # the same mean force as in the solution, which motion of the table hardly changes
            weights = rest_weights(part, context, a, b)
            means = [
                compensate(compensation(p), raw[:, :3].mean(axis=0, keepdims=True), weights[None] @ raw[:, 3:])
                for raw, p in rests_of
            ]
            lengths.append([float(np.linalg.norm(force[0]) - gravity) for _, force in means])
            rates.append([float(np.linalg.norm(rate[0])) for rate, _ in means])
        length_rms, rate_rms = (np.sqrt(np.mean(np.square(v), axis=0)) for v in (lengths, rates))
        return Applied(
            path=self.path,
            serial=context.imu.serial,
            time=block.time[: count * stride].reshape(count, stride).mean(axis=1) - start,
            length_before=np.linalg.norm(curves[0][1], axis=1) - gravity,
            length_after=np.linalg.norm(curves[1][1], axis=1) - gravity,
            rate_before=np.linalg.norm(curves[0][0], axis=1),
            rate_after=np.linalg.norm(curves[1][0], axis=1),
            rests=np.array([[part.time[a] - start, part.time[b - 1] - start] for part, _, a, b in rests]),
            where=tuple(where for _, where, _, _ in rests),
            rest_length=np.array(lengths),
            rest_rate=np.array(rates),
            length_rms=(float(length_rms[0]), float(length_rms[1])),
            rate_rms=(float(rate_rms[0]), float(rate_rms[1])),
            corrected=self.corrected,
            named=self.named,
        )

    def _stage_data(self, imu: ImuModel) -> dict[str, StageData]:
        """Return the samples of each stage; all samples as the stage "" if none belongs to a stage."""
        stages = list(dict.fromkeys(block.stage for block in self.blocks if block.stage)) or [""]
        return {stage: stage_data([b for b in self.blocks if b.stage == stage], imu) for stage in stages}


def read_recording(path: Path, registers: Mapping[str, float]) -> ImuOutput:
    """Read all samples of a recording; the solution used output corrected by `registers`, SI, {} for none.

    Raises InputError if it cannot be read.
    """
    log = open_log(path)
    corrected = bool(log.meta.registers) and log.meta.registers != dict(registers)
    return ImuOutput(log.meta, list(log.blocks()), corrected, path)


def apply_to_recording(
    report: ProgressCallback, path: Path, registers: Mapping[str, float], before: FloatArray, after: FloatArray
) -> Applied:
    """Job: apply previous and new parameters to all valid samples of a recording.

    Raises InputError if the recording cannot be read, or if the unit never rests.

    Parameters
    ----------
    report, path : progress, and the recording
    registers : parameters with which the recorded output was corrected, SI, {} for none
    before, after : previous and new parameters, SI, shape (30,) each
    """
    report(0.0)
    output = read_recording(path, registers)
    report(0.5)
    return output.applied(before, after)
