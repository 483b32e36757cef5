"""What is exported: the parameters of a unit, the noise of its samples, and the recording for the check."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calstation.errors import InputError
from calstation.physics import NAMES, PARAMETERS, FloatArray, entry_of
from calstation.records import ImuSection, Limit, Log, open_log, prior_from_meta
from calstation.results import Result, TemperatureResult, compensate_samples, find_log

#: Time, s, at which a random walk of the bias has the Allan deviation of the bias instability, K √(T/3) = B; programs
#: that model no flicker noise require K (IEEE Std 952-2020, annex C).
BIAS_TIME = 1000.0
#: The lever arm of the mounting on the table is not a property of the unit.
_NOT_OF_UNIT = "outer_lever"
#: Ending of a name that denotes the change of a parameter over the range of temperatures.
_OVER_TEMPERATURE = "(T)"

#: Files by the ending that is added to the name of the export; "" is the export itself.
Files = Mapping[str, bytes]
#: Corrects angular rate, rad/s, and specific force, m/s², shape (n, 3) each.
Corrector = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]
#: Corrects the same quantities at temperatures, °C, shape (n,); NaN outside the range.
TemperatureCorrector = Callable[[FloatArray, FloatArray, FloatArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True)
class Noise:
    """Noise of one sensor of a unit, in rad/s for gyros and m/s² for accelerometers."""

    density: float  #: Random walk of the integral, unit/√Hz.
    instability: float  #: Bias instability; 0 if it is unknown.
    sample_rate: float  #: Hz.

    @property
    def sample(self) -> float:
        """Standard deviation of a sample."""
        return float(self.density * np.sqrt(self.sample_rate))

    @property
    def random_walk(self) -> float:
        """Random walk of the bias, unit·√Hz; see `BIAS_TIME`."""
        return float(self.instability * np.sqrt(3.0 / BIAS_TIME))


@dataclass(frozen=True)
class ExportFormat:
    """A format: the parameter groups that it can express, and functions that write and evaluate its files."""

    groups: frozenset[str]  #: Parameter groups that the format can express.
    write: "Callable[[ExportSource], Files]"
    #: Returns the correction that the reading program applies with the content of the files.
    read: Callable[[Files], Corrector]
    #: The same for a calibration over temperature; None if the format cannot express one.
    read_over: Callable[[Files], TemperatureCorrector] | None = None


@dataclass(frozen=True)
class ExportSource:
    """A calibration to be exported."""

    serial: str
    parameters: FloatArray  #: SI, shape (30,).
    further: Mapping[str, float]  #: Parameters outside the 30.
    limits: Mapping[str, float]  #: Largest error of a parameter that the product permits, SI, by name.
    imu: ImuSection
    log: Log  #: Recording for the check.
    temperature: TemperatureResult | None = None  #: If given, `parameters` apply at its reference.

    @classmethod
    def of(cls, result: Result, log: Log | None = None, file: Path | None = None) -> "ExportSource":
        """Return the source for a result; a parameter without estimate keeps the value of the result's log.

        Raises InputError if there is no recording for the check, or if the unit already corrects its output itself.

        Parameters
        ----------
        result : result to export
        log : recording for the check; None for the result's own log
        file : file of the result, next to which its log is sought
        """
        path = find_log(result, file or Path(result.log.file))
        result_log = log if path is None or (log is not None and log.path == path) else open_log(path)
        recording = log or result_log
        if recording is None or result_log is None:
            raise InputError("export.no_log", serial=result.serial, file=result.log.file)
        meta = result_log.meta
        if meta.registers and result.registers is not None and result.registers.new:
            raise InputError("export.in_registers", serial=result.serial)
        values = prior_from_meta(meta).mean.copy() if meta.imu.serial == result.serial else np.zeros(len(NAMES))
        for i, name in enumerate(NAMES):
            if name in result.parameters:
                values[i] = result.parameters[name].value
        product = meta.product or recording.meta.product
        further = {name: row.value for name, row in result.parameters.items() if name not in NAMES}
        limits = {} if product is None else _largest_errors(result, product.limits)
        return cls(result.serial, values, further, limits, meta.imu, recording, result.temperature)

    @property
    def gyro_noise(self) -> Noise:
        """Noise of the gyros."""
        return Noise(self.imu.gyro_arw, self.imu.gyro_bias_instability, self.imu.sample_rate_hz)

    @property
    def accel_noise(self) -> Noise:
        """Noise of the accelerometers."""
        return Noise(self.imu.accel_vrw, self.imu.accel_bias_instability, self.imu.sample_rate_hz)

    def vector(self, group: str) -> list[float]:
        """Return the values of a group of three parameters, SI."""
        return [float(self.parameters[i]) for i, p in enumerate(PARAMETERS) if p.group == group]

    def matrix(self, sensor: str) -> FloatArray:
        """Return I + M of a sensor, with which its output is measured = (I + M) true + bias, shape (3, 3)."""
        matrix = np.eye(3)
        for value, parameter in zip(self.parameters, PARAMETERS, strict=True):
            if parameter.group in (f"{sensor}_scale", f"{sensor}_misalign"):
                matrix[parameter.row, parameter.column] += value
        return matrix

    def not_expressed(self, export_format: ExportFormat) -> dict[str, float]:
        """Return the nonzero values that a format cannot express, SI, by name.

        ``NAME(T)`` is the largest change of a parameter over the range of temperatures, ``NAME(dT/dt)`` its coefficient
        of the rate of change, per K/s.
        """
        not_expressed = {
            p.name: float(value)
            for value, p in zip(self.parameters, PARAMETERS, strict=True)
            if p.group not in export_format.groups and p.group != _NOT_OF_UNIT and value != 0.0
        }
        not_expressed |= {name: value for name, value in self.further.items() if value != 0.0}
        if self.temperature is None:
            return not_expressed
        changes = {n: size for n, size in self.temperature.largest_changes.items() if not n.startswith(_NOT_OF_UNIT)}
        if export_format.read_over is not None:
            changes = {
                n: size for n, size in changes.items() if PARAMETERS[NAMES.index(n)].group not in export_format.groups
            }
        not_expressed |= {f"{name}{_OVER_TEMPERATURE}": size for name, size in changes.items()}
        return not_expressed | {f"{name}(dT/dt)": value for name, value in self.temperature.rate_terms.items()}

    def limit(self, name: str) -> float:
        """Return the largest permitted error of a value in `not_expressed`, SI; infinite if there is no limit."""
        return self.limits.get(name.removesuffix(_OVER_TEMPERATURE), np.inf)

    def corrected(
        self, gyro: FloatArray, accel: FloatArray, temperature: FloatArray
    ) -> tuple[FloatArray, FloatArray, int]:
        """Return the corrected samples, NaN if the calibration does not cover their temperature, and their number.

        Parameters
        ----------
        gyro, accel : output, rad/s and m/s², shape (n, 3)
        temperature : temperature of the unit, °C, shape (n,)
        """
        over = self.temperature
        known = np.ones(len(gyro), np.bool_) if over is None else over.covers(temperature)
        rate, force = np.full_like(gyro, np.nan), np.full_like(accel, np.nan)
        samples = gyro[known], accel[known], temperature[known]
        rate[known], force[known] = compensate_samples(self.parameters, over, *samples)
        return rate, force, int(np.count_nonzero(known))


def _largest_errors(result: Result, limits: Mapping[str, Limit]) -> dict[str, float]:
    """Return the largest error permitted after calibration: the limit of sigma, or else the limit of the value."""
    errors = {}
    for name in (*NAMES, *result.parameters):
        limit = entry_of(limits, name)
        if limit is None:
            continue
        stage = result.parameters[name].stage if name in result.parameters else ""
        sigma, interval = limit.sigma_limit(stage), limit.interval
        if sigma is not None or interval is not None:
            errors[name] = sigma if sigma is not None else max(map(abs, interval or ()))
    return errors
