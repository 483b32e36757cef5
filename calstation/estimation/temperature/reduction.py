"""Reduction of a unit's output at changing temperatures to the output with constant parameters."""

from dataclasses import replace

import numpy as np

from calstation.estimation.common import StageData
from calstation.estimation.temperature.course import ELEMENT_OF, ElementTemperatures
from calstation.estimation.temperature.fit import Polynomials
from calstation.physics import COUNT, INNER_LEVER, PARAMETERS, FloatArray

#: Number of samples converted at once, and of fixed-point iterations, which multiply the error by M⁵.
_SAMPLES, _ITERATIONS = 65_536, 5


def parameters_at(fit: Polynomials, temperature: FloatArray, rate: FloatArray) -> FloatArray:
    """Return the parameters at temperatures and rates of change of gyros and accelerometers, shape (n, 30).

    Parameters
    ----------
    fit : parameters over temperature
    temperature, rate : °C and K/s, shape (n, 2)
    """
    model, parameters = fit.model, np.zeros((len(temperature), COUNT))
    x = (temperature - model.reference) / model.span
    powers = [x**k for k in range(max(model.order.values(), default=0) + 1)]
    for size, column in zip(fit.scaled, model.columns, strict=True):
        i = column.parameter
        basis = 60.0 * rate if column.power is None else powers[column.power]
        parameters[:, i] += size * basis[:, ELEMENT_OF[i]]
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
    parameters : parameters of each sample, SI, shape (n, 30)
    """
    rate, force = corrected(gyro, accel, parameters)
    square = np.nan_to_num(rate) ** 2
    return rate, force + parameters[:, INNER_LEVER] * (square.sum(axis=1, keepdims=True) - square)


def reduced(data: StageData, fit: Polynomials, elements: ElementTemperatures, constant: FloatArray) -> StageData:
    """Return the samples as if the unit had `constant` parameters, shape (30,).

    Parameters
    ----------
    data : samples of a stage
    fit : parameters over temperature
    elements : temperatures of gyros and accelerometers
    constant : SI, shape (30,)
    """
    gyro, accel = np.empty_like(data.gyro), np.empty_like(data.accel)
    for start in range(0, len(data), _SAMPLES):
        part = slice(start, start + _SAMPLES)
        parameters = parameters_at(fit, *elements.at(data.time[part]))
        rate, force = corrected(data.gyro[part], data.accel[part], parameters)
        errors = _errors(rate, force, np.broadcast_to(constant, parameters.shape))
        gyro[part], accel[part] = rate + errors[0], force + errors[1]
    return replace(data, gyro=gyro, accel=accel)


def _errors(rate: FloatArray, force: FloatArray, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the errors of gyros and accelerometers at given rate and force, shape (n, 3) each."""
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
