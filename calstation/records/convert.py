"""Import of a CSV into a raw log, and export of any log as CSV and TOML; both preserve every value exactly."""

import contextlib
import itertools
from collections.abc import Callable, Iterator
from pathlib import Path

from calstation.errors import InputError
from calstation.estimation.common import SampleBlock
from calstation.records.csv_log import meta_path, open_csv_for_writing, write_csv
from calstation.records.facts import LogFacts
from calstation.records.log import open_log
from calstation.records.raw_log import SUFFIX, RawLogWriter


def import_csv(source: Path, target: Path, meta_file: Path | None = None) -> LogFacts:
    """Write a CSV to the raw log `target`, which is deleted if the CSV is not usable.

    The configuration is the TOML file beside the CSV or `meta_file`. Raises InputError or ConfigurationError.
    """
    if target.suffix != SUFFIX:
        raise InputError("csv.import_name", file=target, suffix=SUFFIX)
    log = open_log(source, meta_file)
    blocks = log.blocks()
    first = next(blocks)  # raises for a log without samples
    writer = RawLogWriter(target, log.meta, joints=first.joints.shape[1] > 0)
    try:
        for block in itertools.chain([first], blocks):
            writer.append(block)
    except BaseException:
        with contextlib.suppress(OSError, RuntimeError):  # the disk may have failed
            writer.close("incomplete")
        target.unlink()
        raise
    return writer.close("imported")


def partial_path(target: Path) -> Path:
    """Return the name of a file while it is being written."""
    return target.with_name("partial-" + target.name)


def export_csv(
    source: Path,
    target: Path,
    progress: Callable[[int], None] | None = None,
    first_seq: int | None = None,
    last_seq: int | None = None,
) -> LogFacts:
    """Write a log, or its samples `first_seq` to `last_seq`, to `target` (.csv or .csv.gz) and a TOML file beside it.

    `progress` is called with the number of samples written so far. Returns the facts of the whole log. Raises
    InputError if the log cannot be read or the target cannot be written.
    """
    if not target.name.endswith((".csv", ".csv.gz")):
        raise InputError("csv.export_name", file=target)
    log = open_log(source)
    if target.exists() and target.samefile(source):
        raise InputError("csv.export_onto_itself", file=target)
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
