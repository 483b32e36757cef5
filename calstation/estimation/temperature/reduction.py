"""Output of a unit at changing temperatures, converted into its output with constant parameters."""

from dataclasses import replace

import numpy as np

from calstation.estimation.common import StageData
from calstation.estimation.temperature.fit import TemperatureFit
from calstation.physics import COUNT, INNER_LEVER, PARAMETERS, FloatArray

#: Number of samples that are converted at once, and fixed-point iterations, whose relative error is M⁵.
_SAMPLES, _ITERATIONS = 65_536, 5


def parameters_at(fit: TemperatureFit, temperature: FloatArray, rate: FloatArray) -> FloatArray:
    """Return the parameters at temperatures, °C, and rates of change, K/s, of shape (n,); shape (n, 30)."""
    model = fit.model
    x, parameters = (temperature - model.reference) / model.span, np.zeros((len(temperature), COUNT))
    for size, column in zip(fit.scaled, model.columns, strict=True):
        parameters[:, column.parameter] += size * (60.0 * rate if column.power is None else x**column.power)
    return parameters


def corrected(gyro: FloatArray, accel: FloatArray, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return rate, rad/s, and specific force, m/s², of each sensor, shape (n, 3), without the size effect.

    Parameters
    ----------
    gyro, accel : output, rad/s and m/s², shape (n, 3)
    parameters : SI, shape (n, 30)
    """
    rate, force = gyro, accel
    for _ in range(_ITERATIONS):
        errors = _errors(rate, force, parameters)
        rate, force = gyro - errors[0], accel - errors[1]
    return rate, force


def compensate_each(gyro: FloatArray, accel: FloatArray, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return angular rate, rad/s, and specific force, m/s², at the reference point, shape (n, 3).

    Without gyros (output NaN), the specific force is computed as if the unit did not rotate.

    Parameters
    ----------
    gyro, accel : output, rad/s and m/s², shape (n, 3)
    parameters : those of each sample, SI, shape (n, 30)
    """
    rate, force = corrected(gyro, accel, parameters)
    square = np.nan_to_num(rate) ** 2
    return rate, force + parameters[:, INNER_LEVER] * (square.sum(axis=1, keepdims=True) - square)


def reduced(data: StageData, fit: TemperatureFit, temperature: FloatArray, constant: FloatArray) -> StageData:
    """Return the samples as if the unit had `constant` parameters, shape (30,).

    Parameters
    ----------
    data : samples of a stage
    fit : parameters over temperature
    temperature : temperature of each sample, °C, shape (n,)
    constant : SI, shape (30,)
    """
    rates = np.gradient(temperature, data.dt) if len(data) > 1 else np.zeros(len(data))
    gyro, accel = np.empty_like(data.gyro), np.empty_like(data.accel)
    for start in range(0, len(data), _SAMPLES):
        part = slice(start, start + _SAMPLES)
        parameters = parameters_at(fit, temperature[part], rates[part])
        rate, force = corrected(data.gyro[part], data.accel[part], parameters)
        errors = _errors(rate, force, np.broadcast_to(constant, parameters.shape))
        gyro[part], accel[part] = rate + errors[0], force + errors[1]
    return replace(data, gyro=gyro, accel=accel)


def _errors(rate: FloatArray, force: FloatArray, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the errors of gyros and accelerometers, shape (n, 3) each."""
    gyro, accel = np.zeros_like(rate), np.zeros_like(force)
    for i, p in enumerate(PARAMETERS):
        output, sensed = (gyro, rate) if p.sensor == "gyro" else (accel, force)
        if p.group in ("gyro_bias", "accel_bias"):
            output[:, p.row] += parameters[:, i]
        elif p.group == "accel_quadratic":
            output[:, p.row] += parameters[:, i] * force[:, p.row] ** 2
        elif p.sensor != "lever":
            output[:, p.row] += parameters[:, i] * sensed[:, p.column]
    return gyro, accel
