"""Site, IMU noise and table as a solver needs them beside the samples: frozen values in SI."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from calstation.physics import FloatArray, TableGeometry, normal_gravity


@dataclass(frozen=True)
class Site:
    """Location of the table."""

    latitude: float  #: rad
    longitude: float  #: rad
    height: float  #: m
    azimuth: float | None = None  #: Heading of body +y at home, rad clockwise from true north; None if unknown.
    gravity: float | None = None  #: Surveyed, m/s²; None for the site's normal gravity.

    @property
    def local_gravity(self) -> float:
        """Surveyed gravity, or the normal gravity of the site, m/s²."""
        return self.gravity or normal_gravity(self.latitude, self.height)


@dataclass(frozen=True)
class ImuModel:
    """Stream and noise of an IMU."""

    serial: str
    sample_rate: float  #: Hz
    output: str  #: "increment" (rad, m/s per count) or "rate" (rad/s, m/s² per count, mean over the sample).
    gyro_lsb: float  #: Size of a count.
    accel_lsb: float  #: Size of a count.
    gyro_arw: float  #: White noise, rad/√s.
    accel_vrw: float  #: White noise, m/s/√s.
    gyro_bias_instability: float = 0.0  #: rad/s
    accel_bias_instability: float = 0.0  #: m/s²

    @property
    def rate_factor(self) -> float:
        """What turns an output value into a rate: the sample rate (Hz) for increments, else 1."""
        return self.sample_rate if self.output == "increment" else 1.0

    @property
    def count_size(self) -> FloatArray:
        """Size of a count of each channel as a mean rate, rad/s and m/s², shape (6,)."""
        return np.repeat([self.gyro_lsb, self.accel_lsb], 3) * self.rate_factor


@dataclass(frozen=True)
class TableModel:
    """Table axes and the uncertainty of its angles and of its rest."""

    outer_axis: tuple[float, float, float] = (1.0, 0.0, 0.0)  #: Unit vector in b at home.
    inner_axis: tuple[float, float, float] = (0.0, 0.0, 1.0)  #: Unit vector in b at home.
    outer_lever: str = "estimated"  #: "estimated" or "fixed" (at 0).
    encoder_sigma: float = np.deg2rad(0.05)  #: rad
    mount_sigma: float = np.deg2rad(1.0)  #: rad
    azimuth_sigma: float = np.deg2rad(0.5)  #: rad
    base_tilt_sigma: float = np.deg2rad(0.2)  #: rad
    velocity_sigma: float = 1e-3  #: Of one velocity observation in every `velocity_interval`, m/s.
    velocity_interval: float = 0.1  #: s

    @property
    def geometry(self) -> TableGeometry:
        """The axes, without limits."""
        return TableGeometry(self.outer_axis, self.inner_axis)

    @property
    def tilt_sigma(self) -> float:
        """Standard deviation of a tilt derived from the encoders, rad."""
        return float(np.sqrt(self.mount_sigma**2 + self.base_tilt_sigma**2 + self.encoder_sigma**2))


@dataclass(frozen=True)
class StoredPair:
    """The last cross-calibration of a secondary IMU against the primary."""

    #: Pair parameters by contract name without number, SI; missing ones are neutral.
    values: Mapping[str, float] = field(default_factory=dict)
    gyro_static: float | None = None  #: Deviation at rest right after it, rad/s.
    accel_static: float | None = None  #: Deviation at rest right after it, m/s².


@dataclass(frozen=True)
class Secondary:
    """A further IMU on the body: its number (2, 3, ...), stream and noise, and last cross-calibration."""

    number: int
    imu: ImuModel
    stored: StoredPair = field(default_factory=StoredPair)


@dataclass(frozen=True)
class SolveContext:
    """Everything a stage's solver needs beside its prior and its samples."""

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
