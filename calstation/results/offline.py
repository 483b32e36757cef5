"""Jobs of the offline page: solving a range of a log with progress, and exports of log and result."""

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from calstation.errors import ConfigurationError
from calstation.messages import os_reason
from calstation.records import export_csv, partial_path, write_atomic
from calstation.results.plots import StageSpan
from calstation.results.resolving import Resolved, resolve

_BATCH = {"rate": 2.5, "six_position": 1.0}
#: Measured cost of solving a sample relative to reading it; filters take several passes.
_FILTER = 10.0

CSV_COLUMNS = (
    "parameter",
    "value",
    "sigma",
    "unit",
    "stage",
    "online_value",
    "online_sigma",
    "difference_in_sigma",
)


def offline_solve(
    tell: Callable[..., None],
    path: Path,
    stages: tuple[str, ...] | None,
    first_seq: int,
    last_seq: int,
    spans: Sequence[StageSpan],
) -> Resolved:
    """Job: solve a log between two sequence numbers; the note of its progress is the stage.

    Parameters
    ----------
    tell : progress of the job
    path, stages, first_seq, last_seq : as for `resolve`
    spans : the log's stages, from its index

    Raises
    ------
    CalstationError
        As `resolve`.
    """
    meter = _Meter(tell, stages, first_seq, last_seq, spans)
    return resolve(path, stages, first_seq, last_seq, meter.watch)


class _Meter:
    """Combines samples read and stages solved into one fraction."""

    def __init__(
        self,
        tell: Callable[..., None],
        stages: tuple[str, ...] | None,
        first_seq: int,
        last_seq: int,
        spans: Sequence[StageSpan],
    ) -> None:
        self._tell = tell
        self._range = (first_seq, last_seq)
        self._spans = [s for s in spans if stages is None or s.stage in stages]
        self._total = 0.0
        self._shares: dict[str, float] = {}
        for span in self._spans:
            samples = span.within(first_seq, last_seq)
            share = samples * _BATCH.get(span.stage, _FILTER)
            self._shares[span.stage] = self._shares.get(span.stage, 0.0) + share
            self._total += samples + share
        self._solved: dict[str, float] = {}
        self._read = 0
        self._most = 0.0

    def watch(self, stage: str, seq: int, solved: float) -> None:
        """Take the progress of `resolve`."""
        first, last = self._range
        self._read = max(self._read, sum(s.within(first, min(seq, last)) for s in self._spans))
        for name in self._shares:
            if name == stage:
                self._solved[name] = max(solved, self._solved.get(name, 0.0))
                break
        for name in self._solved:
            if name != stage:
                self._solved[name] = 1.0  # stages are solved one after another
        done = self._read + sum(self._solved[name] * self._shares[name] for name in self._solved)
        self._most = max(self._most, min(done / max(self._total, 1.0), 0.99))
        self._tell(self._most, note=stage)


def export_log(tell: Callable[..., None], source: Path, target: Path, first_seq: int, last_seq: int) -> Path:
    """Job: export samples of a log as CSV and TOML, see `export_csv`; a failure leaves no file.

    Parameters
    ----------
    tell : progress of the job
    source, target : log and CSV
    first_seq, last_seq : range of samples, both included
    """
    count = max(last_seq - first_seq + 1, 1)
    export_csv(source, target, lambda done: tell(min(done / count, 0.99)), first_seq, last_seq)
    return target


def drop_partial(tell: Callable[..., None], target: Path) -> None:
    """Job: remove the partial file of a cancelled `export_log`."""
    partial_path(target).unlink(missing_ok=True)
    tell(1.0)


def export_result(
    tell: Callable[..., None], result: Mapping[str, Any], stored: Mapping[str, Any] | None, target: Path
) -> Path:
    """Job: write a result as JSON, or its parameters and those of the run as CSV, depending on the target's suffix.

    Parameters
    ----------
    tell : progress of the job
    result : result JSON
    stored : result JSON of the run, if the log has one
    target : file to write

    Raises
    ------
    ConfigurationError
        If the file cannot be written.
    """
    if target.suffix == ".csv":
        text = _parameters_csv(result, stored)
    else:
        text = json.dumps(result, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
    try:
        write_atomic(target, text)
    except OSError as exc:
        raise ConfigurationError("result.unwritable", file=target, reason=os_reason(exc)) from exc
    tell(1.0)
    return target


def in_sigma(offline: Mapping[str, Any], online: Mapping[str, Any]) -> float:
    """Difference of two estimates of a parameter, offline minus online, divided by the larger sigma.

    If one uses part of the other's data, the sigma of the difference is never larger than that
    (J. A. Hausman, *Specification Tests in Econometrics*, Econometrica 46(6), 1978, lemma 2.1).
    """
    difference = float(offline["value"] - online["value"])
    sigma = max(float(offline["sigma"]), float(online["sigma"]))
    return difference / sigma if sigma > 0.0 else 0.0 if difference == 0.0 else float("inf")


def _parameters_csv(result: Mapping[str, Any], stored: Mapping[str, Any] | None) -> str:
    before: Mapping[str, Any] = stored["parameters"] if stored is not None else {}
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(CSV_COLUMNS)
    for name, row in result["parameters"].items():
        online = before.get(name)
        cells = [name, repr(row["value"]), repr(row["sigma"]), row["unit"], row["stage"]]
        if online is None:
            cells += ["", "", ""]
        else:
            cells += [repr(online["value"]), repr(online["sigma"]), f"{in_sigma(row, online):.6g}"]
        writer.writerow(cells)
    return stream.getvalue()
