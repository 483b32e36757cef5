"""The Python interface: what ``import calstation as cs`` offers to notebooks and other programs.

Arrays are NumPy arrays in SI units; axes are those of the IMU's body, x right, y front, z up. Every function raises
`CalstationError` with a ``code`` of the message catalogue and ``values``, and ``str(error)`` says what to do. Long
calculations call ``progress(fraction, remaining_s, note)``, and Ctrl-C interrupts them.
"""

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from functools import cached_property
from pathlib import Path
from typing import cast, get_args

import numpy as np

from calstation.config import RunRequest, library, load_product, read_text, with_product
from calstation.database import start_exchange
from calstation.designer import (
    Design,
    DesignRequest,
    TemperatureDesign,
    design_schedule,
    design_temperature,
    designed_product,
    temperature_product,
    unit_properties,
)
from calstation.errors import CalstationError, ConfigurationError
from calstation.estimation.common import SampleBlock, join_blocks
from calstation.exports import ExportCheck, ExportSource, export_calibration
from calstation.jobs import ProgressCallback
from calstation.physics import EffectName, FloatArray, IntArray
from calstation.records import Log as StoredLog
from calstation.records import LogMeta, context_from_meta, open_log
from calstation.results import Result, compensate_samples, known_temperatures, resolve_log, with_states
from calstation.results import resolve as resolve_file
from calstation.runs import Engine, RunStart
from calstation.sequencer import Fault, Finalized, StageProgress, StageStarted
from procedures import method

__all__ = [
    *("CalstationError", "Design", "ExportCheck", "Log", "Result", "TemperatureDesign"),
    *("apply", "design", "export", "open", "resolve", "run", "simulate"),
]

#: Called with the fraction done, the remaining time, s, or None, and the current activity.
Progress = Callable[[float, float | None, str], object]
#: Answers given automatically to the questions before a run, as by a command without a terminal.
_ANSWERS = {"spelling": "other_unit", "transfer": "undecided", "resume": "anew", "passed": "repeat"}


class Log:
    """A recording: samples of an IMU with table angles, and the configuration for solving them.

    Arrays are read from the file when they are first used. Their rows are the n samples.
    """

    def __init__(self, stored: StoredLog) -> None:
        self._stored = stored

    def __repr__(self) -> str:
        return f"Log({str(self.path)!r}, serial={self.serial!r}, product={self.product!r})"

    def __len__(self) -> int:
        return self._stored.facts().samples

    @property
    def path(self) -> Path:
        """File of the recording, or a description of a simulated one."""
        return self._stored.path

    @property
    def meta(self) -> LogMeta:
        """The whole configuration of the recording, as in its TOML file."""
        return self._stored.meta

    @property
    def serial(self) -> str:
        """Serial number of the unit."""
        return self.meta.imu.serial

    @property
    def product(self) -> str | None:
        """Name of the product; None if the recording names none."""
        return None if self.meta.product is None else self.meta.product.name

    @property
    def sample_rate(self) -> float:
        """Samples per second, Hz."""
        return self.meta.imu.sample_rate_hz

    @property
    def stages(self) -> tuple[str, ...]:
        """Names of the stages in the data, in order."""
        return tuple(dict.fromkeys(block.stage for block in self._blocks if block.stage))

    @property
    def first_seq(self) -> int:
        """Unwrapped sequence number of the first sample."""
        return self._stored.facts().first_seq

    @property
    def last_seq(self) -> int:
        """Unwrapped sequence number of the last sample."""
        return self._stored.facts().last_seq

    @cached_property
    def _blocks(self) -> list[SampleBlock]:
        return list(self._stored.blocks())

    @cached_property
    def _all(self) -> SampleBlock:
        return join_blocks(self._blocks)

    @cached_property
    def _output(self) -> FloatArray:
        return self._all.counts * context_from_meta(self.meta).imu.count_size

    @property
    def gyro(self) -> FloatArray:
        """Raw angular rate, the mean over each sample, rad/s, shape (n, 3)."""
        return self._output[:, :3]

    @property
    def accel(self) -> FloatArray:
        """Raw specific force, the mean over each sample, m/s², shape (n, 3)."""
        return self._output[:, 3:]

    @property
    def seq(self) -> IntArray:
        """Unwrapped sample counter, shape (n,)."""
        return self._all.seq

    @property
    def time_s(self) -> FloatArray:
        """IMU clock at the end of each sample, s, shape (n,)."""
        return self._all.time

    @property
    def temp_c(self) -> FloatArray:
        """Temperature of the unit, °C, NaN where unknown, shape (n,)."""
        return self._all.temperature

    @property
    def valid(self) -> np.ndarray:
        """False for an invalid sample, shape (n,)."""
        return self._all.valid

    @property
    def outer(self) -> FloatArray:
        """Encoder angle of the outer axis at the end of each sample, rad, NaN between polls, shape (n,)."""
        return self._all.angles[:, 0]

    @property
    def inner(self) -> FloatArray:
        """Encoder angle of the inner axis at the end of each sample, rad, NaN between polls, shape (n,)."""
        return self._all.angles[:, 1]

    @property
    def stage(self) -> np.ndarray:
        """Name of the stage of each sample, "" between stages, shape (n,)."""
        return np.repeat([block.stage for block in self._blocks], [len(block) for block in self._blocks])

    @property
    def step(self) -> IntArray:
        """Number of the move that each sample belongs to, shape (n,)."""
        return self._all.step


