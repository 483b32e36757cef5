"""Events of a run, which contain identifiers and values instead of the texts in the catalogue.

The progress bar, the log, the window and the database receive the same events. `to_json` and `from_json` convert
events for a pipe or a log.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from typing import Any

from calstation.errors import CalstationError
from calstation.estimation import Solution
from calstation.messages import values_from_json, values_to_json
from calstation.physics import INDEX
from calstation.records import Verdict


@dataclass(frozen=True)
class Event:
    """Base class of all events; `slot` is the slot of the unit concerned, or "" for the whole run or its only unit."""

    slot: str = field(default="", kw_only=True)


@dataclass(frozen=True)
class StateChanged(Event):
    """The state of the run changed from `previous` to `state`."""

    state: str
    previous: str


@dataclass(frozen=True)
class StageStarted(Event):
    """Stage number `index` (from 0) of `count` has begun; `duration` is its planned duration, s.

    A `repeated` stage can be ended early by `Command.END_STAGE`.
    """

    stage: str
    index: int
    count: int
    duration: float
    repeated: bool = False


@dataclass(frozen=True)
class StageProgress(Event):
    """Progress of a stage: `fraction` from 0 to 1, `remaining` time, s, and largest `sigma` by group, SI."""

    stage: str
    fraction: float
    remaining: float
    sigma: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class StageRanked(Event):
    """Observability of a stage up to `step`: rank of the observability matrix and strength by state; see `Ranking`."""

    stage: str
    step: int
    rank: int
    strength: Mapping[str, float]


@dataclass(frozen=True)
class StepStarted(Event):
    """A step has begun; `step` is its number in the samples, and `label` its identifier and values from the plan."""

    stage: str
    step: int
    kind: str
    label: tuple[str | float, ...] = ()


@dataclass(frozen=True)
class StageEnded(Event):
    """The motion of a stage has ended; `reason` is "plan", "rounds", "duration", "targets", "operator" or "failing".

    A stage with the reason `END_FAILING` is not solved.
    """

    stage: str
    reason: str
    rounds: int


@dataclass(frozen=True)
class PointCompleted(Event):
    """Temperature number `index` (from 1) of a stage, °C, and the moves up to `step` are complete.

    A run that is interrupted later can be resumed after this temperature.
    """

    stage: str
    index: int
    temperature: float
    step: int


@dataclass(frozen=True)
class TableMoved(Event):
    """Encoder angles, rad, and rates, rad/s, of the table."""

    outer: float
    inner: float
    outer_rate: float
    inner_rate: float
    moving: bool


@dataclass(frozen=True)
class JointsMoved(Event):
    """Angles, rad, and rates, rad/s, of a gimbal's joints x, y, z."""

    joints: tuple[float, ...]
    rates: tuple[float, ...]
    moving: bool


@dataclass(frozen=True)
class ChamberChanged(Event):
    """Temperatures of the air, the set point and the target of the chamber, °C, at station time `time`, s.

    `units` contains the temperatures of the units by slot, °C. `remaining` is the estimated time to the end of the soak
    or, outside a soak, to the target, s. In a soak, `limit` is the largest rate of change of a unit at its end, K/min,
    and `rates` contains the rates so far by slot, K/min. Air and units within `open_c`, °C, may be exposed to the room.
    """

    time: float
    air_c: float
    set_point_c: float
    target_c: float
    remaining: float
    units: Mapping[str, float] = field(default_factory=dict)
    rates: Mapping[str, float] = field(default_factory=dict)
    limit: float | None = None
    open_c: tuple[float, float] = (-math.inf, math.inf)
    door_open: bool | None = None


@dataclass(frozen=True)
class GimbalTurned(Event):
    """Turn number `index` (from 1) about the body axis `axis` by `angle`, rad, is complete.

    The `drift` of the other joints and the `threshold` are in rad; `gain` is α. `complete` is True if no more turns
    about the axis follow.
    """

    axis: int
    index: int
    angle: float
    drift: tuple[float, ...]
    threshold: float
    gain: float
    complete: bool


@dataclass(frozen=True)
class Trace(Event):
    """Output since the last trace: the IMU `time` of each tick, s, and the mean gyro and accel output x y z, SI."""

    time: tuple[float, ...]
    output: tuple[float, ...]


