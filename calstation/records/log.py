"""One way to read any log: the project's raw log (.h5) or a CSV beside its TOML."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from calstation.errors import InputError
from calstation.estimation.common.samples import SampleBlock
from calstation.records.csv_log import csv_blocks, meta_path
from calstation.records.damaged_rows import DamagedRows
from calstation.records.facts import FactsBuilder, LogFacts
from calstation.records.meta import LogMeta, load_meta
from calstation.records.raw_log import SUFFIX
from calstation.records.raw_read import raw_blocks, read_contents


@dataclass
class Log:
    """A log on disk; samples are streamed, never held.

    Attributes
    ----------
    path, meta, events, results : as stored
    holes : rows of a raw log that cannot be used, known once all samples were read; a gap for whoever reads them
    outcome : how the run ended, None where it did not reach its end or the log is a CSV
    """

    path: Path
    meta: LogMeta
    _scan: Callable[[], Iterator[SampleBlock]]
    events: list[dict[str, Any]] = field(default_factory=list)
    results: list[dict[str, Any]] = field(default_factory=list)
    outcome: str | None = None
    stored_sha256: str | None = None
    holes: tuple[DamagedRows, ...] = ()
    _found: list[DamagedRows] = field(default_factory=list)
    _facts: LogFacts | None = None

    @property
    def name(self) -> str:
        """File name."""
        return self.path.name

    def blocks(self, first_seq: int | None = None, last_seq: int | None = None) -> Iterator[SampleBlock]:
        """Samples from `first_seq` to `last_seq` (both included, unwrapped counts), cut at stage changes.

        Raises
        ------
        InputError
            where the log is damaged, holds rows that cannot be used and are no holes, or has no sample in the range.
        """
        builder = FactsBuilder(self.meta)
        any_sample = False
        self._found.clear()
        for block in self._scan():
            builder.add(block)
            chosen = _between(block, first_seq, last_seq)
            if len(chosen):
                any_sample = True
                yield chosen
        self._keep(builder.facts())
        if not any_sample:
            facts = self.facts()
            raise InputError(
                f"{self.path}: no sample from {'the start' if first_seq is None else first_seq} to"
                f" {'the end' if last_seq is None else last_seq}; the log holds"
                f" {facts.first_seq} to {facts.last_seq}, choose --from and --to in there"
                if facts.samples
                else f"{self.path}: the log holds no samples; record some"
            )

    def facts(self) -> LogFacts:
        """Range, gaps, temperature and sha256 of the whole log, read once."""
        if self._facts is None:
            builder = FactsBuilder(self.meta)
            self._found.clear()
            for block in self._scan():
                builder.add(block)
            self._keep(builder.facts())
        assert self._facts is not None
        return self._facts

    @property
    def first_seq(self) -> int:
        """Unwrapped count of the first sample."""
        return self.facts().first_seq

    @property
    def last_seq(self) -> int:
        """Unwrapped count of the last sample."""
        return self.facts().last_seq

    def sha256(self) -> str:
        """Digest of sample rows and configuration, not of events and stored results."""
        return self.facts().sha256

    def _keep(self, facts: LogFacts) -> None:
        self.holes = tuple(self._found)
        if self.stored_sha256 is not None and not self.holes and facts.sha256 != self.stored_sha256:
            raise InputError(
                f"{self.path}: samples or configuration differ from what the run recorded (sha256);"
                " use an unchanged copy of the log"
            )
        self._facts = replace(facts, damaged=sum(hole.count for hole in self.holes))


def _between(block: SampleBlock, first: int | None, last: int | None) -> SampleBlock:
    start = 0 if first is None else int(block.seq.searchsorted(first, side="left"))
    stop = len(block) if last is None else int(block.seq.searchsorted(last, side="right"))
    if start == 0 and stop == len(block):
        return block
    return block.part(start, max(start, stop))


def open_log(path: Path, meta_file: Path | None = None) -> Log:
    """Open a raw log (.h5) or a CSV (.csv, .csv.gz) with its TOML beside it or at `meta_file`.

    Raises
    ------
    InputError
        where the file is missing, of another kind, or its configuration is wrong.
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
    if not path.name.endswith((".csv", ".csv.gz")):
        raise InputError(f"{path}: not a log; give a raw log ({SUFFIX}) or a .csv(.gz) beside its .toml")
    if not path.is_file():
        raise InputError(f"{path}: no such file; give the path of an existing log")
    meta = load_meta(meta_file or meta_path(path))
    return Log(path, meta, lambda: csv_blocks(path, meta))
