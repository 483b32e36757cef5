"""Checks of a recording of two IMUs: no paired samples, frozen channels, no motion, wrong units, wrong axes."""

import numpy as np

from calstation.errors import InputError, InsufficientDataError
from calstation.estimation.pairs.filtering import PairData
from calstation.estimation.pairs.fit import ACCEL_MATRIX, GYRO_MATRIX, PairChoice, PairFit
from calstation.estimation.positions import frozen_columns
from calstation.physics import AXES, FloatArray, rotation_vector

#: Shortest total time with samples of both IMUs, s.
MIN_PAIRED_TIME = 5.0
#: Smallest rms rate, rad/s, about the axis of least rotation that determines a matrix.
MIN_RATE = np.deg2rad(3.0)
#: Smallest rms change of specific force, m/s², along the axis of least change that determines a matrix.
MIN_FORCE = 0.5
#: Largest singular value of a matrix that is plausible as a scale factor; a larger one indicates a wrong unit.
UNIT = 1.5
#: Largest angle between the axes of gyro and accelerometer of one IMU, rad.
TOGETHER = np.deg2rad(10.0)


def require_pairs(data: PairData, number: int, choice: PairChoice) -> None:
    """Check that the samples determine the chosen terms. Raises InputError or InsufficientDataError."""
    paired = sum(stop - start for start, stop in data.segments) * data.dt
    if paired < MIN_PAIRED_TIME:
        raise InsufficientDataError("recording.too_few_pairs", number=number, seconds=paired, least=MIN_PAIRED_TIME)
    rows = np.concatenate([np.arange(start, stop) for start, stop in data.segments])
    columns: dict[str, FloatArray] = {
        "gyro": data.gyro[rows],
        "accel": data.accel[rows],
        f"gyro{number}": data.gyro2[rows],
        f"accel{number}": data.accel2[rows],
    }
    names = [f"{sensor}_{axis}" for sensor in columns for axis in AXES]
    for name, first, last in frozen_columns(names, np.hstack(list(columns.values())), data.dt):
        raise InputError(
            "recording.frozen_at_time",
            channel=name,
            seconds=(last - first) * data.dt,
            start=float(data.time[rows[first]]),
        )
    if choice.gyro in ("scale", "full") or choice.offset:
        _require_spread(data.gyro[rows], MIN_RATE, choice.gyro == "full", tilting=False)
    if choice.accel in ("scale", "full"):
        _require_spread(data.accel[rows], MIN_FORCE, choice.accel == "full", tilting=True)


def _require_spread(values: FloatArray, least: float, every_axis: bool, tilting: bool) -> None:
    spread, axes = np.linalg.eigh(np.cov(values.T))
    size = np.sqrt(np.maximum(spread, 0.0))
    if size[-1] < least:
        raise InsufficientDataError("recording.no_tilting" if tilting else "recording.no_turning")
    if every_axis and size[0] < least:
        axis = AXES[int(np.argmax(np.abs(axes[:, 0])))]
        raise InsufficientDataError(
            "recording.little_tilting" if tilting else "recording.little_turning",
            axis=axis,
            share=float(size[0] / size[-1]),
        )


def require_sense(fit: PairFit, number: int, choice: PairChoice) -> None:
    """Check that the matrices are plausible as sensor errors and not due to swapped columns. Raises InputError."""
    turns = []
    for sensor, model, columns in (("gyro", choice.gyro, GYRO_MATRIX), ("accel", choice.accel, ACCEL_MATRIX)):
        if model not in ("scale", "full"):
            continue
        C = fit.value[columns].reshape(3, 3)
        U, lengths, V = np.linalg.svd(C)
        if not 1.0 / UNIT < lengths[-1] <= lengths[0] < UNIT:
            ratio = float(np.exp(np.mean(np.log(lengths))))
            raise InputError("recording.pair_unit", number=number, sensor=sensor, ratio=ratio)
        if np.linalg.det(C) < 0.0:
            raise InputError("recording.pair_mirrored", number=number, sensor=sensor)
        turns.append(U @ V)
    if len(turns) == 2:
        apart = float(np.linalg.norm(rotation_vector(turns[0] @ turns[1].T)))
        if apart > TOGETHER:
            angle = float(np.rad2deg(apart))
            raise InputError("recording.pair_sensors_apart", number=number, angle_deg=angle)
