"""Synchronous samples of a primary and a secondary IMU: raw rates of both where both are there."""

from dataclasses import dataclass

import numpy as np

from calstation.estimation.common.context import ImuModel
from calstation.estimation.common.stage_data import StageData, runs
from calstation.physics.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class PairData:
    """Rows of two IMUs on one body.

    Attributes
    ----------
    dt : sample period, s
    time : of the rows by the primary's clock, s, shape (n,)
    gyro, accel : raw mean rates of the primary, rad/s and m/s², shape (n, 3)
    gyro2, accel2 : of the secondary, shape (n, 3)
    segments : (start, stop) of each stretch in which no sample of either is missing
    """

    dt: float
    time: FloatArray
    gyro: FloatArray
    accel: FloatArray
    gyro2: FloatArray
    accel2: FloatArray
    segments: tuple[tuple[int, int], ...]

    def __len__(self) -> int:
        return len(self.time)


def pair_data(data: StageData, place: int, imu: ImuModel) -> PairData:
    """The rows of the secondary `imu`, the further IMU at `place` in the rows (0 for the first)."""
    per_count = imu.sample_rate if imu.output == "increment" else 1.0
    counts = data.others[:, place]
    there: BoolArray = np.asarray(~np.isnan(counts).any(axis=1))
    segments: list[tuple[int, int]] = []
    for start, stop in data.segments:
        segments += [(start + a, start + b) for a, b in runs(there[start:stop])]
    return PairData(
        dt=data.dt,
        time=data.time,
        gyro=data.gyro,
        accel=data.accel,
        gyro2=counts[:, :3] * (imu.gyro_lsb * per_count),
        accel2=counts[:, 3:] * (imu.accel_lsb * per_count),
        segments=tuple(segments),
    )