def open(path: str | Path) -> Log:
    """Open a raw log or a CSV file with its TOML file. Raises CalstationError if it cannot be used."""
    return Log(open_log(Path(path)))


def resolve(
    log: Log | str | Path,
    stages: Sequence[str] | None = None,
    first: int | None = None,
    last: int | None = None,
    states: Sequence[str] = (),
    progress: Progress | None = None,
) -> Result:
    """Solve a recording, as ``calstation resolve`` does.

    Parameters
    ----------
    log : recording, or its file
    stages : stages to solve; None for all in the recording that have enough data
    first, last : first and last sequence number, both included; None for the ends of the recording
    states : effects to estimate in addition to the 30 parameters, such as ``"g_sensitivity"``
    progress : function that is called with the fraction of the recording that has been read

    Returns
    -------
    Result
        The parameters with their sigmas, the checks, and the verdict if the recording has limits
    """
    opened = log if isinstance(log, Log) else open(log)
    chosen = None if stages is None else tuple(stages)
    for stage in chosen or ():
        method(stage)
    for state in states:
        if state not in get_args(EffectName):
            raise ConfigurationError("cli.unknown_choice", option="states", value=state, choices=get_args(EffectName))
    added = cast(tuple[EffectName, ...], tuple(states))
    facts = opened._stored.facts()

    def show(stage: str, seq: int, done: float) -> None:
        if progress is not None:
            progress(min(max((seq - facts.first_seq) / max(facts.samples, 1), 0.0), 1.0), None, stage)

    if opened.path.is_file():
        return resolve_file(opened.path, chosen, first, last, show, states=added).result
    meta, new = with_states(opened.meta, added)
    return resolve_log(opened._stored, meta, chosen, first, last, show, added=new).result


