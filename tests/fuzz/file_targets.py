"""File readers as fuzzing targets: logs, configurations, journals and results with arbitrary content."""

import atexit
import json
import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from calstation.errors import ConfigurationError, InputError
from calstation.estimation.common import SampleBlock
from calstation.records import LogMeta, RawLogWriter, open_log
from calstation.registers import journal as register_journal
from calstation.results import History

META = LogMeta.model_validate(
    {
        "site": {"latitude_deg": 34.25, "longitude_deg": 108.9, "height_m": 400},
        "imu": {
            "serial": "SN-7",
            "sample_rate_hz": 100.0,
            "output": "increment",
            "gyro_lsb": 5e-08,
            "accel_lsb": 1e-06,
            "gyro_arw": 3e-07,
            "accel_vrw": 5e-05,
        },
    }
)
HEADER = b"seq,time_s,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z,outer_deg,inner_deg,stage,step,valid\n"
ROW = b"7,0.08,1,-2,3,4,5,98000,0.5,,rate,0,1\n"
RESULT: dict[str, Any] = {
    "schema": "calstation.result/1",
    "unit": {"serial": "SN-7"},
    "stages": ["rate"],
    "parameters": {"gyro_bias_x": {"value": 1e-6, "sigma": 1e-7}},
    "outcome": "passed",
    "log": {"file": "a.h5"},
}


@cache
def folder() -> Path:
    """Return a temporary folder that is removed at exit."""
    place = Path(tempfile.mkdtemp(prefix="fuzz"))
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    return place


@cache
def raw_logs() -> tuple[bytes, bytes]:
    """Return a raw log before and after it was closed."""
    path = folder() / "base.h5"
    writer = RawLogWriter(path, META)
    seq = np.arange(200)
    writer.append(
        SampleBlock("rate", seq, (seq + 1) / 100.0, np.ones((200, 6)), np.zeros((200, 2)), seq * 0, seq >= 0, seq * 0.0)
    )
    writer.event({"event": "StageSolved", "stage": "rate"})
    writer.sync()
    left = path.read_bytes()
    writer.close("passed")
    return left, path.read_bytes()


def read_log(path: Path) -> None:
    """Read a complete log, or fail with a one-line error."""
    said = ""
    try:
        for block in open_log(path).blocks():
            assert len(block.seq) == len(block.counts)
    except InputError as error:
        said = str(error)
    assert "\n" not in said


def csv_rows(data: bytes) -> None:
    """Read a CSV log with arbitrary rows or an arbitrary header."""
    path = folder() / "rows.csv"
    path.with_suffix(".toml").write_text(META.to_toml(), encoding="utf-8")
    path.write_bytes(data[1:] if data[:1] > b"\x80" else HEADER + ROW + data)
    read_log(path)


def csv_configuration(data: bytes) -> None:
    """Read a CSV log whose TOML contains arbitrary bytes."""
    path = folder() / "meta.csv"
    path.write_bytes(HEADER + ROW)
    whole = META.to_toml().encode()
    cut = data[0] * len(whole) // 256 if data else 0
    path.with_suffix(".toml").write_bytes(whole[:cut] + data[1:] + whole[cut:])
    read_log(path)


def raw_log(data: bytes) -> None:
    """Read a raw log, closed or not, with changed bytes; each four bytes of `data` are an offset and its new value."""
    log = bytearray(raw_logs()[data[0] & 1 if data else 0])
    for k in range(1, len(data) - 3, 4):
        log[int.from_bytes(data[k : k + 3], "little") % len(log)] = data[k + 3]
    path = folder() / "raw.h5"
    path.write_bytes(log)
    read_log(path)


def journal(data: bytes) -> None:
    """Read a register journal with arbitrary bytes after an entry."""
    runs = folder() / "journal"
    path = runs / register_journal.FOLDER / "SN-7.jsonl"
    path.unlink(missing_ok=True)
    entry = register_journal.begin(runs, "SN-7", {"a": 0.0}, {"a": 1.0}, register_journal.Purpose(None, "run", ""))
    path.write_bytes(path.read_bytes() + data)
    said = ""
    try:
        assert entry.id in [known.id for known in register_journal.history(runs, "SN-7")]
    except ConfigurationError as error:
        said = str(error)
    assert "\n" not in said


def result(data: bytes) -> None:
    """Read a result in which the value of the key at the start of `data` is replaced."""
    runs = folder() / "results"
    runs.mkdir(exist_ok=True)
    (runs / "b.json").write_text(json.dumps({**RESULT, "log": {"file": "b.h5"}}), encoding="utf-8")
    content = json.dumps(RESULT).encode()
    if data:
        key = list(RESULT)[data[0] % len(RESULT)]
        with suppress(ValueError, RecursionError):
            content = json.dumps({**RESULT, key: json.loads(data[1:])}).encode()
    (runs / "a.json").write_bytes(content if data[:1] < b"\xf0" else data)
    history = History(runs)
    history.refresh()
    assert "b" in [run.log.stem for run in history.runs()]


#: All of them by name.
TARGETS: dict[str, Callable[[bytes], None]] = {
    "csv rows": csv_rows,
    "csv configuration": csv_configuration,
    "raw log": raw_log,
    "journal": journal,
    "result": result,
}
