"""Common reader for all logs: raw logs (.h5) and CSV files with a TOML file."""

import json
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from calstation.errors import InputError
from calstation.estimation.common import SampleBlock
from calstation.messages import Text
from calstation.physics import FloatArray
from calstation.records.columns import Layout
from calstation.records.csv_log import csv_blocks, csv_rows, is_text, load_recording, meta_path
from calstation.records.facts import FactsBuilder, LogFacts
from calstation.records.meta import LogMeta
from calstation.records.raw_log import SUFFIX
from calstation.records.raw_read import DamagedRows, raw_blocks, read_contents, row_count

#: Number of CSV samples that are searched for non-integer output.
_DECIMALS_WITHIN = 200


@dataclass
class Log:
    """A log on disk, whose samples are streamed and never kept in memory."""

    path: Path
    meta: LogMeta
    _scan: Callable[[], Iterator[SampleBlock]]
    events: list[dict[str, Any]] = field(default_factory=list)
    results: list[dict[str, Any]] = field(default_factory=list)
    outcome: str | None = None  #: Outcome of the run; None for a run that was not completed and for a CSV.
    stored_sha256: str | None = None  #: Digest recorded at the end of the run.
    #: Damaged rows of a raw log, which are omitted as gaps; known after all samples have been read.
    damaged_rows: tuple[DamagedRows, ...] = ()
    _found: list[DamagedRows] = field(default_factory=list)
    _jitter: list[float] = field(default_factory=list)
    _facts: LogFacts | None = None

    def blocks(self, first_seq: int | None = None, last_seq: int | None = None) -> Iterator[SampleBlock]:
        """Yield the samples from `first_seq` to `last_seq` (both included, unwrapped counts), split at stage changes.

        Raises InputError if the log has damage other than damaged rows, or has no sample in the range.
        """
        any_sample = False
        for block in self._all_blocks():
            chosen = _between(block, first_seq, last_seq)
            if len(chosen):
                any_sample = True
                yield chosen
        if any_sample:
            return
        facts = self.facts()
        if not facts.samples:
            raise InputError("log.no_samples", file=self.path)
        raise InputError(
            "log.empty_range",
            file=self.path,
            wanted_first=Text("log.start") if first_seq is None else first_seq,
            wanted_last=Text("log.end") if last_seq is None else last_seq,
            first=facts.first_seq,
            last=facts.last_seq,
        )

    @property
    def jitter(self) -> float:
        """Rms deviation of the arrival times of a CSV from the sample clock, s; known after reading, else 0."""
        return sum(self._jitter)

    def facts(self) -> LogFacts:
        """Return range, gaps, temperature and sha256 of the whole log, which is read only once."""
        if self._facts is None:
            for _ in self._all_blocks():
                pass
        assert self._facts is not None
        return self._facts

    def _all_blocks(self) -> Iterator[SampleBlock]:
        """Yield all samples; at the end, set damaged rows and facts. Raises InputError."""
        builder = FactsBuilder(self.meta)
        self._found.clear()
        for block in self._scan():
            builder.add(block)
            yield block
        facts = builder.facts()
        self.damaged_rows = tuple(self._found)
        if self.stored_sha256 is not None and not self.damaged_rows and facts.sha256 != self.stored_sha256:
            raise InputError("log.altered", file=self.path)
        self._facts = replace(facts, damaged=sum(part.count for part in self.damaged_rows))


def _between(block: SampleBlock, first: int | None, last: int | None) -> SampleBlock:
    start = 0 if first is None else int(block.seq.searchsorted(first, side="left"))
    stop = len(block) if last is None else int(block.seq.searchsorted(last, side="right"))
    if start == 0 and stop == len(block):
        return block
    return block.part(start, max(start, stop))


def open_log(path: Path, meta_file: Path | None = None) -> Log:
    """Open a raw log (.h5), or a CSV (.csv, .csv.gz) with its TOML file next to it or at `meta_file`.

    Raises InputError if the file is missing or of another type, or if its configuration is invalid.
    """
    if path.suffix == SUFFIX:
        contents = read_contents(path)
        found: list[DamagedRows] = []
        return Log(
            path,
            contents.meta,
            lambda: raw_blocks(path, found),
            contents.events,
            contents.results,
            contents.outcome,
            contents.sha256,
            _found=found,
        )
    if not path.is_file():
        raise InputError("log.not_found" if path.name.endswith((".csv", ".csv.gz")) else "log.not_a_log", file=path)
    if not is_text(path):
        raise InputError("log.not_a_log", file=path)
    meta, layout = load_recording(path, meta_file or meta_path(path))
    meta = _with_quantisation(path, meta, layout)
    jitter: list[float] = []
    return Log(path, meta, lambda: csv_blocks(path, meta, layout, jitter), _jitter=jitter)


def _with_quantisation(path: Path, meta: LogMeta, layout: Layout) -> LogMeta:
    """Return the configuration of a CSV with quantisation 0, if not given, for sensors with non-integer output."""
    counts: list[FloatArray] = []
    with suppress(InputError):  # reported when the samples are read
        for block in csv_blocks(path, meta, layout, []):
            counts.append(block.counts[block.valid])
            if sum(map(len, counts)) >= _DECIMALS_WITHIN:
                break
    decimal = (np.concatenate([np.empty((0, 6)), *counts]) % 1.0 != 0.0).any(axis=0)
    sensors = {"gyro_quantisation": decimal[:3].any(), "accel_quantisation": decimal[3:].any()}
    found = {name: 0.0 for name, known in sensors.items() if known and getattr(meta.imu, name) is None}
    return meta.model_copy(update={"imu": meta.imu.model_copy(update=found)}) if found else meta


def estimated_rows(path: Path) -> int:
    """Return the number of rows in a raw log, or an estimate for a CSV; at least 1. Raises InputError."""
    return max(1, row_count(path) if path.suffix == SUFFIX else csv_rows(path))


def truth_path(path: Path) -> Path:
    """Return the path of the file with the true parameters of a simulated recording."""
    return path.with_suffix(".truth.json")


def read_truth(path: Path) -> dict[str, float]:
    """Read the true parameters of a simulated recording, SI; empty for a recording of a real unit."""
    try:
        found = json.loads(truth_path(path).read_text(encoding="utf-8"))
        return {str(name): float(value) for name, value in found.items()}
    except (OSError, ValueError, AttributeError, TypeError):
        return {}