def apply(
    result: Result, gyro: FloatArray, accel: FloatArray, temp_c: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Correct samples with the parameters of a result; parameters that the result does not contain are 0.

    Parameters
    ----------
    result : result whose parameters are applied
    gyro : raw angular rate, rad/s, shape (n, 3)
    accel : raw specific force, m/s², shape (n, 3)
    temp_c : temperature of the unit, °C, shape (n,), or one value for all samples; required for a result over
        temperature, whose term in the rate of change is omitted. Missing values (NaN) are interpolated; values outside
        the range of the result raise InputError.

    Returns
    -------
    gyro, accel : ndarray, shape (n, 3)
        Angular rate, rad/s, and specific force, m/s², at the IMU's reference point
    """
    arrays = {"gyro": np.asarray(gyro, dtype=np.float64), "accel": np.asarray(accel, dtype=np.float64)}
    for name, values in arrays.items():
        if values.ndim != 2 or values.shape[1] != 3 or len(values) != len(arrays["gyro"]):
            raise ConfigurationError("api.sample_shape", name=name, shape=str(values.shape))
    if result.temperature is None:
        return compensate_samples(result.vector, None, arrays["gyro"], arrays["accel"], np.empty(0))
    if temp_c is None:
        raise ConfigurationError("api.no_temperature")
    temperature = np.asarray(temp_c, dtype=np.float64)
    if temperature.shape not in ((), (len(arrays["gyro"]),)):
        raise ConfigurationError("api.temperature_shape", shape=str(temperature.shape), samples=len(arrays["gyro"]))
    temperature = known_temperatures(np.broadcast_to(temperature, len(arrays["gyro"])))
    return compensate_samples(result.vector, result.temperature, arrays["gyro"], arrays["accel"], temperature)


def export(
    result: Result, to: str, path: str | Path, log: Log | str | Path | None = None, *, allow_loss: bool = False
) -> ExportCheck:
    """Write a calibration as another program reads it, and check it by that program's formula, see `exports`.

    Parameters
    ----------
    result : result to export
    to : format, such as ``"kalibr"``
    path : file to write; the check is written beside it as ``path`` + ``.check.json``
    log : recording whose samples are used for the check; None for the result's own log
    allow_loss : whether to write the file even if parameters that the format cannot express exceed the product's limits

    Returns
    -------
    ExportCheck
        The largest differences from the data corrected by calstation, and the parameters that the format cannot express
    """
    stored = log._stored if isinstance(log, Log) else open_log(Path(log)) if log is not None else None
    return export_calibration(ExportSource.of(result, stored), to, Path(path), allow_loss=allow_loss)


def run(
    station: str | Path = "virtual_bench",
    product: str | Path | None = None,
    serial: str | Sequence[str] = "",
    progress: Progress | None = None,
    *,
    out: str | Path = "runs",
    seed: int | None = None,
    all_clear: bool = False,
) -> tuple[Result, ...]:
    """Calibrate the units at a station, as ``calstation run`` does. Ctrl-C stops the table safely, then interrupts.

    Parameters
    ----------
    station : station file, or its name in the library
    product : product file or name; None for the station's product
    serial : serial number, or one per slot in order, "-" for an empty slot
    progress : function that is called with the progress over all stages; the note is the stage
    out : folder for logs and results
    seed : seed of a virtual bench; None for that of the station file
    all_clear : confirms that everyone is clear of the table; without it, a real table does not move

    Returns
    -------
    tuple of Result
        One per unit, in the order of the slots, whatever the outcome
    """
    serials = (serial,) if isinstance(serial, str) else tuple(serial)
    stored, chosen = library.locate("stations", Path(station)), _product(product)
    request = with_product(RunRequest("", stored, chosen, out=Path(out), serials=serials, seed=seed))
    start = RunStart(request, "engineer")
    answers = {**_ANSWERS, **({"table_moves": "clear"} if all_clear else {})}
    while (question := start.next_question()) is not None:
        if question.subject not in answers:
            raise question.refusal
        start.answer(question, answers[question.subject])
    request = start.request
    units = dict.fromkeys(filter(None, request.serials or (request.serial,)), request.operator)
    with start_exchange(request.station, request.out, units) or nullcontext(), Engine.start(request) as engine:
        finalized = _follow(engine, progress)
    order = {name: number for number, name in enumerate(request.serials)}
    finalized.sort(key=lambda result: order.get(result.serial, 0))
    return tuple(finalized)


def _follow(engine: Engine, progress: Progress | None) -> list[Result]:
    """Read the events of a run until its end. Raises CalstationError if the run ends without a result."""
    results: list[Result] = []
    first = share = 0.0
    for event in engine.events():
        if isinstance(event, Finalized):
            results.append(Result.from_json(event.result))
        elif isinstance(event, Fault) and not event.slot and not results:
            raise CalstationError(event.code or "program.internal", **event.values)
        elif progress is not None and isinstance(event, StageStarted):
            first, share = event.index / event.count, 1.0 / event.count
            progress(first, event.duration, event.stage)
        elif progress is not None and isinstance(event, StageProgress):
            progress(first + share * event.fraction, event.remaining, event.stage)
    return results


def design(
    product: str | Path | None = None,
    station: str | Path = "virtual_bench",
    margin: float = 0.8,
    progress: Progress | None = None,
    *,
    time_limit: float | None = None,
    time_constant: float | None = None,
    self_heating: float | None = None,
    measured: Log | None = None,
    out: str | Path | None = None,
) -> Design | TemperatureDesign:
    """Find the shortest schedule that reaches a product's limits, as ``calstation design`` does.

    For a product with ``[temperature]``, which requires a station with a chamber, the schedule covers its range.

    Parameters
    ----------
    product : product file, or its name in the library; None for the default
    station : station file or name
    margin : fraction of its limit that no sigma may exceed
    progress : function that is called with the progress of the search
    time_limit : longest duration of the search, s; None for the usual effort
    time_constant : over temperature, thermal time constant of the unit in the chamber, s; None for the measured value
        or, without a measurement, 600 s
    self_heating : over temperature, difference of the unit from the air, K; None for the measured value or 0
    measured : over temperature, recording of the unit in the chamber, from which both values are determined
    out : product file to write, with the new schedule; None for no file

    Returns
    -------
    Design or TemperatureDesign
        The schedule, its ``duration``, s, and its ``worst`` sigma, relative to its limit
    """
    path, content = load_product(_product(product))
    stored, report = library.locate("stations", Path(station)), _report(progress)
    request = DesignRequest(stored, path, margin, time_limit=time_limit)
    design: Design | TemperatureDesign
    if content.temperature is None:
        given = {"time_constant": time_constant, "self_heating": self_heating, "measured": measured}
        for option, value in given.items():
            if value is not None:
                raise ConfigurationError("design.without_temperature", option=option)
        design = design_schedule(report, request)
        text = designed_product(read_text(path), design)
    else:
        log = None if measured is None else measured._stored
        design = design_temperature(report, request, *unit_properties(log, time_constant, self_heating))
        text = temperature_product(read_text(path), design)
    if out is not None:
        Path(out).write_text(text, encoding="utf-8")
    return design


def simulate(
    product: str | Path | None = None,
    seed: int = 1,
    station: str | Path = "virtual_bench",
    progress: Progress | None = None,
) -> tuple[Log, dict[str, float]]:
    """Simulate the samples of a product's whole schedule, without a run and without files.

    Parameters
    ----------
    product : product file, or its name in the library; None for the default
    seed : seed of unit, table and noise
    station : station file or name, with a virtual bench
    progress : function that is called at every stage

    Returns
    -------
    log : Log
        The recording, in memory
    truth : dict
        The true value of each of the 30 parameters, SI
    """
    from calstation.simulation import simulate_log  # production code contains no simulation, see `simulation`

    stored, truth = simulate_log(_report(progress), library.locate("stations", Path(station)), _product(product), seed)
    return Log(stored), truth


def _product(product: str | Path | None) -> Path | None:
    return None if product is None else library.locate("products", Path(product))


def _report(progress: Progress | None) -> ProgressCallback:
    """Return the callback of a job, which passes its three values to `progress`."""

    def report(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
        if progress is not None:
            progress(fraction, remaining_s, note)

    return report
