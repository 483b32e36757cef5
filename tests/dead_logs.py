"""Logs of runs whose process died."""

import os
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from calstation.estimation.common import SampleBlock
from calstation.records import LogMeta, RawLogWriter
from calstation.sequencer import Event, to_json
from procedures import method
from tests.site_folder import PRODUCT

NOW = datetime.now(UTC).replace(microsecond=0)
STAGES = ("rate", "six_position")
META: dict[str, Any] = {
    "site": {"latitude_deg": 34.25, "longitude_deg": 108.9, "height_m": 400, "azimuth_deg": 0.0},
    "imu": {
        "serial": "SN-000003",
        "sample_rate_hz": 100.0,
        "output": "increment",
        "gyro_lsb": 1e-8,
        "accel_lsb": 1e-6,
        "gyro_arw": 1e-7,
        "accel_vrw": 5e-5,
    },
    "run": {"stages": list(STAGES), "operator": "Li Wei", "software": "0.1"},
}


def write_dead_log(
    folder: Path,
    serial: str = "SN-000003",
    solved: int = 1,
    events: Sequence[Event] = (),
    hours_ago: float = 1.0,
    **run: Any,
) -> Path:
    """Write the log of a run that was killed, after it had solved the first of its two stages.

    Parameters
    ----------
    folder, serial
        Folder of runs, and serial number of the unit.
    solved
        Number of solved stages.
    events
        Events after them.
    hours_ago
        Time since its start, h.
    run
        Entries of ``[run]``.
    """
    started = NOW - timedelta(hours=hours_ago)
    folder.mkdir(exist_ok=True)
    path = folder / f"{serial}_{started:%Y%m%dT%H%M%S%f}.h5"
    schedule = {name: method(name).schedule(**PRODUCT["schedule"][name]).model_dump(mode="json") for name in STAGES}
    meta = {
        **META,
        "imu": {**META["imu"], "serial": serial},
        "run": {**META["run"], **run, "started_utc": started.isoformat()},
        "schedule": schedule,
    }
    writer = RawLogWriter(path, LogMeta.model_validate(meta))
    for k, stage in enumerate(STAGES):
        seq = np.arange(100 * k, 100 * k + 100, dtype=np.int64)
        ones = np.ones(100)
        writer.append(
            SampleBlock(
                stage,
                seq,
                (seq + 1) / 100.0,
                np.zeros((100, 6)),
                np.zeros((100, 2)),
                np.full(100, k, np.int64),
                ones > 0,
                25.0 * ones,
            )
        )
        if k < solved:
            at = {"station_time": 5.0, "utc": started.isoformat()}
            event = {"event": "StageSolved", "stage": stage, "parameters": {}, "consistency": {"passed": True}}
            writer.event({**at, **event})
    for each in events:
        writer.event({"station_time": 6.0, "utc": started.isoformat(), **to_json(each)})
    writer.flush()
    writer._file.close()
    os.close(writer._sync_handle)
    return path
