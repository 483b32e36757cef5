"""Import of a CSV into a raw log and export of any log as CSV and TOML; both keep every value exactly."""

import contextlib
import itertools
from collections.abc import Callable, Iterator
from pathlib import Path

from calstation.errors import InputError
from calstation.estimation.common.samples import SampleBlock
from calstation.records.csv_log import meta_path, open_csv_for_writing, write_csv
from calstation.records.facts import LogFacts
from calstation.records.log import open_log
from calstation.records.raw_log import SUFFIX, RawLogWriter


def import_csv(source: Path, target: Path, meta_file: Path | None = None) -> LogFacts:
    """Write the raw log `target` from a CSV; nothing remains of it where the CSV is not usable."""
    if target.suffix != SUFFIX:
        raise InputError(f"{target}: a raw log's name ends in {SUFFIX}; rename the target")
    log = open_log(source, meta_file)
    blocks = log.blocks()
    first = next(blocks)  # a log without samples is told as such
    writer = RawLogWriter(target, log.meta, joints=first.joints.shape[1] > 0)
    try:
        for block in itertools.chain([first], blocks):
            writer.append(block)
    except BaseException:
        with contextlib.suppress(OSError, RuntimeError):  # what failed may be the disk
            writer.close("incomplete")
        target.unlink()
        raise
    return writer.close("imported")


def partial_path(target: Path) -> Path:
    """Where a file is written before it takes its name."""
    return target.with_name("partial-" + target.name)


def export_csv(
    source: Path,
    target: Path,
    progress: Callable[[int], None] | None = None,
    first_seq: int | None = None,
    last_seq: int | None = None,
) -> LogFacts:
    """Write a log as `target` (.csv or .csv.gz) and the TOML beside it; returns the facts of the whole log.

    first_seq, last_seq : range written, both included, None for the log's own ends
    progress : told the samples written so far
    """
    if not target.name.endswith((".csv", ".csv.gz")):
        raise InputError(f"{target}: an export's name ends in .csv or .csv.gz; rename the target")
    log = open_log(source)
    if target.exists() and target.samefile(source):
        raise InputError(f"{target}: is the log itself; choose another name")
    partial = partial_path(target)
    try:
        with open_csv_for_writing(partial) as stream:
            blocks = log.blocks(first_seq, last_seq)
            write_csv(stream, blocks if progress is None else _counted(blocks, progress))
        meta_path(target).write_text(log.meta.to_toml(), encoding="utf-8")
        partial.replace(target)
    finally:
        with contextlib.suppress(FileNotFoundError):
            partial.unlink()
    return log.facts()


def _counted(blocks: Iterator[SampleBlock], progress: Callable[[int], None]) -> Iterator[SampleBlock]:
    done = 0
    for block in blocks:
        yield block
        done += len(block)
        progress(done)
