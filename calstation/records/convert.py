"""Export of any log, or of compensated samples, as CSV and TOML."""

import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from calstation.errors import InputError
from calstation.estimation.common import SampleBlock
from calstation.physics import FloatArray
from calstation.records.csv_logs import meta_path, write_csv_log
from calstation.records.facts import LogFacts, pauses_of
from calstation.records.log import Log
from calstation.records.log_formats import open_log
from calstation.records.meta import LogMeta, context_from_meta

#: Corrects angular rate, rad/s, and specific force, m/s², shape (n, 3) each, at temperatures, °C, shape (n,).
Correction = Callable[[FloatArray, FloatArray, FloatArray], tuple[FloatArray, FloatArray]]


def export_csv(
    source: Path,
    target: Path,
    progress: Callable[[int], None] | None = None,
    first_seq: int | None = None,
    last_seq: int | None = None,
) -> LogFacts:
    """Write a log as CSV, with a TOML file next to it; return the facts of the whole log.

    Raises InputError if the log cannot be read or the target cannot be written.

    Parameters
    ----------
    source : log to export
    target : file to write, .csv or .csv.gz
    progress : function that is called with the number of samples written so far
    first_seq, last_seq : first and last sequence number to export; None for the start and the end of the log
    """
    _check_target(target, (source,))
    log = open_log(source)

    def counted() -> Iterator[SampleBlock]:
        done = 0
        for block in log.blocks(first_seq, last_seq):
            yield block
            done += len(block)
            if progress is not None:
                progress(done)

    write_csv_log(target, _with_pauses(log), counted())
    return log.facts()


def export_corrected(
    source: Path | None, meta: LogMeta, blocks: Iterable[SampleBlock], correct: Correction, target: Path
) -> None:
    """Write compensated samples as CSV and TOML: angular rates, rad/s, and specific forces, m/s².

    Parameters
    ----------
    source : log of the samples; None for samples of a connected unit
    meta, blocks : configuration and samples
    correct : function that corrects the samples, see `Correction`
    target : file to write, .csv or .csv.gz

    Raises
    ------
    InputError : if the samples cannot be read or corrected, or the target cannot be written
    """
    _check_target(target, () if source is None else (source, meta_path(source)))
    size = context_from_meta(meta).imu.count_size

    def corrected(block: SampleBlock) -> SampleBlock:
        raw = block.counts * size
        return replace(block, counts=np.hstack(correct(raw[:, :3], raw[:, 3:], block.temperature)))

    unit = {"output": "rate", "gyro_lsb": 1.0, "accel_lsb": 1.0, "gyro_quantisation": 0.0, "accel_quantisation": 0.0}
    imu = meta.imu.model_copy(update=unit)
    pauses = [] if source is None else _with_pauses(open_log(source)).pauses
    sections = {"pauses": pauses, "imu": imu, "prior": {}, "prior_correlation": {}, "registers": {}, "run": None}
    write_csv_log(target, meta.model_copy(update=sections), map(corrected, blocks))


def _with_pauses(log: Log) -> LogMeta:
    """Return the configuration of a log with its pauses, because an exported log has no events."""
    return log.meta.model_copy(update={"pauses": pauses_of(log.events, log.meta)})


def _check_target(target: Path, sources: Iterable[Path]) -> None:
    """Raise InputError if `target` has no CSV suffix, or if the CSV or its TOML would replace one of `sources`."""
    if not target.name.endswith((".csv", ".csv.gz")):
        raise InputError("csv.export_name", file=target)
    for created, source in itertools.product((target, meta_path(target)), sources):
        if created.exists() and source.exists() and created.samefile(source):
            raise InputError("csv.export_onto_itself", file=target)
