"""Jobs that solve a range of a log with progress, or export logs, results and runs."""

import json
import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from calstation.errors import ConfigurationError, InputError
from calstation.escaping import for_csv
from calstation.estimation.common import SampleBlock
from calstation.jobs import ProgressCallback
from calstation.messages import os_reason
from calstation.physics import INDEX, NAMES, PARAMETERS, EffectName, further_parameter
from calstation.records import (
    IndexedRun,
    RunFilter,
    Verdict,
    export_csv,
    open_log,
    partial_path,
    write_atomic,
    write_log,
)
from calstation.results.history import History
from calstation.results.plots import StageSpan
from calstation.results.resolving import Resolved, resolve
from calstation.results.result import Result, in_sigma, write_json
from calstation.results.sections import Parameter
from calstation.results.stored_runs import lacks_log

#: Measured cost of solving a sample relative to reading it, by stage and for the filter, which takes several passes.
_BATCH, _FILTER = {"rate": 2.5, "six_position": 1.0}, 10.0

#: Columns with 1 or 0: run is partial or simulated, unit was released, result file was changed, log is missing.
_FLAGS = ("partial", "simulated", "released", "result_changed", "log_missing")
#: First columns of exported runs, before the values and sigmas of the parameters.
_RUN_COLUMNS = (
    "serial",
    "started_utc",
    "duration_s",
    "product",
    "station",
    "operator",
    "attempt",
    "verdict",
    "stages",
    "failed_checks",
    "batch",
    "slot",
    *_FLAGS,
)


def offline_solve(
    report: ProgressCallback,
    path: Path,
    stages: tuple[str, ...] | None,
    first_seq: int,
    last_seq: int,
    spans: Sequence[StageSpan],
    states: tuple[EffectName, ...] = (),
) -> Resolved:
    """Job: solve a log between two sequence numbers, see `resolve`; the progress note is the stage.

    `spans` are the log's stages, from its index; `states` are added to its model.
    """
    solved_spans = [s for s in spans if stages is None or s.stage in stages]
    shares: dict[str, float] = {}
    for span in solved_spans:
        cost = span.within(first_seq, last_seq) * _BATCH.get(span.stage, _FILTER)
        shares[span.stage] = shares.get(span.stage, 0.0) + cost
    total = max(sum(s.within(first_seq, last_seq) for s in solved_spans) + sum(shares.values()), 1.0)
    fractions: dict[str, float] = {}
    read, reported = 0, 0.0

    def watch(stage: str, seq: int, done: float) -> None:
        nonlocal read, reported
        read = max(read, sum(s.within(first_seq, min(seq, last_seq)) for s in solved_spans))
        fractions.update({**dict.fromkeys(fractions, 1.0), stage: done})  # stages are solved in sequence
        work = read + sum(fractions[name] * shares.get(name, 0.0) for name in fractions)
        reported = max(reported, min(work / total, 0.99))
        report(reported, note=stage)

    return resolve(path, stages, first_seq, last_seq, watch, states=states)


def export_log(report: ProgressCallback, source: Path, target: Path, first_seq: int, last_seq: int) -> Path:
    """Job: export samples between two sequence numbers as CSV and TOML, see `export_csv`; a failure leaves no file."""
    count = max(last_seq - first_seq + 1, 1)
    export_csv(source, target, lambda done: report(min(done / count, 0.99)), first_seq, last_seq)
    return target


def import_recording(
    report: ProgressCallback, source: Path, meta_file: Path | None, topic: str | None, target: Path, samples: int
) -> Path:
    """Job: write a recording of another program to a raw log; a failure leaves no file.

    Raises InputError or ConfigurationError.

    Parameters
    ----------
    report : callback for the completed fraction
    source, meta_file, topic : recording, see `records.open_log`
    target : raw log to write
    samples : number of samples of the recording
    """
    log, partial = open_log(source, meta_file, topic), partial_path(target)

    def counted() -> Iterator[SampleBlock]:
        done = 0
        for block in log.blocks():
            yield block
            done += len(block)
            report(min(done / max(samples, 1), 0.99))

    try:
        partial.unlink(missing_ok=True)
        write_log(partial, log.meta, counted())
        partial.replace(target)
    except OSError as exc:
        partial.unlink(missing_ok=True)
        raise ConfigurationError("log.not_created", file=target, reason=os_reason(exc)) from exc
    return target


def drop_partial(report: ProgressCallback, target: Path) -> None:
    """Job: remove the partial file of a cancelled `export_log` or `export_runs`."""
    partial_path(target).unlink(missing_ok=True)
    report(1.0)


def export_result(report: ProgressCallback, result: Result, stored: Result | None, target: Path) -> Path:
    """Job: write a result as JSON, or its parameters and the stored parameters of the run to a ``.csv`` file.

    Raises ConfigurationError if the file cannot be written.
    """
    if target.suffix == ".csv":
        try:
            write_atomic(target, _parameters_csv(result, stored))
        except OSError as exc:
            raise ConfigurationError("result.unwritable", file=target, reason=os_reason(exc)) from exc
    else:
        write_json(target, result.to_json())
    report(1.0)
    return target


