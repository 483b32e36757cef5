"""A log on disk, regardless of its file format (see `log_formats`)."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from calstation.errors import InputError
from calstation.estimation.common import SampleBlock
from calstation.messages import Text
from calstation.parsing import read_json
from calstation.records.clock import TimeReport
from calstation.records.facts import FactsBuilder, LogFacts
from calstation.records.meta import LogMeta

#: Largest number of damaged intervals listed in a message.
_MAX_LISTED = 6


@dataclass(frozen=True)
class DamagedRows:
    """Consecutive damaged rows, which are omitted and thus form a gap."""

    row: int  #: Number of the first row, from 0.
    count: int  #: Number of rows.
    after: int | None  #: Sequence number of the preceding intact sample; None at the start of the log.
    before: int | None  #: Sequence number of the following intact sample; None at the end of the log.

    def shifted(self, shift: int) -> "DamagedRows":
        """Return the rows with `shift` added to the sequence numbers."""
        after, before = (None if seq is None else seq + shift for seq in (self.after, self.before))
        return replace(self, after=after, before=before)

    @property
    def missing(self) -> str:
        """Text with the first and the last missing sequence number, as far as they are known."""
        first = "" if self.after is None else f"{self.after + 1}"
        last = "" if self.before is None else f"{self.before - 1}"
        if self.after is not None and self.before == self.after + 1:  # the counter shows no gap
            return f"{self.after}/{self.before}"
        return f"{first}…{last}"


def damage_summary(damaged: Sequence[DamagedRows]) -> dict[str, int | str]:
    """Return the values for a message about damaged rows: their number, and the first missing intervals."""
    intervals = [part.missing for part in damaged[:_MAX_LISTED]] + ["…"] * (len(damaged) > _MAX_LISTED)
    return {"rows": sum(part.count for part in damaged), "where": ", ".join(intervals)}


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
    #: Sources of the columns of a file of another program, with their units; empty for the project's own formats.
    columns: Mapping[str, str] = field(default_factory=dict)
    #: Columns of a file of another program that are not used.
    unused: tuple[str, ...] = ()
    topics: tuple[str, ...] = ()  #: Topics of a file of another program, with their types and numbers of messages.
    _damaged: list[DamagedRows] = field(default_factory=list)
    #: Irregularities of the time stamps of a recording; known after all samples have been read.
    times: TimeReport = field(default_factory=TimeReport)
    _facts: LogFacts | None = None

    def blocks(self, first_seq: int | None = None, last_seq: int | None = None) -> Iterator[SampleBlock]:
        """Yield the samples from `first_seq` to `last_seq` (unwrapped, both included), split at stage changes.

        Raises InputError if the log has damage other than damaged rows, or has no sample in the range.
        """
        any_sample = False
        for block in self._all_blocks():
            selected = _between(block, first_seq, last_seq)
            if len(selected):
                any_sample = True
                yield selected
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

    def facts(self, first_seq: int | None = None, last_seq: int | None = None) -> LogFacts:
        """Return the facts of the samples from `first_seq` to `last_seq` (both included), with the whole log's sha256.

        The whole log is read only once. Raises the errors of `blocks`.
        """
        while self._facts is None:
            for _ in self._all_blocks():
                pass
        whole = self._facts
        starts = first_seq is None or first_seq <= whole.first_seq
        if starts and (last_seq is None or last_seq >= whole.last_seq):
            return whole
        builder = FactsBuilder(self.meta)
        for block in self.blocks(first_seq, last_seq):
            builder.add(block)
        return replace(builder.facts(), sha256=whole.sha256, damaged=whole.damaged)

    def _all_blocks(self) -> Iterator[SampleBlock]:
        """Yield all samples; at the end, set damaged rows and facts. Raises InputError."""
        builder = FactsBuilder(self.meta)
        self._damaged.clear()
        for block in self._scan():
            builder.add(block)
            yield block
        facts = builder.facts()
        self.damaged_rows = tuple(self._damaged)
        if self.stored_sha256 is not None and not self.damaged_rows and facts.sha256 != self.stored_sha256:
            raise InputError("log.altered", file=self.path)
        self._facts = replace(facts, damaged=sum(part.count for part in self.damaged_rows))


def _between(block: SampleBlock, first: int | None, last: int | None) -> SampleBlock:
    start = 0 if first is None else int(block.seq.searchsorted(first, side="left"))
    stop = len(block) if last is None else int(block.seq.searchsorted(last, side="right"))
    if start == 0 and stop == len(block):
        return block
    return block.part(start, max(start, stop))


def truth_path(path: Path) -> Path:
    """Return the path of the file with the true parameters of a simulated recording."""
    return path.with_suffix(".truth.json")


def read_truth(path: Path) -> dict[str, float]:
    """Read the true parameters of a simulated recording, SI; empty for a recording of a real unit."""
    try:
        values = read_json(truth_path(path))
        return {str(name): float(value) for name, value in values.items()}
    except (OSError, ValueError, AttributeError, TypeError):
        return {}
