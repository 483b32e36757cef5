"""Comparison of an export, evaluated with the formula of the reading program, with calstation's own correction."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calstation.errors import CalstationError
from calstation.exports.source import ExportFormat, ExportSource, Files, TemperatureCorrector
from calstation.physics import PARAMETERS, FloatArray
from calstation.records import context_from_meta

#: Largest difference of an export from calstation's correction with the same parameters, relative to the largest
#: sample.
TOLERANCE = 1e-9
#: Samples that rotate and accelerate every axis alone and in combination, so that every wrong element is detected,
#: unlike in a recording at rest: angular rates, rad/s, and specific forces, m/s².
_DIRECTIONS = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 2, 3], [2, -3, 1], [3, 1, -2]], dtype=np.float64)
_PROBES = np.hstack([_DIRECTIONS, 10.0 * np.roll(_DIRECTIONS, 1, axis=0)])
#: Small samples, compared with which an error of the bias is not negligible.
_SMALL_PROBES = 1e-6 * _PROBES


@dataclass(frozen=True)
class ExportCheck:
    """Result of the check of an export."""

    format: str
    samples: int  #: Number of compared samples.
    gyro: float  #: Largest difference of the angular rate from the data corrected by calstation, rad/s.
    accel: float  #: Largest difference of the specific force, m/s².
    gyro_sigmas: float  #: `gyro` in standard deviations of the noise of a sample.
    accel_sigmas: float  #: `accel` in standard deviations of the noise of a sample.
    not_expressed: Mapping[str, float]  #: Values that the format cannot express, see `ExportSource.not_expressed`, SI.
    of_limit: Mapping[str, float]  #: Sizes of `not_expressed` relative to the product's limits, if it has any.
    exceeding: tuple[str, ...]  #: Names in `not_expressed` whose sizes exceed the product's limits.

    def to_json(self) -> dict[str, Any]:
        """Return the content of the check's file."""
        return {
            "format": self.format,
            "samples": self.samples,
            "largest": {"gyro": self.gyro, "accel": self.accel},
            "largest_sigmas": {"gyro": self.gyro_sigmas, "accel": self.accel_sigmas},
            "not_expressed": list(self.not_expressed),
            "values": dict(self.not_expressed),
            "of_limit": dict(self.of_limit),
            "exceeding": list(self.exceeding),
        }


def check_export(name: str, export_format: ExportFormat, files: Files, source: ExportSource) -> ExportCheck:
    """Correct the samples of the recording with the files of an export, and compare them with calstation's correction.

    Raises CalstationError if they differ by more than the parameters that the format cannot express.
    """
    not_expressed = source.not_expressed(export_format)
    unexpressed = [i for i, parameter in enumerate(PARAMETERS) if parameter.name in not_expressed]
    same = replace(source, parameters=source.parameters.copy())
    same.parameters[unexpressed] = 0.0
    corrector = _corrector(export_format, files, source)
    if export_format.read_over is None:
        same = replace(same, temperature=None)
    largest, samples = np.zeros(2), 0
    for raw, temperature, is_recorded in _samples(source):
        measured = raw[:, :3], raw[:, 3:]
        corrected = corrector(*measured, temperature)
        _compare(name, corrected, same.corrected(*measured, temperature)[:2])
        if is_recorded:
            rate, force, count = source.corrected(*measured, temperature)
            samples += count
            largest = np.maximum(largest, _differences(corrected, (rate, force)))
    sigmas = largest / [source.gyro_noise.sample, source.accel_noise.sample]
    of_limit = {n: abs(value) / source.limit(n) for n, value in not_expressed.items() if source.limit(n) < np.inf}
    exceeding = tuple(n for n, share in of_limit.items() if share > 1.0)
    gyro, accel, gyro_sigmas, accel_sigmas = map(float, (*largest, *sigmas))
    return ExportCheck(name, samples, gyro, accel, gyro_sigmas, accel_sigmas, not_expressed, of_limit, exceeding)


def _corrector(export_format: ExportFormat, files: Files, source: ExportSource) -> TemperatureCorrector:
    """Return the reading program's correction, which depends on the temperature if calibration and format do."""
    if source.temperature is not None and export_format.read_over is not None:
        return export_format.read_over(files)
    constant = export_format.read(files)
    return lambda gyro, accel, _: constant(gyro, accel)


def _samples(source: ExportSource) -> Iterator[tuple[FloatArray, FloatArray, bool]]:
    """Yield samples, rad/s and m/s², shape (n, 6), their temperatures, °C, and whether the recording contains them."""
    low, high = source.temperature.range_c if source.temperature is not None else (0.0, 0.0)
    for probes in (_PROBES, _SMALL_PROBES):
        yield probes, np.linspace(low, high, len(probes)), False
    size = context_from_meta(source.log.meta).imu.count_size
    for block in source.log.blocks():
        yield block.counts[block.valid] * size, block.temperature[block.valid], True


def _differences(exported: tuple[FloatArray, FloatArray], reference: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Return the largest difference of rates and forces, shape (2,); samples without values do not count."""
    largest = []
    for values, expected in zip(exported, reference, strict=True):
        difference = np.where(np.isnan(expected), 0.0, np.abs(values - expected))
        largest.append(np.nan_to_num(difference, nan=np.inf).max(initial=0.0))
    return np.array(largest)


def _compare(name: str, exported: tuple[FloatArray, FloatArray], reference: tuple[FloatArray, FloatArray]) -> None:
    scale = [np.nan_to_num(np.abs(values)).max(initial=0.0) for values in reference]
    for sensor, difference, full in zip(("gyro", "accel"), _differences(exported, reference), scale, strict=True):
        if not difference <= TOLERANCE * full:
            raise CalstationError("export.contradicts", format=name, sensor=sensor, difference=float(difference))
