"""Interrupted runs that can be resumed together: the run of a unit, or the runs of the units of a batch."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from calstation.config import load_station
from calstation.errors import ConfigurationError, InputError
from calstation.jobs import ProgressCallback
from calstation.messages import Text
from calstation.records import RunFilter, RunRecord, Verdict, being_written, open_log
from calstation.results import History
from calstation.runs.resume import Resumable, as_resumable, best_run

#: Maximum number of runs or batches that are offered; later ones take precedence.
_MAX_OFFERED = 20

#: Kinds of the steps that change the temperature of the chamber.
_CHAMBER_STEPS = ("soak", "soak_to_verify", "ramp")


@dataclass(frozen=True)
class Interrupted:
    """Interrupted runs that can be resumed together, those of a batch in the order of their slots.

    `others` are the other units of the batch, each with the reason why it is not resumed, a term of the catalogue
    family ``not_resumed``; `runs` is empty if no unit is resumed. `unloaded` are the units whose slots were later used
    for other units.
    """

    runs: tuple[Resumable, ...]
    others: tuple[tuple[str, str], ...] = ()
    unloaded: frozenset[str] = frozenset()

    @property
    def logs(self) -> tuple[Path, ...]:
        """The logs of the runs."""
        return tuple(run.log for run in self.runs)

    @property
    def on_table(self) -> "Interrupted":
        """The runs of the units that may still be on the table."""
        absent = tuple((run.serial, "not_loaded") for run in self.runs if run.serial in self.unloaded)
        return Interrupted(tuple(run for run in self.runs if run.serial not in self.unloaded), (*absent, *self.others))

    def question(self, chosen: Collection[str]) -> Text:
        """Return the question whether to resume the runs; it names products of the runs that are not in `chosen`."""
        if not self.runs:
            return Text.of("question.units_in_other_slots", others=self._reasons)
        run = min(self.runs, key=lambda run: run.completed.amount)
        finished, serials = len(run.finished), [each.serial for each in self.runs]
        stage = (*run.stages, "transfer")[finished]
        unchosen = dict.fromkeys(each.product for each in self.runs if each.product not in (None, *chosen))
        several = len(serials) > 1
        in_slot = run.slot is not None
        code = "question.resume" if not in_slot else "question.units_resume" if several else "question.unit_resume"
        points, others = run.completed.points, self._reasons
        kept = Text.of("question.temperatures_kept", count=points) if points else ""
        notes = {"kept": kept, "others": others}
        both = Text("question.temperatures_kept_and", notes) if kept and others else kept or others
        at = "question.at_temperature" if points else "question.at_stage"
        values = {
            "serial": run.serial,
            "serials": serials,
            "count": len(serials),
            "units": [f"{each.slot}: {each.serial}" for each in self.runs],
            "slot": run.slot or "",
            "others": both,
            "kept": kept,
            "product": Text.of("question.as_product", products=list(unchosen)) if unchosen else "",
            "begin": Text.of(at, number=points + 1 if points else finished + 1),
        }
        return Text.of(code, number=finished + 1, stage=stage, when=run.started_utc, **values)

    @property
    def _reasons(self) -> Text | str:
        """The other units by the reason why they are not resumed, or ""."""
        serials: dict[str, list[str]] = {}
        for serial, reason in self.others:
            serials.setdefault(reason, []).append(serial)
        units = [Text.of("question.not_resumed_units", serials=s, reason=reason) for reason, s in serials.items()]
        return Text.of("question.not_resumed", units=units) if units else ""


def find_resumable(
    progress: ProgressCallback, folder: Path, station: str | None = None, *, measured: bool = False
) -> list[Resumable]:
    """Job: find the runs in a folder that a station (None for any) can resume, and return them with the latest first.

    At most one run per unit is returned, and no run that is older than the last verdict on the unit. If `measured`,
    simulated runs and their verdicts are ignored, as at a station with hardware.
    """
    history = History(folder, measured=measured)
    history.refresh()
    runs: list[Resumable] = []
    serials: set[str] = set()
    filters = [RunFilter(verdict=verdict) for verdict in Verdict if not verdict.judged]
    records = [run for run_filter in filters for run in history.runs(run_filter) if run.stages or run.resumable]
    for record in sorted(records, key=lambda r: r.started_utc, reverse=True):
        if record.serial in serials:
            continue
        serials.add(record.serial)
        run = best_run(history.of(record.serial), station)
        if run is not None:
            runs.append(run)
        if len({run.batch or run.log for run in runs}) == _MAX_OFFERED:
            break
    return runs


def find_interrupted(
    progress: ProgressCallback, folder: Path, station: str | None = None, *, measured: bool = False
) -> list[Interrupted]:
    """Job: find the runs that can be resumed, as in `find_resumable`, and group those of the units of a batch."""
    runs = find_resumable(progress, folder, station, measured=measured)
    history = History(folder, measured=measured)
    batches = [each for batch in _batches(runs) for each in _of_batch(history, batch, station)]
    interrupted = [*(Interrupted((run,)) for run in runs if run.slot is None), *batches]
    latest = history.runs(RunFilter(station=station or "", missing=None))
    return [replace(each, unloaded=_unloaded(each.runs, latest)) for each in interrupted]


def _unloaded(runs: Iterable[Resumable], latest: Iterable[RunRecord]) -> frozenset[str]:
    """Return the units of the runs whose slots at their stations were later used for other units."""
    used = [(run.station, run.slot, run.serial, run.started_utc) for run in latest if not run.origin]
    return frozenset(
        run.serial
        for run in runs
        for station, slot, serial, started in used
        if (station, slot) == (run.station, run.slot) and serial != run.serial and started > run.started_utc
    )


def find_chamber_left(progress: ProgressCallback, folder: Path, station: Path | None) -> str:
    """Job: return the start of the latest run of a station if it left the chamber at an unknown temperature, or "".

    Such a run died after it had begun to change the temperature, or ended before the chamber was back at ambient. A run
    without a verdict whose log cannot be read counts, too. The runs of a batch share one chamber.
    """
    here = load_station(station)[1]
    if here.chamber is None:
        return ""
    history = History(folder)
    history.refresh()
    for latest in history.runs(RunFilter(station=here.name, missing=None), 1):
        together = history.runs(RunFilter(batch=latest.batch, missing=None), None) if latest.batch else [latest]
        if any(_left_chamber(run) for run in together if not run.origin):
            return latest.started_utc
    return ""


def _left_chamber(run: RunRecord) -> bool:
    """Return whether a run used the chamber and left it at an unknown temperature, according to its log."""
    try:
        if being_written(run.log):
            return False
        log = open_log(run.log)
    except (ConfigurationError, InputError):
        return not run.verdict.judged
    used = any(each.get("event") == "StepStarted" and each.get("kind") in _CHAMBER_STEPS for each in log.events)
    messages = [each.get("id") for each in log.events if each.get("event") == "Message"]
    died = log.outcome is None and "chamber_may_be_opened" not in messages
    return used and (died or "chamber_unknown" in messages)


def interrupted_units(history: History, slots: Mapping[str, str], station: str) -> Interrupted | None:
    """Return the latest interrupted batch of units on the table, with the runs that can be resumed; None without one.

    Parameters
    ----------
    history : index of the folder of runs
    slots : name of the present slot of each unit, by serial number
    station : name of the station
    """
    runs = [run for serial in slots if (run := best_run(history.of(serial), station)) is not None]
    misplaced: Interrupted | None = None
    for batch in _batches(runs):
        for interrupted in _of_batch(history, batch, station):
            present = tuple(run for run in interrupted.runs if slots.get(run.serial) == run.slot)
            absent = [run.serial for run in interrupted.runs if run not in present]
            added = [serial for serial in slots if serial not in interrupted.runs[0].batch_units]
            reasons = [
                *((serial, "other_slot" if serial in slots else "not_loaded") for serial in absent),
                *interrupted.others,
                *((serial, "not_in_batch") for serial in added),
            ]
            if present:
                return Interrupted(present, tuple(reasons))
            misplaced = misplaced or Interrupted((), tuple(reasons))
    return misplaced


def _batches(runs: Iterable[Resumable]) -> list[str]:
    """Return the batches of the runs, the latest first."""
    latest = sorted(runs, key=lambda run: run.started_utc, reverse=True)
    return list(dict.fromkeys(run.batch for run in latest if run.batch is not None and run.slot is not None))


def _of_batch(history: History, batch: str, station: str | None) -> Iterator[Interrupted]:
    """Yield the runs of a batch that can be resumed together, those that have completed most first."""
    records = history.runs(RunFilter(batch=batch), None)
    best_runs = {record.serial: best_run(history.of(record.serial), station) for record in records}
    pending = [run for run in best_runs.values() if run is not None and run.batch == batch]
    if not pending:
        return
    units = pending[0].batch_units
    reasons = []
    for serial in units:
        if serial in {run.serial for run in pending}:
            continue
        reasons.append((serial, _reason(history, serial, records)))
    pending.sort(key=lambda run: (run.completed.amount, -units.index(run.serial)), reverse=True)
    every = {run.serial for run in pending}
    while pending:
        together = [run for run in pending if _ended_with(run, pending[0])]
        serials = {run.serial for run in together}
        apart = [(serial, "separately") for serial in units if serial in every - serials]
        yield Interrupted(tuple(sorted(together, key=lambda run: units.index(run.serial))), (*reasons, *apart))
        pending = [run for run in pending if run.serial not in serials]


def _reason(history: History, serial: str, batch: Sequence[RunRecord]) -> str:
    """Return why a unit of a batch is not resumed: the outcome of its later runs, or else of its run in the batch."""
    begun = min(record.started_utc for record in batch)
    for run in history.of(serial):
        if run.started_utc >= begun and (run.verdict.judged or run.closed):
            return "closed" if run.closed else run.verdict.value
    record = next((record for record in batch if record.serial == serial), None)
    reason = "nothing_completed" if record is None else as_resumable(record)
    return reason if isinstance(reason, str) else "repeated"


def _ended_with(run: Resumable, further: Resumable) -> bool:
    """Return whether a run ended together with another run, and not earlier due to a fault of its unit."""
    if run.completed.amount == further.completed.amount:
        return True
    return run.verdict is not Verdict.FAULT and run.completed.is_near(further.completed)
