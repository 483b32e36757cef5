"""Writer of the CSV format of docs/contract.md, whose values are read back exactly."""

import gzip
import itertools
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO

import numpy as np

from calstation.errors import InputError
from calstation.estimation.common import SampleBlock, has_gyros, snap_angles
from calstation.messages import os_reason
from calstation.physics import CHANNELS, FloatArray
from calstation.records.columns import ANGLES, CHAMBER, JOINTS, STATION, further_channels
from calstation.records.csv_logs.csv_log import meta_path
from calstation.records.files import partial_path, write_atomic
from calstation.records.meta import FURTHER_IMUS, LogMeta


def write_csv_log(target: Path, meta: LogMeta, blocks: Iterator[SampleBlock]) -> None:
    """Write blocks as CSV, and their configuration next to it; a failure leaves no CSV. Raises InputError."""
    partial = partial_path(target)
    try:
        with _open_for_writing(partial) as stream:
            _write_csv(stream, blocks)
        write_atomic(meta_path(target), meta.to_toml())
        partial.replace(target)
    except OSError as exc:
        raise InputError("csv.not_written", file=target, reason=os_reason(exc)) from exc
    finally:
        with suppress(OSError):
            partial.unlink()


def _write_csv(stream: IO[str], blocks: Iterator[SampleBlock]) -> None:
    """Write blocks in the CSV format of docs/contract.md; all values are read back exactly."""
    first = next(blocks, None)
    secondaries = 0 if first is None else first.others.shape[1]
    channels = [i for i in range(6) if first is None or i >= 3 or has_gyros(first.counts)]
    names = ["seq", "time_s", *(CHANNELS[i] for i in channels), *ANGLES, "stage", "step", "temp_c", "valid"]
    names += [name for number in FURTHER_IMUS[:secondaries] for name in further_channels(number)]
    names += JOINTS if first is not None and first.joints.shape[1] else ()
    names += [STATION] if first is not None and first.station.shape[1] else []
    names += [CHAMBER] if first is not None and first.chamber.shape[1] else []
    stream.write(",".join(names) + "\n")
    for block in itertools.chain([] if first is None else [first], blocks):
        degrees = _shortest_degrees(block.angles)
        columns: list[list[str]] = [
            [str(v) for v in block.seq.tolist()],
            [repr(v) for v in block.time.tolist()],
            *[_numbers(block.counts[:, i]) for i in channels],
            *[_blank_nan(degrees[:, i]) for i in range(2)],
            [block.stage] * len(block),
            [str(v) for v in block.step.tolist()],
            _blank_nan(block.temperature),
            ["1" if v else "0" for v in block.valid.tolist()],
        ]
        columns += [_numbers(column) for column in block.others.reshape(len(block), -1).T]
        optional = (*_shortest_degrees(block.joints).T, *block.station.T, *block.chamber.T)
        columns += [_blank_nan(column) for column in optional]
        stream.write("".join(map("{}\n".format, map(",".join, zip(*columns, strict=True)))))


def _shortest_degrees(angles: FloatArray) -> FloatArray:
    """Return `angles`, rad, in degrees, rounded to ten decimals if they are read back unchanged."""
    exact = np.rad2deg(angles)
    short = np.round(exact, 10)
    return np.where(snap_angles(np.deg2rad(short)) == angles, short, exact)


def _numbers(values: FloatArray) -> list[str]:
    present = ~np.isnan(values)
    if np.array_equal(values[present], np.rint(values[present])) and np.all(np.abs(values[present]) < 2**53):
        integers = np.where(present, values, 0.0).astype(np.int64)
        return [str(v) if t else "" for v, t in zip(integers.tolist(), present.tolist(), strict=True)]
    return _blank_nan(values)


def _blank_nan(values: FloatArray) -> list[str]:
    return ["" if v != v else repr(v) for v in values.tolist()]


def _open_for_writing(path: Path) -> IO[str]:
    """Open NAME.csv or NAME.csv.gz for writing text. Raises OSError."""
    if path.suffix == ".gz":
        return gzip.open(path, "wt", encoding="utf-8", newline="")
    return path.open("w", encoding="utf-8", newline="")