def export_runs(report: ProgressCallback, folder: Path, conditions: RunFilter, target: Path) -> Path:
    """Job: export the runs of a folder that meet all conditions, the latest first; a failure leaves no file.

    A ``.csv`` or ``.parquet`` file contains a row per run with its values and sigmas from the index, and their SI units
    in the heading; any other file contains a list of the result JSONs, without the runs that have no result. An altered
    result file is replaced by the result in the log, if there is one. Raises InputError if a result cannot be read,
    ConfigurationError if the file cannot be written, or if pyarrow, which writes Parquet, is not installed.
    """
    history = History(folder)
    history.compare_logs(conditions, lambda done: report(0.5 * done))
    runs = history.indexed(conditions)
    partial = partial_path(target)
    try:
        if target.suffix == ".parquet":
            _write_parquet(partial, _run_rows(runs))
        else:
            texts = (for_csv([row]) for row in _run_rows(runs))
            with partial.open("w", encoding="utf-8", newline="") as stream:
                for done, text in enumerate(texts if target.suffix == ".csv" else _run_results(history, runs)):
                    stream.write(text)
                    report(min(0.5 + 0.5 * done / (len(runs) + 1), 0.99))
        partial.replace(target)
    except OSError as exc:
        raise ConfigurationError("result.unwritable", file=target, reason=os_reason(exc)) from exc
    finally:
        with suppress(OSError):
            partial.unlink()
    return target


def _write_parquet(file: Path, rows: Iterator[list[Any]]) -> None:
    """Write the rows of runs to a Parquet file; texts are not escaped, because spreadsheets do not evaluate them."""
    try:
        import pyarrow as pa
        import pyarrow.parquet
    except ImportError as exc:
        raise ConfigurationError("api.no_package", function="Parquet", package="pyarrow") from exc
    names, *runs = rows
    types = {name: pa.string() for name in _RUN_COLUMNS} | {"duration_s": pa.float64()}
    types |= dict.fromkeys(("attempt", *_FLAGS), pa.int64())
    columns = ([run[k] for run in runs] for k in range(len(names)))
    arrays = [pa.array(column, types.get(name, pa.float64())) for name, column in zip(names, columns, strict=True)]
    pyarrow.parquet.write_table(pa.table(arrays, names=names), file)


def _run_results(history: History, runs: Sequence[IndexedRun]) -> Iterator[str]:
    """Yield a JSON list of results in pieces, without incomplete runs that were not closed."""
    begin = "["
    for run in runs:
        record = replace(run.record, result=None) if run.record.altered else run.record
        if run.record.verdict is Verdict.INCOMPLETE and record.result is None:
            continue
        try:
            result = history.result(record)
        except InputError:
            if not run.record.altered:
                raise
        else:
            yield begin + "\n" + json.dumps(result.to_json(), allow_nan=False, ensure_ascii=False)
            begin = ","
    yield "[]\n" if begin == "[" else "\n]\n"


def _run_rows(runs: Sequence[IndexedRun]) -> Iterator[list[Any]]:
    """Yield the header row and the row of each run; None is an empty cell."""
    solved = dict.fromkeys(name for run in runs for name in run.values)
    names = [*(name for name in NAMES if name in solved), *(name for name in solved if name not in INDEX)]
    heads = [f"{name}{end}{_unit_text(name)}" for name in names for end in ("", "_sigma")]
    yield [*_RUN_COLUMNS, *heads]
    for run in runs:
        record = run.record
        cells: list[Any] = [record.serial, record.started_utc, record.duration, record.product, record.station]
        cells += [record.operator, record.attempt, str(record.verdict), " ".join(record.stages)]
        cells += ["; ".join(check.name for check in run.failed_checks), record.batch, record.slot]
        cells += map(int, (record.partial, record.simulated, record.released, record.altered, lacks_log(record)))
        for name in names:
            cells += [run.values[name], run.sigmas.get(name, math.nan)] if name in run.values else [None, None]
        yield cells


def _unit_text(name: str) -> str:
    """Return the SI unit of a parameter in brackets, or "" if the parameter is unknown."""
    parameter = PARAMETERS[INDEX[name]] if name in INDEX else further_parameter(name)
    return "" if parameter is None else f" [{parameter.unit}]"


def _parameters_csv(result: Result, stored: Result | None) -> str:
    before = stored.parameters if stored is not None else {}
    head = ("parameter", *Parameter.model_fields, "online_value", "online_sigma", "difference_in_sigma")
    lines = [for_csv([head])]
    for name, row in result.parameters.items():
        online = before.get(name)
        compared = ["", "", ""]
        if online is not None:
            compared = [repr(online.value), repr(online.sigma), f"{in_sigma(row, online):.6g}"]
        values = (getattr(row, field) for field in Parameter.model_fields)
        fields = [value if isinstance(value, str) else repr(value) for value in values]
        lines.append(for_csv([[name, *fields, *compared]]))
    return "".join(lines)
