"""What a solver must know beside the samples: site, IMU noise and table, as frozen values in SI."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from calstation.physics.arrays import FloatArray


@dataclass(frozen=True)
class Site:
    """Where the table stands.

    latitude, longitude : rad; height : m; azimuth : heading of body +y at home, rad clockwise from
    true north, None where unknown; gravity : m/s², None for the normal gravity of the place
    """

    latitude: float
    longitude: float
    height: float
    azimuth: float | None = None
    gravity: float | None = None


@dataclass(frozen=True)
class ImuModel:
    """Stream and noise of an IMU.

    output : "increment" (rad, m/s per count) or "rate" (rad/s, m/s² per count, mean over the sample)
    gyro_lsb, accel_lsb : size of a count; gyro_arw : rad/√s; accel_vrw : m/s/√s
    gyro_bias_instability : rad/s; accel_bias_instability : m/s²
    """

    serial: str
    sample_rate: float
    output: str
    gyro_lsb: float
    accel_lsb: float
    gyro_arw: float
    accel_vrw: float
    gyro_bias_instability: float = 0.0
    accel_bias_instability: float = 0.0


@dataclass(frozen=True)
class TableModel:
    """Table axes and what its angles and its rest are worth.

    outer_axis, inner_axis : unit vectors in b at home; outer_lever : "estimated" or "fixed" (at 0);
    *_sigma : rad; velocity_sigma : m/s, worth of one velocity observation every velocity_interval s
    """

    outer_axis: tuple[float, float, float] = (1.0, 0.0, 0.0)
    inner_axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    outer_lever: str = "estimated"
    encoder_sigma: float = np.deg2rad(0.05)
    mount_sigma: float = np.deg2rad(1.0)
    azimuth_sigma: float = np.deg2rad(0.5)
    base_tilt_sigma: float = np.deg2rad(0.2)
    velocity_sigma: float = 1e-3
    velocity_interval: float = 0.1


@dataclass(frozen=True)
class StoredPair:
    """The last cross-calibration of a secondary IMU against the primary.

    values : pair parameters by contract name without number, SI; those left out are neutral
    gyro_static, accel_static : what its gyro (rad/s) and accelerometer (m/s²) showed at rest right after
    """

    values: Mapping[str, float] = field(default_factory=dict)
    gyro_static: float | None = None
    accel_static: float | None = None


@dataclass(frozen=True)
class Secondary:
    """A further IMU on the body: its number (2, 3, ...), its stream and noise, and the last cross-calibration."""

    number: int
    imu: ImuModel
    stored: StoredPair = field(default_factory=StoredPair)


@dataclass(frozen=True)
class SolveContext:
    """All a stage's solver is told beside its prior and its samples."""

    site: Site
    imu: ImuModel
    table: TableModel
    secondaries: tuple[Secondary, ...] = ()


@dataclass(frozen=True)
class Belief:
    """Gaussian knowledge of the 30 parameters: mean, shape (30,), and covariance, shape (30, 30), SI."""

    mean: FloatArray
    covariance: FloatArray

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations, shape (30,)."""
        return np.sqrt(np.diag(self.covariance))
