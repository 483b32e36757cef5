"""Resumption of a run after its last completed stage, in a log that begins with the samples of the completed stages.

The same chain solves these stages again with bit-identical results, so that posteriors need not be stored.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from calstation.config import RunRequest, StationConfig, load_station, site_folder, unit_requests
from calstation.errors import ConfigurationError, DeviceFaultError, InputError
from calstation.estimation import Solution
from calstation.estimation.common import SampleBlock
from calstation.judgement import latitude_agrees
from calstation.parsing import parse_toml
from calstation.records import (
    SUFFIX,
    Log,
    LogMeta,
    RawLogWriter,
    RunRecord,
    Verdict,
    being_written,
    can_be_resumed,
    completed_points,
    open_log,
    solved_stages,
)
from calstation.registers import open_transfer, registers_changed
from calstation.results import History, StageChain, stored_result
from calstation.sequencer import Event, LastSample, Message, PointCompleted, solution_events, to_json
from procedures import method

#: Outcomes of logs that cannot be resumed.
_ENDED = ("passed", "failed", "imported")


@dataclass(frozen=True)
class Completed:
    """The completed parts of a run: its finished `stages`, and the numbers of completed temperatures by stage."""

    planned: tuple[str, ...]
    stages: tuple[str, ...]
    temperatures: Mapping[str, frozenset[int]]

    @classmethod
    def of(cls, log: Log) -> "Completed":
        """Return what was completed in a log. Raises ConfigurationError if the run cannot be resumed."""
        planned = _run_stages(log)
        temperatures = {stage: frozenset(completed_points(log.events, stage)) for stage in planned}
        return cls(planned, _finished_stages(log), temperatures)

    @property
    def stage(self) -> str:
        """The stage after the finished ones, or ""."""
        return (*self.planned[len(self.stages) :], "")[0]

    @property
    def points(self) -> int:
        """Number of the last completed temperature of this stage; 0 if there is none."""
        return max(self.temperatures.get(self.stage, ()), default=0)

    @property
    def amount(self) -> tuple[int, int]:
        """Numbers of finished stages and of completed temperatures, by which runs with the same plan are compared."""
        return len(self.stages), self.points

    def is_near(self, further: "Completed") -> bool:
        """Return whether a run that ended with another run has completed at most one stage or temperature less.

        The units of a batch complete a stage or a temperature one after the other.
        """
        if len(further.stages) == len(self.stages):
            return further.points - self.points <= 1
        last = max(further.temperatures.get(self.stage, ()), default=0)
        return len(further.stages) - len(self.stages) == 1 and not further.points and last - self.points <= 1


def completed_by_all(runs: Sequence[Completed]) -> Completed:
    """Return what all of these runs with the same plan have completed; they can be resumed together after it."""
    least = min(runs, key=lambda run: run.amount)
    common = frozenset.intersection(*(run.temperatures.get(least.stage, frozenset()) for run in runs))
    return replace(least, temperatures={**least.temperatures, least.stage: common})


@dataclass(frozen=True)
class Resumable:
    """A run that can be resumed after its completed parts.

    `why` is the reason for the stop or the error, "" if the process died. `batch_units` are the serial numbers of all
    units of its batch.
    """

    serial: str
    log: Path
    started_utc: str
    attempt: int
    product: str | None
    station: str | None
    operator: str | None
    completed: Completed
    verdict: Verdict
    why: str
    batch: str | None = None
    slot: str | None = None
    batch_units: tuple[str, ...] = ()

    @property
    def stages(self) -> tuple[str, ...]:
        """All stages of the run."""
        return self.completed.planned

    @property
    def finished(self) -> tuple[str, ...]:
        """The stages that need not be repeated."""
        return self.completed.stages


def resumable_run(history: History, serial: str, station: str) -> Resumable | None:
    """Return the run of a unit that a station can resume, or None."""
    return best_run(history.of(serial), station)


def best_run(runs: Sequence[RunRecord], station: str | None) -> Resumable | None:
    """Return the latest run of a unit since its last verdict at any station that can be resumed, or None.

    If this run ended while it copied the log of a run that had completed more, return the earlier run.

    Parameters
    ----------
    runs : all runs of the unit, the latest first
    station : station that would resume it; None for any
    """
    best: Resumable | None = None
    continued: set[str | None] = set()
    for run in runs:
        if run.verdict.judged or run.closed:
            break
        if run.origin or (station is not None and run.station not in (None, station)):
            continue  # only the station at which a run began can resume it
        if best is not None and run.log.name not in continued:
            continue
        resumable = as_resumable(run)
        if isinstance(resumable, Resumable):
            further = best is None or resumable.completed.amount > best.completed.amount
            best = resumable if further else best
            continued.add(run.resumed_from)
    return best


def registers_written(meta: LogMeta, runs: Path) -> bool:
    """Return whether registers may have been written to the unit of a log since its run began.

    The folder of the runs contains the journals of virtual units. A damaged journal is ignored here; the start of a run
    reports it.
    """
    if meta.run is not None:
        with suppress(ConfigurationError):
            return registers_changed(_journals(meta, runs), meta.imu.serial, meta.run.started_utc)
    return False


def registers_unverified(meta: LogMeta, runs: Path) -> bool:
    """Return whether the registers of the unit of a log were written and neither verified nor restored."""
    with suppress(ConfigurationError):
        return open_transfer(_journals(meta, runs), meta.imu.serial) is not None
    return False


def _journals(meta: LogMeta, runs: Path) -> Path:
    """Return the folder with the journal of the unit of a log."""
    return runs if meta.is_simulated else site_folder()


def resumable_after(event: Event, before: bool) -> bool:
    """Return whether a run that ends after an event can be resumed, given whether it could be before the event."""
    if isinstance(event, Message) and event.id == "registers_transfer":
        return False
    return before or can_be_resumed([{"event": type(event).__name__}])


def as_resumable(record: RunRecord) -> Resumable | str:
    """Return the record as a resumable run, or the reason why its log does not permit it.

    The reason is a term of the catalogue family ``not_resumed``.
    """
    if record.verdict.judged or record.closed:
        return "closed" if record.closed else record.verdict.value
    if not (record.stages or record.resumable):
        return "nothing_completed"
    try:
        log = open_log(record.log)
        completed = Completed.of(log)
        result = stored_result(log)
    except (InputError, ConfigurationError, ValueError, KeyError):
        return "unreadable"
    written = result is not None and result.registers is not None and result.registers.new is not None
    if written or registers_written(log.meta, log.path.parent):
        # the remaining samples would be those of a different unit
        return "registers_unverified" if registers_unverified(log.meta, log.path.parent) else "registers_written"
    if result is not None and not latitude_agrees(result.checks):
        return "other_latitude"
    run = log.meta.run
    return Resumable(
        serial=record.serial,
        log=record.log,
        started_utc=record.started_utc,
        attempt=record.attempt,
        product=record.product,
        station=record.station,
        operator=record.operator,
        completed=completed,
        verdict=record.verdict,
        why=(result.end_reason if result is not None else None) or "",
        batch=run.batch if run else None,
        slot=run.slot if run else None,
        batch_units=tuple(run.batch_units or ()) if run else (),
    )


def _run_stages(log: Log) -> tuple[str, ...]:
    return tuple(log.meta.run.stages) if log.meta.run is not None else ()


def _finished_stages(log: Log) -> tuple[str, ...]:
    """Return the stages that need not be repeated. Raises ConfigurationError if the run cannot be resumed."""
    finished, planned = solved_stages(log.events), _run_stages(log)
    if log.outcome in _ENDED:
        raise ConfigurationError("run.ended", path=log.path)
    if not can_be_resumed(log.events):
        raise ConfigurationError("run.no_stage_finished", path=log.path)
    if finished != planned[: len(finished)]:
        raise ConfigurationError("run.stages_out_of_order", path=log.path)
    return finished


@dataclass(frozen=True)
class Continuation:
    """The earlier part of a resumed run: the request, the log that the run continues, and its completed parts."""

    request: RunRequest
    log: Log
    completed: Completed

    @classmethod
    def of(cls, request: RunRequest, path: Path) -> "Continuation":
        """Read the log of the run to resume. Raises ConfigurationError or InputError."""
        if path.suffix != SUFFIX:
            raise ConfigurationError("run.not_own_log", path=path, suffix=SUFFIX)
        log = open_log(path)
        if being_written(path):
            raise ConfigurationError("run.still_running", path=path)
        completed = Completed.of(log)
        _check_open(log)
        if registers_written(log.meta, path.parent):
            raise ConfigurationError("run.registers_changed", log=path.name)
        if log.meta.imu.serial != request.serial:
            raise ConfigurationError("run.other_unit", path=path, found=log.meta.imu.serial, serial=request.serial)
        _check_station(log, load_station(request.station)[1])
        run = log.meta.run
        if request.slot is not None and run is not None and run.slot != request.slot:
            slots = {"slot": run.slot or "", "given": request.slot}
            raise ConfigurationError("run.other_slot", path=path, serial=request.serial, **slots)
        filled = replace(
            with_stages_of(request, log),
            seed=run.seed if run else None,
            slot=run.slot if run else None,
            batch=run.batch if run else None,
            batch_units=tuple(run.batch_units or ()) if run else (),
            out=path.parent,
        )
        return cls(filled, log, completed)

    @classmethod
    def of_all(cls, request: RunRequest) -> "tuple[Continuation, ...]":
        """Read the logs of a unit, or of all units of a batch, which continue after what all units have completed.

        Raises ConfigurationError or InputError.
        """
        if not request.resumes:
            return () if request.resume is None else (cls.of(request, request.resume),)
        units = [
            cls.of(replace(unit, resume=log, resumes=()), log)
            for unit, log in zip(unit_requests(request), request.resumes, strict=True)
        ]
        furthest = max((unit.completed for unit in units), key=lambda completed: completed.amount)
        for unit in units:
            if unit.request.batch != units[0].request.batch:
                raise ConfigurationError("run.other_batch", path=unit.log.path, other=units[0].log.path)
            if not unit.completed.is_near(furthest):
                raise ConfigurationError("run.behind", path=unit.log.path, serial=unit.request.serial)
        completed = completed_by_all([unit.completed for unit in units])
        if completed.amount == (0, 0):
            raise ConfigurationError("run.no_stage_finished", path=units[0].log.path)
        return tuple(replace(unit, completed=completed) for unit in units)

    @property
    def finished(self) -> tuple[str, ...]:
        """The stages that are not repeated."""
        return self.completed.stages

    @property
    def points(self) -> list[PointCompleted]:
        """The temperatures of the stage after the finished ones that are not repeated."""
        events = completed_points(self.log.events, self.completed.stage)
        return [
            PointCompleted(event["stage"], index, event["temperature"], event["step"])
            for index, event in sorted(events.items())
            if index <= self.completed.points
        ]

    @property
    def attempt(self) -> int:
        """Sequence number of this run among the unit's runs, from 1."""
        return self.log.meta.run.attempt if self.log.meta.run is not None else 1

    def meta(self, new: LogMeta, registers_read: bool) -> LogMeta:
        """Return the configuration of the new log, a copy of the old one, so that the finished stages stay valid.

        `new` is the configuration of a new run, including the registers of the unit if they could be read. Raises
        ConfigurationError or DeviceFaultError if the site, the table, the unit or the product has changed.
        """
        old, path = self.log.meta, self.log.path
        for name in ("site", "imu", "table", "product", "temperature", "schedule"):
            if _without_none(getattr(new, name)) != _without_none(getattr(old, name)):
                raise ConfigurationError("run.section_changed", path=path, section=name)
        if registers_read and _prior_information(new) != _prior_information(old):
            raise DeviceFaultError("run.registers_changed", log=path.name)
        calibration = old.run.calibration if old.run is not None else None
        changes: dict[str, Any] = {"resumed_from": path.name, "calibration": calibration}
        if old.run is not None and old.run.standard_override and new.run and new.run.standard_override is None:
            names = ("standard_override", "standard_override_by", "standard_overridden")
            changes |= {name: getattr(old.run, name) for name in names}
        run = new.run.model_copy(update=changes) if new.run is not None else None
        sections = {name: getattr(old, name) for name in ("prior", "prior_correlation", "registers")}
        return new.model_copy(update={**sections, "run": run})

    def copy(
        self, log: RawLogWriter, chain: StageChain, on_block: Callable[[], None], on_solved: Callable[[Solution], None]
    ) -> LastSample:
        """Copy the finished stages into the new log and solve them again; return the last sample copied.

        The completed temperatures of the next stage are copied too, and the chain has started this stage.

        Raises InputError if the solution of a stage differs from that of the original run.

        Parameters
        ----------
        log : new log, which is open and empty
        chain : solver chain of the new run
        on_block : called before every block; may raise
        on_solved : called with the solution of each stage
        """
        last: SampleBlock | None = None
        started = ""
        for block, is_end in self._blocks():
            on_block()
            last = block
            log.append(block)
            if block.stage and block.stage != started:
                started = block.stage
                chain.start(started)
            if block.stage:
                chain.feed(block)
            if is_end:
                solution = chain.finish()
                self._compare(solution)
                on_solved(solution)
        if last is None:
            raise InputError("run.samples_missing", path=self.log.path, stage=_run_stages(self.log)[0])
        return LastSample(int(last.seq[-1]), float(last.time[-1]), int(last.step[-1]))

    def _blocks(self) -> Iterator[tuple[SampleBlock, bool]]:
        """Yield the blocks of the finished stages and temperatures, and whether each is the last of a finished stage.

        The samples of a stage that was resumed may contain blocks without a stage.
        """
        last_seq = {block.stage: int(block.seq[-1]) for block in self.log.blocks() if block.stage}
        remaining, copied = list(self.finished), 0
        points = self.points
        last_step = points[-1].step if points else 0
        for block in self.log.blocks():
            if block.stage and block.stage not in self.finished:
                stop = int(block.step.searchsorted(last_step, side="right"))
                if stop:
                    copied = int(block.step[stop - 1])
                    yield block.part(0, stop), False
                if stop < len(block):
                    break
                continue
            is_end = block.stage in remaining and int(block.seq[-1]) == last_seq[block.stage]
            yield block, is_end
            if is_end:
                remaining.remove(block.stage)
                if not remaining and not points:
                    return
        if copied < last_step:
            remaining.append(self.completed.stage)
        if remaining:
            raise InputError("run.samples_missing", path=self.log.path, stage=remaining[0])

    def _compare(self, solution: Solution) -> None:
        solved = to_json(solution_events(solution)[0])
        recorded = next(e for e in self.log.events if e.get("event") == "StageSolved" and e["stage"] == solution.stage)
        if solved["parameters"] != recorded["parameters"]:
            raise InputError("run.solved_differently", path=self.log.path, stage=solution.stage)


