"""Jobs of the offline page: solving a range of a log with progress, and exporting logs and results."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from calstation.errors import ConfigurationError
from calstation.jobs import ProgressCallback
from calstation.messages import os_reason
from calstation.physics import EffectName
from calstation.records import export_csv, partial_path, write_atomic
from calstation.results.plots import StageSpan
from calstation.results.resolving import Resolved, resolve
from calstation.results.result import Parameter, Result, write_json

#: Measured cost of solving a sample relative to reading it; filters take several passes.
_BATCH, _FILTER = {"rate": 2.5, "six_position": 1.0}, 10.0


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
    chosen = [s for s in spans if stages is None or s.stage in stages]
    shares: dict[str, float] = {}
    for span in chosen:
        cost = span.within(first_seq, last_seq) * _BATCH.get(span.stage, _FILTER)
        shares[span.stage] = shares.get(span.stage, 0.0) + cost
    total = max(sum(s.within(first_seq, last_seq) for s in chosen) + sum(shares.values()), 1.0)
    solved: dict[str, float] = {}
    read, most = 0, 0.0

    def watch(stage: str, seq: int, done: float) -> None:
        nonlocal read, most
        read = max(read, sum(s.within(first_seq, min(seq, last_seq)) for s in chosen))
        solved.update({**dict.fromkeys(solved, 1.0), stage: done})  # stages are solved one after another
        work = read + sum(solved[name] * shares.get(name, 0.0) for name in solved)
        most = max(most, min(work / total, 0.99))
        report(most, note=stage)

    return resolve(path, stages, first_seq, last_seq, watch, states=states)


def export_log(report: ProgressCallback, source: Path, target: Path, first_seq: int, last_seq: int) -> Path:
    """Job: export samples between two sequence numbers as CSV and TOML, see `export_csv`; a failure leaves no file."""
    count = max(last_seq - first_seq + 1, 1)
    export_csv(source, target, lambda done: report(min(done / count, 0.99)), first_seq, last_seq)
    return target


def drop_partial(report: ProgressCallback, target: Path) -> None:
    """Job: remove the partial file of a cancelled `export_log`."""
    partial_path(target).unlink(missing_ok=True)
    report(1.0)


def export_result(report: ProgressCallback, result: Result, stored: Result | None, target: Path) -> Path:
    """Job: write a result as JSON, or to a ``.csv`` file its parameters next to those that the run stored, if any.

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


def in_sigma(offline: Parameter, online: Parameter) -> float:
    """Return the difference of two estimates of a parameter, offline minus online, divided by the larger sigma.

    If one estimate uses part of the other's data, the sigma of the difference is never larger than the larger sigma
    (J. A. Hausman, *Specification Tests in Econometrics*, Econometrica 46(6), 1978, lemma 2.1).
    """
    difference = offline.value - online.value
    sigma = max(offline.sigma, online.sigma)
    return difference / sigma if sigma > 0.0 else 0.0 if difference == 0.0 else float("inf")


def _parameters_csv(result: Result, stored: Result | None) -> str:
    before = stored.parameters if stored is not None else {}
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    head = ("parameter", "value", "sigma", "unit", "stage", "online_value", "online_sigma", "difference_in_sigma")
    writer.writerow(head)
    for name, row in result.parameters.items():
        online = before.get(name)
        compared = ["", "", ""]
        if online is not None:
            compared = [repr(online.value), repr(online.sigma), f"{in_sigma(row, online):.6g}"]
        writer.writerow([name, repr(row.value), repr(row.sigma), row.unit, row.stage, *compared])
    return stream.getvalue()
