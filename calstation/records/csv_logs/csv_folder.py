"""A folder of CSV files as one log: one file for each position, in the order of their names."""

import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from calstation.errors import InputError
from calstation.estimation.common import SampleBlock
from calstation.messages import os_reason
from calstation.records.clock import TimeReport
from calstation.records.columns import unit_factor, unit_factors
from calstation.records.csv_logs.csv_log import CSV_SUFFIXES, load_recording, meta_path, with_quantisation
from calstation.records.csv_logs.csv_table import csv_tables
from calstation.records.log import DamagedRows, Log
from calstation.records.meta import LogMeta
from calstation.records.recording import Recording

#: Time inserted between two files, s, if the time stamps of the second file do not continue those of the first.
_PAUSE = 1.0


def csv_files(folder: Path) -> list[Path]:
    """Return the CSV files of a folder, sorted by name, with numbers sorted by value. Raises InputError."""
    try:
        files = [path for path in folder.iterdir() if path.name.endswith(CSV_SUFFIXES)]
    except OSError as exc:
        raise InputError("log.unreadable", file=folder, reason=os_reason(exc)) from exc
    return sorted(files, key=lambda path: [int(x) if k % 2 else x for k, x in enumerate(re.split(r"(\d+)", path.name))])


def open_folder(path: Path, meta_file: Path | None = None) -> Log:
    """Open the CSV files of a folder, with NAME.toml next to the folder or at `meta_file`, as one log.

    Every file is a step of the log; a gap precedes it, unless its times continue those of the file before. Raises
    InputError if a file is invalid.
    """
    files = csv_files(path)
    if not files:
        raise InputError("csv.empty_folder", file=path)
    meta, layouts = load_recording(files, meta_file or meta_path(path))
    reads = [
        partial(csv_tables, file, layout, unit_factors(layout, meta))
        for file, layout in zip(files, layouts, strict=True)
    ]
    meta = with_quantisation(meta, lambda: itertools.chain.from_iterable(read() for read in reads))
    recordings = [
        Recording(file, meta, read, unit_factor("time_s", layout.units.get("time_s", "s")))
        for file, read, layout in zip(files, reads, layouts, strict=True)
    ]
    report, damaged = TimeReport(), list[DamagedRows]()
    blocks = partial(_joined, recordings, meta, report, damaged)
    sources, unused = layouts[0].sources, layouts[0].unused
    return Log(path, meta, blocks, times=report, columns=sources, unused=unused, _damaged=damaged)


def _joined(
    recordings: Sequence[Recording], meta: LogMeta, report: TimeReport, damaged: list[DamagedRows]
) -> Iterator[SampleBlock]:
    """Yield the samples of all files with one counter and one clock; fill `report` and `damaged`."""
    report.reset()
    damaged.clear()
    period, next_seq, last = 1.0 / meta.imu.sample_rate_hz, 0, 0.0
    offset = 0.0
    for step, recording in enumerate(recordings):
        before, start, shift = next_seq, None, 0
        for block in recording.blocks():
            if start is None:
                start = float(block.time[0])
                pause = start + offset - last
                if step and not 0.5 * period < pause:
                    offset, pause = last + _PAUSE - start, _PAUSE
                shift = before + (round(pause / period) - 1 if step else 0) - int(block.seq[0])
            moved = replace(block, seq=block.seq + shift, time=block.time + offset, step=np.full(len(block), step))
            next_seq, last = int(moved.seq[-1]) + 1, float(moved.time[-1])
            yield moved
        report.add(recording.report)
        damaged += [part.shifted(shift) for part in recording.damaged]