def _check_open(log: Log) -> None:
    """Raise ConfigurationError if the run, or one that continued it, was closed, or if another run has completed it.

    The unit may have changed since.
    """
    history = History(log.path.parent)
    history.refresh()
    names = {log.path.name}
    for run in reversed(history.of(log.meta.imu.serial)):
        continues = run.resumed_from in names
        if continues:
            names.add(run.log.name)
        if run.log.name in names and run.closed:
            raise ConfigurationError("run.closed", path=log.path)
        if continues and run.verdict.judged:
            raise ConfigurationError("run.continued_elsewhere", path=log.path, log=run.log.name)


def _check_station(log: Log, here: StationConfig) -> None:
    """Raise ConfigurationError if the run belongs to another station, even at the same site."""
    began = log.meta.run.station if log.meta.run is not None else None
    if began is not None and began != here.name:
        raise ConfigurationError("run.other_station", path=log.path, began=began, here=here.name)
    text = log.meta.profiles.get("station", "")
    virtual = "bench" in parse_toml(text)
    if text and virtual != (here.bench is not None):
        code = "run.station_now_hardware" if virtual else "run.station_now_virtual"
        raise ConfigurationError(code, path=log.path, station=here.name)


def with_stages_of(request: RunRequest, log: Log) -> RunRequest:
    """Return the request with the stages and the original schedules of a log."""
    stages = _run_stages(log)
    return replace(request, stages=stages, schedule={stage: stage_schedule(log.meta, stage) for stage in stages})


def stage_schedule(meta: LogMeta, stage: str) -> dict[str, Any]:
    """Return the original schedule of a stage; values that are missing in the log were None."""
    values = meta.schedule.get(stage, {})
    return {name: values.get(name) for name in method(stage).schedule.model_fields}


def _prior_information(meta: LogMeta) -> Any:
    """Return the registers applied in a run, and its current calibration or, without one, its prior."""
    calibration = meta.run.calibration if meta.run is not None else None
    return meta.registers, meta.prior if calibration is None else calibration.log


def _without_none(value: Any) -> Any:
    """Return a section without its None values, as it is stored in a log."""
    plain = value.model_dump() if hasattr(value, "model_dump") else value
    if isinstance(plain, Mapping):
        return {key: _without_none(item) for key, item in plain.items() if item is not None}
    return plain
