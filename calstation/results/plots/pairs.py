"""Plot data of IMUs on one body: their residuals over time, and the stored calibrations."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from calstation.config import pair_folder
from calstation.estimation.common import Posterior, SolveContext, StageData, StoredCrossCalibration
from calstation.estimation.pairs import (
    ACCEL_BIAS,
    ACCEL_MATRIX,
    GYRO_BIAS,
    GYRO_MATRIX,
    LEVER,
    OFFSET,
    PairCalibration,
    PairData,
    PairSchedule,
    WatchEvent,
    check_values,
    pair_data,
    pair_vector,
    signals,
)
from calstation.messages import values_from_json
from calstation.physics import Compensation, FloatArray, compensation
from calstation.records import load_pair, pair_path

#: Number of time bins of the residuals.
_COLUMNS = 800


@dataclass(frozen=True)
class PairResiduals:
    """Rms residuals of a secondary's sensor relative to the primary by time bin."""

    time: FloatArray  #: Bin centres, time since the start of the recording, s, shape (k,).
    before: FloatArray  #: Rms with the stored calibration, rad/s or m/s², shape (k,).
    after: FloatArray  #: Rms with the new calibration, rad/s or m/s², shape (k,).
    rms: tuple[float, float]  #: Rms over the whole recording, before and after.


@dataclass(frozen=True)
class StoredPairFile:
    """The stored calibration of a pair."""

    number: int
    serial: str
    file: Path
    utc: str  #: Time of the calibration; empty if there is none.
    values: int  #: Number of stored values.
    #: Residuals of gyro (rad/s) and accel (m/s²) at rest immediately after the calibration, None if unknown.
    static: Mapping[str, float | None]


@dataclass(frozen=True)
class SecondaryPlotData:
    """One secondary: its number, residuals of both sensors, and check at rest."""

    number: int
    serial: str
    residuals: Mapping[str, PairResiduals]
    #: Result of `estimation.pairs.watch.check_values` with the stored calibration; None if the body was never at rest.
    check: Mapping[str, Any] | None
    #: Residuals of gyro (rad/s) and accel (m/s²) at rest with the new values, None if unknown.
    static: Mapping[str, float | None]


@dataclass(frozen=True)
class PairPlotData:
    """All secondaries of a recording, and their stored calibrations."""

    primary: str
    secondaries: tuple[SecondaryPlotData, ...]
    stored: tuple[StoredPairFile, ...]
    events: tuple[WatchEvent, ...]  #: Events of a triggered calibration, with the time since the start.
    duration: float  #: Duration of the recording, s.


def pair_plot_data(
    data: StageData, context: SolveContext, prior: Posterior, details: Mapping[str, Any], schedule: Mapping[str, Any]
) -> PairPlotData:
    """Compute the plot data from the stage's samples, the details of its result, and its schedule.

    A pair with a calibration stored in the site's folder is checked at the last rest with it instead of the one in the
    log.
    """
    c, folder = compensation(prior.mean), pair_folder()
    calibration = PairCalibration(context, prior, PairSchedule.model_validate(schedule))
    rest = calibration.last_rest(data)
    secondaries = []
    for i, (secondary, row) in enumerate(zip(context.secondaries, details["secondaries"], strict=True)):
        pair = pair_data(data, i, secondary.imu)
        fitted = StoredCrossCalibration(row["stored"]["values"])
        residuals = _residuals(pair, c, pair_vector(secondary.stored), pair_vector(fitted)) if "fit" in row else {}
        static = {sensor: row["stored"][f"{sensor}_static"] for sensor in ("gyro", "accel")}
        check = row["check"]
        stored = load_pair(folder, context.imu.serial, secondary.imu.serial)
        if rest is not None and stored.values:
            with_stored = calibration.check(data, rest, i, secondary, stored)
            check = check if with_stored is None else check_values(with_stored)
        secondaries.append(SecondaryPlotData(secondary.number, secondary.imu.serial, residuals, check, static))
    begin = float(data.time[0])
    events = []
    for row in details["events"]:
        values = {key: value for key, value in row.items() if key not in ("kind", "time", "number")}
        events.append(WatchEvent(row["kind"], row["time"] - begin, row["number"], values_from_json(values)))
    return PairPlotData(
        context.imu.serial,
        tuple(secondaries),
        stored_pairs(context, folder),
        tuple(events),
        float(data.time[-1]) - begin,
    )


def stored_pairs(context: SolveContext, folder: Path) -> tuple[StoredPairFile, ...]:
    """Return the calibrations of a recording's pairs in `folder`. Raises InputError for a damaged file."""
    files = []
    for s in context.secondaries:
        file = pair_path(folder, context.imu.serial, s.imu.serial)
        stored = load_pair(folder, context.imu.serial, s.imu.serial)
        utc = datetime.fromtimestamp(file.stat().st_mtime, UTC).isoformat(timespec="seconds") if stored.values else ""
        files.append(StoredPairFile(s.number, s.imu.serial, file, utc, len(stored.values), stored.static))
    return tuple(files)


def _residuals(data: PairData, c: Compensation, before: FloatArray, after: FloatArray) -> dict[str, PairResiduals]:
    """Return the residuals in the pass band of the fit, with the stored and the new values."""
    rows, parts = [], []
    for value in (before, after):
        filtered = signals(data, float(value[OFFSET]), c)
        gyro = filtered.gyro2 - filtered.gyro @ value[GYRO_MATRIX].reshape(3, 3).T - value[GYRO_BIAS]
        force = filtered.accel + filtered.lever @ value[LEVER]
        accel = filtered.accel2 - force @ value[ACCEL_MATRIX].reshape(3, 3).T - value[ACCEL_BIAS]
        rows.append(filtered.row)
        parts.append({"gyro": np.sum(gyro**2, axis=1), "accel": np.sum(accel**2, axis=1)})
    begin, end = float(data.time[0]), float(data.time[-1])
    edges = np.linspace(begin, end + data.dt, _COLUMNS + 1)
    residuals = {}
    for sensor in ("gyro", "accel"):
        columns = [_rms(data.time[row], part[sensor], edges) for row, part in zip(rows, parts, strict=True)]
        rms = [float(np.sqrt(part[sensor].mean())) if len(part[sensor]) else 0.0 for part in parts]
        middle = 0.5 * (edges[1:] + edges[:-1]) - begin
        residuals[sensor] = PairResiduals(middle, columns[0], columns[1], (rms[0], rms[1]))
    return residuals


def _rms(time: FloatArray, square: FloatArray, edges: FloatArray) -> FloatArray:
    """Return the square root of the mean of `square` in each bin, NaN without samples, shape (k,)."""
    total, _ = np.histogram(time, edges, weights=square)
    count, _ = np.histogram(time, edges)
    mean = np.divide(total, count, out=np.full(len(total), np.nan), where=count > 0)
    return np.asarray(np.sqrt(mean))
