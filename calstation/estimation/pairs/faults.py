"""What makes a recording of two IMUs worthless, named: nothing paired, frozen channels, no motion, units, axes."""

import numpy as np

from calstation.errors import InputError, InsufficientDataError
from calstation.estimation.pairs.fit import ACCEL_MATRIX, GYRO_MATRIX, PairChoice, PairFit
from calstation.estimation.pairs.signals import PairData
from calstation.estimation.positions.recording_faults import frozen_columns
from calstation.physics.arrays import FloatArray
from calstation.physics.rotation import rotation_vector

#: Less paired time than this, s, is no recording.
LEAST_PAIRS = 5.0
#: Rms rate about the axis turned least below which a matrix is not determined, rad/s.
LEAST_RATE = np.deg2rad(3.0)
#: Rms change of specific force along the axis on which it changes least, m/s².
LEAST_FORCE = 0.5
#: A matrix that lengthens or shortens by more than this has other units, not another scale factor.
UNIT = 1.5
#: Gyro and accelerometer of one unit lie the same way to within this, rad.
TOGETHER = np.deg2rad(10.0)


def require_pairs(data: PairData, number: int, choice: PairChoice) -> None:
    """Raise InputError or InsufficientDataError where the rows cannot tell what `choice` asks for."""
    paired = sum(stop - start for start, stop in data.segments) * data.dt
    if paired < LEAST_PAIRS:
        raise InsufficientDataError(
            f"imu{number}: {paired:.1f} s of synchronous samples with the primary; record both for "
            f"{LEAST_PAIRS:.0f} s or more"
        )
    rows = np.concatenate([np.arange(start, stop) for start, stop in data.segments])
    columns: dict[str, FloatArray] = {
        "gyro": data.gyro[rows],
        "accel": data.accel[rows],
        f"gyro{number}": data.gyro2[rows],
        f"accel{number}": data.accel2[rows],
    }
    names = [f"{sensor}_{axis}" for sensor in columns for axis in "xyz"]
    for name, first, last in frozen_columns(names, np.hstack(list(columns.values())), data.dt):
        raise InputError(
            f"{name} is frozen for {(last - first) * data.dt:.1f} s from {data.time[rows[first]]:.1f} s on; check the "
            "unit and its cable and record again"
        )
    if choice.gyro in ("scale", "full") or choice.offset:
        _require_spread(data.gyro[rows], LEAST_RATE, "turn the body", choice.gyro == "full")
    if choice.accel in ("scale", "full"):
        _require_spread(data.accel[rows], LEAST_FORCE, "tilt or shake the body", choice.accel == "full")


def _require_spread(values: FloatArray, least: float, ask: str, every_axis: bool) -> None:
    spread, axes = np.linalg.eigh(np.cov(values.T))
    size = np.sqrt(np.maximum(spread, 0.0))
    if size[-1] < least:
        raise InsufficientDataError(f"no motion in the recording; {ask} about all axes")
    if every_axis and size[0] < least:
        axis = "xyz"[int(np.argmax(np.abs(axes[:, 0])))]
        raise InsufficientDataError(
            f"hardly any motion about {axis} ({size[0] / size[-1]:.1%} of that about others), so nothing is determined "
            f"there; {ask} about {axis} too"
        )


def require_sense(fit: PairFit, number: int, choice: PairChoice) -> None:
    """Raise InputError where the answer is no error of a unit but of its columns."""
    turns = []
    for sensor, model, place in (("gyro", choice.gyro, GYRO_MATRIX), ("accel", choice.accel, ACCEL_MATRIX)):
        if model not in ("scale", "full"):
            continue
        C = fit.value[place].reshape(3, 3)
        U, lengths, V = np.linalg.svd(C)
        if not 1.0 / UNIT < lengths[-1] <= lengths[0] < UNIT:
            raise InputError(
                f"imu{number}: its {sensor} measures {np.exp(np.mean(np.log(lengths))):.4g} times what the primary's "
                f"does: units wrong by a factor; correct imu{number}.{sensor}_lsb or .output"
            )
        if np.linalg.det(C) < 0.0:
            raise InputError(
                f"imu{number}: the axes of its {sensor} are a mirror image of the primary's; two columns are swapped "
                "or one has the wrong sign"
            )
        turns.append(U @ V)
    if len(turns) == 2:
        apart = float(np.linalg.norm(rotation_vector(turns[0] @ turns[1].T)))
        if apart > TOGETHER:
            raise InputError(
                f"imu{number}: its gyro and accelerometer lie {np.rad2deg(apart):.0f}° apart; columns of one "
                "are swapped"
            )
