"""Helpers shared by the tests of all packages."""

import json
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from calstation.errors import CalstationError
from calstation.physics import FloatArray, TableGeometry, rotation_vector
from calstation.records import LogFacts, open_log, write_log
from calstation.records.raw.raw_log import FORMAT, row_dtype
from calstation.schema import EntryError


@contextmanager
def raises_code(
    kind: type[CalstationError] | type[EntryError], code: str
) -> Iterator["pytest.ExceptionInfo[CalstationError | EntryError]"]:
    """Expect an error of a class with a code of the message catalogue; yield pytest's exception info."""
    with pytest.raises(kind) as caught:
        yield caught
    assert caught.value.code == code, f"{caught.value.code or 'no code'}: {caught.value}"


def error_code(error: CalstationError) -> str:
    """Return entry and code of the first problem reported by a loader, e.g. ``link.baud entry.missing``."""
    what = error.values["what"]
    if what.code == "entry.at":
        return f"{what.values['field']} {what.values['what'].code}"
    return str(what.code)


def sampled(every: int, *choices: Iterable[Any]) -> list[Any]:
    """Return all combinations of the choices as parameters; only every `every`-th runs outside ``make exhaustive``."""
    return [
        pytest.param(*chosen, marks=[pytest.mark.exhaustive] if number % every else [])
        for number, chosen in enumerate(product(*choices))
    ]


def convert_log(source: Path, target: Path) -> LogFacts:
    """Convert a log of any format to the raw log `target`."""
    log = open_log(source)
    return write_log(target, log.meta, log.blocks())


class Progress:
    """A `ProgressCallback` that records its calls."""

    def __init__(self) -> None:
        self.fractions: list[float] = []
        self.notes: list[str] = []

    def __call__(self, fraction: float, remaining_s: float | None = None, note: str = "") -> None:
        self.fractions.append(fraction)
        self.notes.append(note)


def ignore_progress(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
    """A `ProgressCallback` that does nothing."""


def joint_axis(geometry: TableGeometry, joint: int, inner: float) -> FloatArray:
    """Return the axis of a joint in b at an inner angle (rad), from attitudes before and after a 0.5 rad rotation."""
    before, after = geometry.body_to_home(0.0, inner), geometry.body_to_home(0.5 * (joint == 0), inner + 0.5 * joint)
    return np.asarray(rotation_vector(before.T @ after) / 0.5)


def exchange_logs(one: Path, other: Path) -> None:
    """Exchange the logs of the runs with two result files."""
    first, second = one.with_suffix(".h5"), other.with_suffix(".h5")
    aside = first.with_suffix(".aside")
    first.rename(aside)
    second.rename(first)
    aside.rename(second)


def write_log_of(result_file: Path) -> None:
    """Write a log without samples next to a result file, which contains this result."""
    content = json.dumps(json.loads(result_file.read_text(encoding="utf-8"))) + "\n"
    with h5py.File(result_file.with_suffix(".h5"), "w", libver="latest") as file:
        file.attrs["format"] = np.bytes_(FORMAT)
        file.attrs["meta_crc32"] = np.uint32(0)
        file.create_dataset("samples", (0,), row_dtype(0, joints=False), maxshape=(None,), chunks=(1024,))
        file.create_dataset("results", data=np.frombuffer(content.encode(), np.uint8))
        for name in ("meta", "events", "closing"):
            file.create_dataset(name, (0,), np.uint8, maxshape=(None,), chunks=(1024,))
        file.create_dataset("stages", (0,), "S64", maxshape=(None,), chunks=(16,))