@dataclass(frozen=True)
class PositionGuided(Event):
    """Progress at the position with number `index` (from 1), to which the operator turns the unit.

    `stage` is "" while the unit is turned to verify its new registers. `state` is the state of a `Guidance`. `rest` is
    the duration of the rest so far, and `wanted` the required duration, s. `outer` and `inner` are the requested rail
    angles, rad, `outer_before` and `inner_before` the previous ones. `up` is the unit vector opposite to gravity in the
    body frame, shape (3,), and `done` contains these vectors of all completed positions in sequence. `suffices` is True
    if the completed positions determine all parameters of the stage.
    """

    stage: str
    index: int
    count: int
    state: str
    rest: float
    wanted: float
    outer: float
    inner: float
    outer_before: float
    inner_before: float
    up: tuple[float, ...]
    done: tuple[float, ...]
    suffices: bool


@dataclass(frozen=True)
class Message(Event):
    """A message to the user: the text ``event.<id>`` of the catalogue with its values."""

    id: str
    values: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class StageSolved(Event):
    """The solution of a stage: values and sigmas of the estimated parameters, SI, and the consistency of the stage."""

    stage: str
    parameters: Mapping[str, Mapping[str, float]]
    consistency: Mapping[str, Any]


@dataclass(frozen=True)
class Finalized(Event):
    """The run of a unit has ended; `result` is the content of the file `result_file`."""

    verdict: Verdict
    log: str
    result_file: str
    result: Mapping[str, Any]


@dataclass(frozen=True)
class Settled(Event):
    """A register operation has ended.

    `closing` is the outcome in the journal, "done", "kept" or "restored", or "stopped" if the operator stopped the
    operation. `proof` is the method of verification: "turn", "rest", "read_back", or "" without verification. `unit`
    contains the registers of the unit, but is empty after a stop.
    """

    serial: str
    closing: str
    proof: str
    unit: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Fault(Event):
    """The run has failed; `kind` is the class of the error, or ``internal`` for a programming error."""

    kind: str
    text: str
    exit_code: int
    code: str = ""
    values: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, error: CalstationError) -> "Fault":
        """Return the fault event for an error."""
        return cls(type(error).__name__, str(error), error.exit_code, error.code, error.values)


_KINDS: dict[str, Callable[..., Event]] = {kind.__name__: kind for kind in Event.__subclasses__()}

#: Events that only refresh a display; a slow listener may miss some of them, and they are not logged.
LOSSY = (StageProgress, StageRanked, TableMoved, JointsMoved, ChamberChanged, Trace, PositionGuided)


def times(station: float | None) -> dict[str, Any]:
    """Return the times of an event for a log: that of the `station`, s, if it is known, and the time of day in UTC."""
    known = {} if station is None else {"station_time": station}
    return {**known, "utc": datetime.now(UTC).isoformat(timespec="milliseconds")}


def to_json(event: Event) -> dict[str, Any]:
    """Convert an event to a dictionary for JSON, with the name of its class under ``event``."""
    data = asdict(event)
    if not event.slot:
        del data["slot"]
    if isinstance(event, Message | Fault):
        data["values"] = values_to_json(event.values)
    return {"event": type(event).__name__, **data}


def from_json(data: Mapping[str, Any]) -> Event:
    """Convert the result of `to_json` back to an event. Raises KeyError if the class is unknown."""
    values = dict(data)
    kind = _KINDS[values.pop("event")]
    for name in ("label", "time", "output", "up", "done", "joints", "rates", "drift", "open_c"):
        if isinstance(values.get(name), list):
            values[name] = tuple(values[name])
    if "values" in values:
        values["values"] = values_from_json(values["values"])
    if "verdict" in values:
        values["verdict"] = Verdict(values["verdict"])
    return kind(**values)


def solution_events(solution: Solution) -> tuple[StageSolved | Message, ...]:
    """Return the events of a stage's solution: the solution itself, then the solver's messages."""
    sigma, consistency = solution.posterior.sigma, solution.consistency
    parameters = {
        name: {"value": float(solution.posterior.mean[INDEX[name]]), "sigma": float(sigma[INDEX[name]])}
        for name in solution.estimated
    }
    parameters |= {name: {"value": e.value, "sigma": e.sigma} for name, e in solution.estimates.items()}
    names = ("nis_mean", "nis_low", "nis_high", "warning")
    innovations = {"passed": consistency.verdict, **{name: getattr(consistency, name) for name in names}}
    remarks = [Message(message_id, dict(values)) for message_id, values in solution.messages]
    return StageSolved(solution.stage, parameters, innovations), *remarks
