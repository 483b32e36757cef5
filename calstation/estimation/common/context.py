"""Models of the site, the IMU and the table for the solvers: immutable values in SI units."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from calstation.estimation.common.temperature_model import TemperatureModel
from calstation.physics import (
    ALIGNED,
    AXIS_OFFSET_SIGMA,
    GYRO_BIAS,
    FloatArray,
    Orientation,
    TableGeometry,
    normal_gravity,
)

#: Standard deviation of normal gravity, m/s²: gravity anomalies are 30 to 50 ppm.
NORMAL_GRAVITY_SIGMA = 5e-4
#: Standard deviation of a surveyed gravity, m/s².
SURVEYED_GRAVITY_SIGMA = 1e-6


@dataclass(frozen=True)
class Site:
    """Location of the table."""

    latitude: float  #: rad
    longitude: float  #: rad
    height: float  #: m
    azimuth: float | None = None  #: Heading of platform +y at home, rad clockwise from true north; None if unknown.
    gravity: float | None = None  #: Surveyed gravity, m/s²; None for the normal gravity of the site.
    gravity_sigma: float | None = None  #: Standard deviation of gravity, m/s²; None for the default.

    @property
    def local_gravity(self) -> float:
        """Surveyed gravity, or else the normal gravity of the site, m/s²."""
        return self.gravity or normal_gravity(self.latitude, self.height)

    @property
    def relative_gravity_sigma(self) -> float:
        """Relative standard deviation of gravity, whose effect `with_gravity` includes in a covariance."""
        default = NORMAL_GRAVITY_SIGMA if self.gravity is None else SURVEYED_GRAVITY_SIGMA
        return (self.gravity_sigma or default) / self.local_gravity


@dataclass(frozen=True)
class ImuModel:
    """Output format and noise of an IMU."""

    serial: str
    sample_rate: float  #: Hz
    output: str  #: "increment" (rad, m/s per count) or "rate" (rad/s, m/s² per count, mean over the sample).
    gyro_lsb: float  #: Size of a gyro count, in the unit given by `output`.
    accel_lsb: float  #: Size of an accelerometer count, in the unit given by `output`.
    gyro_arw: float  #: Angle random walk, rad/√s.
    accel_vrw: float  #: Velocity random walk, m/s/√s.
    gyro_bias_instability: float = 0.0  #: rad/s
    accel_bias_instability: float = 0.0  #: m/s²
    gyro_quantisation: float | None = (
        None  #: Rounding step of the gyros, in the unit given by `output`; None for one count.
    )
    accel_quantisation: float | None = None  #: The same for accelerometers.
    bandwidth_hz: float | None = None  #: -3 dB bandwidth of a low-pass of all channels, Hz; None without one.
    coning_compensated: bool = False  #: Whether gyro increments are rotation vectors, which include coning.

    @property
    def quantisation(self) -> tuple[float, float]:
        """Rounding steps of gyros and accelerometers, in the units given by `output`; 0 without rounding."""
        gyro, accel = self.gyro_quantisation, self.accel_quantisation
        return self.gyro_lsb if gyro is None else gyro, self.accel_lsb if accel is None else accel

    @property
    def half_variance(self) -> float:
        """Half the variance of the impulse response of a first-order low-pass, s²; 0 without a bandwidth."""
        return 0.0 if self.bandwidth_hz is None else 0.5 / (2.0 * np.pi * self.bandwidth_hz) ** 2

    @property
    def rate_factor(self) -> float:
        """Factor from an output value to a mean rate: the sample rate (Hz) for increments, otherwise 1."""
        return self.sample_rate if self.output == "increment" else 1.0

    @property
    def bias_instability(self) -> FloatArray:
        """Bias instability of gyros and accelerometers, rad/s and m/s², shape (2,)."""
        return np.array([self.gyro_bias_instability, self.accel_bias_instability])

    @property
    def count_size(self) -> FloatArray:
        """Size of one count of each channel as a mean rate or specific force, rad/s and m/s², shape (6,)."""
        return np.repeat([self.gyro_lsb, self.accel_lsb], 3) * self.rate_factor


@dataclass(frozen=True)
class TableModel:
    """Axes of the table, uncertainties of its angles, and its vibration at rest."""

    outer_axis: tuple[float, float, float] = (1.0, 0.0, 0.0)  #: Unit vector in platform axes at home.
    inner_axis: tuple[float, float, float] = (0.0, 0.0, 1.0)  #: Unit vector in platform axes at home.
    outer_lever: str = "estimated"  #: "estimated", or "fixed" to 0.
    encoder_sigma: float = np.deg2rad(0.05)  #: rad
    mount_sigma: float = np.deg2rad(1.0)  #: rad
    azimuth_sigma: float = np.deg2rad(0.5)  #: rad
    base_tilt_sigma: float = np.deg2rad(0.2)  #: rad
    velocity_sigma: float = 1e-3  #: Sigma of the velocity observation made every `velocity_interval`, m/s.
    velocity_interval: float = 0.1  #: s
    orientation: Orientation = ALIGNED  #: Rotation from b to the platform's axes.
    #: Offset of the inner axis from the outer axis if they do not intersect: components along outer × inner and along
    #: inner at home, m.
    axis_offset: tuple[float, float] = (0.0, 0.0)
    axis_offset_sigma: float = AXIS_OFFSET_SIGMA  #: m

    @property
    def geometry(self) -> TableGeometry:
        """Geometry of the two axes, without travel limits."""
        return TableGeometry(self.outer_axis, self.inner_axis, orientation=self.orientation)

    @property
    def tilt_sigma(self) -> float:
        """Standard deviation of a tilt derived from the encoders, rad."""
        return float(np.sqrt(self.mount_sigma**2 + self.base_tilt_sigma**2 + self.encoder_sigma**2))


@dataclass(frozen=True)
class StoredCrossCalibration:
    """The last cross-calibration of a secondary IMU against the primary."""

    #: Pair parameters, SI, by name without the IMU's number; a missing parameter has the value for identical IMUs.
    values: Mapping[str, float] = field(default_factory=dict)
    gyro_static: float | None = None  #: Deviation at rest immediately after the calibration, rad/s.
    accel_static: float | None = None  #: Deviation at rest immediately after the calibration, m/s².

    @property
    def static(self) -> dict[str, float | None]:
        """Deviations at rest immediately after the calibration by sensor, rad/s and m/s²."""
        return {"gyro": self.gyro_static, "accel": self.accel_static}


@dataclass(frozen=True)
class Secondary:
    """A secondary IMU on the body: its number (2, 3, ...), model and last cross-calibration."""

    number: int
    imu: ImuModel
    stored: StoredCrossCalibration = field(default_factory=StoredCrossCalibration)


@dataclass(frozen=True)
class SolveContext:
    """Models that a stage's solver uses in addition to its prior and its samples."""

    site: Site
    imu: ImuModel
    table: TableModel
    secondaries: tuple[Secondary, ...] = ()
    states: tuple[str, ...] = ()  #: Effects that are estimated in addition to the 30 parameters.
    #: Parameters as functions of the temperature; None if they are constant.
    temperature: TemperatureModel | None = None
    #: Whether to compute what only the tests of the data and the model need: observability, diagnoses and, for stages
    #: without effects of the table, the sensitivity to effects.
    diagnostics: bool = True
    #: Sense of the last turn about each axis of b before the stage, +1, −1, or 0 without one.
    initial_turn_senses: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Posterior:
    """Gaussian estimate of the 30 parameters in SI units: mean, shape (30,), and covariance, shape (30, 30)."""

    mean: FloatArray
    covariance: FloatArray

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations, shape (30,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def gyro_bias(self) -> tuple[FloatArray, float]:
        """Gyro biases, rad/s, shape (3,), and the largest of their sigmas, rad/s."""
        return self.mean[GYRO_BIAS], float(self.sigma[GYRO_BIAS].max())
