"""Incomplete runs: results of runs whose process died, and closing of runs that will not be resumed."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from calstation.config import StationConfig, load_station
from calstation.errors import CalstationError, ConfigurationError, InputError
from calstation.jobs import ProgressCallback
from calstation.judgement import End, judge, verdict_of
from calstation.parsing import read_json
from calstation.records import (
    SUFFIX,
    Log,
    being_written,
    can_be_resumed,
    open_log,
    prior_from_meta,
    solved_stages,
    stages_ended_by_hand,
)
from calstation.registers import Transfer, journal, journal_folder, open_transfer
from calstation.results import (
    Delivery,
    Ending,
    History,
    build_result,
    deliver_pending,
    ended_result,
    load_result,
    register_pending,
    write_json,
)
from calstation.runs.resume import registers_written


def finish_incomplete(folder: Path) -> list[Path]:
    """Write the missing result next to every log in `folder`, and return the logs of the runs that died.

    The result of a run that died is ``incomplete``, and the run can still be resumed; that of a run that ended is in
    its log. The results are delivered at the next hand-over. Logs that cannot be read, and results that cannot be
    written, are ignored.
    """
    logs = []
    for path in sorted(folder.glob(f"*{SUFFIX}")):
        if path.with_suffix(".json").exists():
            continue
        try:
            if being_written(path):
                continue
            log = open_log(path)
            if log.outcome is None:
                _write_result(log)
                logs.append(path)
            elif (result := ended_result(log)) is not None:
                _store(log, result.to_json())
        except (InputError, ConfigurationError):
            continue
    return logs


def attempts_in_progress(folder: Path, name: str, serial: str) -> list[int]:
    """Return the sequence numbers of a unit's runs in a folder that are being executed.

    Parameters
    ----------
    folder : folder of runs
    name : beginning of the names of the unit's logs
    serial : serial number of the unit
    """
    attempts = []
    for path in folder.glob(f"{name}_*{SUFFIX}"):
        with suppress(InputError):
            if not path.with_suffix(".json").exists() and being_written(path):
                meta = open_log(path).meta
                attempts += [meta.run.attempt] if meta.run is not None and meta.imu.serial == serial else []
    return attempts


def close_incomplete(path: Path, operator: str | None = None) -> Path:
    """Record in the result file of a run who decided when not to resume the run; return the file.

    Raises ConfigurationError if the run is still in progress or the folder cannot be written, InputError if the log or
    its result file cannot be read.
    """
    if not path.with_suffix(".json").exists() and being_written(path):
        raise ConfigurationError("run.still_running", path=path)
    log = open_log(path)
    result_file = path.with_suffix(".json")
    if not result_file.exists():
        if log.outcome is None:
            _write_result(log)
        elif log.results:
            write_json(result_file, log.results[-1])
        else:
            raise InputError("run.not_resumable", path=path)
    load_result(result_file)  # raises the errors of an unreadable file
    result: dict[str, Any] = read_json(result_file)
    decision = {"closed_utc": datetime.now(UTC).isoformat(timespec="seconds"), "closed_by": operator}
    write_json(result_file, {**result, **decision})
    return result_file


def _write_result(log: Log) -> None:
    prior = prior_from_meta(log.meta)
    facts = log.facts()
    finished = solved_stages(log.events)
    judgement = judge(log.meta, prior, ())
    verdict = verdict_of(End.INCOMPLETE, judgement.passed, partial=judgement.partial)
    resumable = can_be_resumed(log.events) and not registers_written(log.meta, log.path.parent)
    action = "resume" if resumable else "repeat"
    by_hand = stages_ended_by_hand(log.events, log.meta.schedule)
    ending = Ending(verdict, str(log.path), facts, advice=action, finished_stages=finished, ended_by_hand=by_hand)
    result = build_result(log.meta, prior, (), judgement, ending)
    _store(log, result.to_json())


def _store(log: Log, result: Mapping[str, Any]) -> None:
    """Write the result of a log next to it, and register it for the hand-over. Raises ConfigurationError."""
    with suppress(OSError):  # the result is still written
        register_pending(log.path.parent, log.path.stem)
    write_json(log.path.with_suffix(".json"), result)


def close_incomplete_job(progress: ProgressCallback, logs: Sequence[Path], operator: str | None) -> list[Path]:
    """Job: close runs that will not be resumed, update the history, and return their result files."""
    results = [close_incomplete(log, operator) for log in logs]
    for folder in {log.parent for log in logs}:
        History(folder).refresh()
    progress(1.0)
    return results


@dataclass(frozen=True)
class StartupRecovery:
    """Logs of the runs whose process died, the outcome of the hand-over, and the units with unverified registers."""

    incomplete: tuple[Path, ...]
    delivery: Delivery
    unverified: tuple[str, ...] = ()  #: Serial numbers of units whose registers were written, but not verified.


def recover_at_startup(progress: ProgressCallback, runs: Path, station: Path | None) -> StartupRecovery:
    """Job: finish incomplete runs, update the history, and deliver pending results as the station file specifies."""
    incomplete = finish_incomplete(runs) if runs.is_dir() else []
    progress(0.3)
    History(runs).refresh(lambda fraction: progress(0.3 + 0.4 * fraction))
    return StartupRecovery(tuple(incomplete), deliver_pending(progress, runs, station), _unverified(runs, station))


def _unverified(runs: Path, station: Path | None) -> tuple[str, ...]:
    """Return the units with an open transfer; a damaged journal or station file is reported when a run starts."""
    serials = []
    with suppress(CalstationError):
        here = load_station(station)[1]
        folder = journal_folder(here, runs)
        for serial in journal.serials(folder):
            with suppress(CalstationError):
                transfer = open_transfer(folder, serial)
                serials += [serial] if transfer is not None and _needs_recovery(transfer, runs, here) else []
    return tuple(serials)


def _needs_recovery(transfer: Transfer, runs: Path, station: StationConfig) -> bool:
    """Return whether an open transfer belongs neither to a run in progress nor to a run of another station.

    A hardware run whose log is not in this folder is considered a run of another station. Transfers of earlier
    versions have no station.
    """
    if transfer.station not in (None, station.name):
        return False
    log = runs / transfer.source
    if transfer.why != "run" or not log.exists():
        return transfer.why != "run" or station.bench is not None
    with suppress(InputError):  # a log that cannot be read is not being written
        run = open_log(log).meta.run
        return not being_written(log) and (run is None or run.station in (None, station.name))
    return True
