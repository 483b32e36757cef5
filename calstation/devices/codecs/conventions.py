"""Exact conversion between the parameters of a sensor and the matrix and offset in a unit's registers.

The error model is measured = (I + M) true + b. From the matrix R and offset B in its registers, a unit computes either

    corrected = C (measured − B)        offset before the matrix
    corrected = C measured − B          offset after the matrix

where R is C itself ("correction"), or its inverse E = C⁻¹, the error matrix that the unit inverts ("error"). R may omit
the identity (C or E = I + R), and may then be negated (C or E = I − R). B may be added instead of subtracted. In every
convention, corrected = true holds exactly, not only to first order.
"""

from collections.abc import Iterable, Mapping
from functools import cache
from typing import Literal

import numpy as np
from pydantic import model_validator

from calstation.errors import DeviceFaultError
from calstation.physics import AXES, NAMES, FloatArray
from calstation.schema import EntryError, StrictModel

SENSORS = ("gyro", "accel")

#: Largest rounding error accepted above the diagonal of an accelerometer's error matrix.
_MAX_UPPER_ELEMENT = 1e-6


class Convention(StrictModel):
    """`convention` of a register entry that contains a matrix or an offset.

    matrix : "correction", the matrix that multiplies the output, or "error", its inverse
    identity : whether the registers include the ones on the diagonal
    negated : whether a matrix without the identity is stored with the opposite sign
    offset : whether the offset is subtracted "before" or "after" the multiplication
    added : whether the offset is added instead of subtracted
    """

    matrix: Literal["correction", "error"] = "correction"
    identity: bool = True
    negated: bool = False
    offset: Literal["before", "after"] = "before"
    added: bool = False

    @model_validator(mode="after")
    def _check_sign(self) -> "Convention":
        if self.negated and self.identity:
            raise EntryError("profile.belongs_to", "negated", owner="identity = false")
        return self


@cache
def matrix_elements(sensor: str) -> tuple[str, ...]:
    """Return the names of the elements of a sensor's matrix, row by row."""
    return tuple(f"{sensor}_matrix_{a}{b}" for a in AXES for b in AXES)


@cache
def offset_elements(sensor: str) -> tuple[str, ...]:
    """Return the names of the elements of a sensor's offset."""
    return tuple(f"{sensor}_offset_{axis}" for axis in AXES)


def _elements(sensor: str) -> tuple[str, ...]:
    return matrix_elements(sensor) + offset_elements(sensor)


#: Names of the matrix and offset elements, which register entries may contain instead of parameters.
ELEMENTS: tuple[str, ...] = tuple(name for sensor in SENSORS for name in _elements(sensor))


@cache
def parameter_of(name: str) -> str | None:
    """Return the parameter of an element (None if the error model has none); other names are returned unchanged."""
    if name not in ELEMENTS:
        return name
    sensor, kind, part = name.split("_")
    if kind == "offset":
        return f"{sensor}_bias_{part}"
    name = f"{sensor}_scale_{part[0]}" if part[0] == part[1] else f"{sensor}_misalign_{part}"
    return name if name in NAMES else None


def to_registers(
    sensor: str, values: Mapping[str, float], elements: Iterable[str], matrix: Convention, offset: Convention
) -> dict[str, float]:
    """Convert parameters to the values of the matrix and offset elements of a sensor.

    Parameters
    ----------
    sensor : gyro or accel
    values : parameters by name, SI
    elements : names of the elements in the unit's registers; parameters without an element are 0
    matrix, offset : conventions of the registers of the matrix and the offset
    """
    present = set(elements)
    names = {element: parameter_of(element) for element in _elements(sensor)}
    parameters = np.array([values[name] if name and element in present else 0.0 for element, name in names.items()])
    error, bias = np.eye(3) + parameters[:9].reshape(3, 3), parameters[9:]
    correction = _inverse(error)
    stored = correction if matrix.matrix == "correction" else error
    if not matrix.identity:
        stored = (stored - np.eye(3)) * (-1.0 if matrix.negated else 1.0)
    shift = bias if offset.offset == "before" else correction @ bias
    shift = -shift if offset.added else shift
    contents = zip(names, (*stored.ravel().tolist(), *shift.tolist()), strict=True)
    return {element: content for element, content in contents if element in present}


def from_registers(
    sensor: str, contents: Mapping[str, float], matrix: Convention, offset: Convention
) -> dict[str, float]:
    """Convert the values of matrix and offset elements to parameters, SI; NaN if the matrix cannot be inverted.

    Raises DeviceFaultError if an accelerometer's matrix is not lower triangular, as the error model requires.

    Parameters
    ----------
    sensor : gyro or accel
    contents : values by element name
    matrix, offset : conventions of the registers of the matrix and the offset
    """
    stored = np.zeros((3, 3)) if not matrix.identity else np.eye(3)
    for i, element in enumerate(matrix_elements(sensor)):
        stored[i // 3, i % 3] = contents.get(element, stored[i // 3, i % 3])
    if not matrix.identity:
        stored = np.eye(3) + stored * (-1.0 if matrix.negated else 1.0)
    error = _inverse(stored) if matrix.matrix == "correction" else stored
    if sensor == "accel" and np.any(np.abs(np.triu(error, 1)) > _MAX_UPPER_ELEMENT):
        raise DeviceFaultError("imu.matrix_not_triangular")
    shift = np.array([contents.get(element, 0.0) for element in offset_elements(sensor)])
    shift = -shift if offset.added else shift
    bias = shift if offset.offset == "before" or not np.any(shift) else error @ shift
    parameters = zip(_elements(sensor), (*(error - np.eye(3)).ravel().tolist(), *bias.tolist()), strict=True)
    return {name: value for element, value in parameters if element in contents and (name := parameter_of(element))}


def _inverse(matrix: FloatArray) -> FloatArray:
    try:
        return np.asarray(np.linalg.inv(matrix)) if np.all(np.isfinite(matrix)) else np.full((3, 3), np.nan)
    except np.linalg.LinAlgError:
        return np.full((3, 3), np.nan)


def permitted_range(
    element: str, half_widths: Mapping[str, float], convention: Convention
) -> tuple[float, float] | None:
    """Return the range of an element for parameters within ± `half_widths`, to first order and widened by half.

    The result is None if the parameter has no half width.

    Parameters
    ----------
    element : name of a matrix or offset element
    half_widths : half widths of the intervals of the parameters by name, SI
    convention : convention of the register
    """
    half_width = half_widths.get(parameter_of(element) or "")
    if half_width is None:
        return None
    _, kind, part = element.split("_")
    middle = 1.0 if kind == "matrix" and part[0] == part[1] and convention.identity else 0.0
    return middle - 1.5 * half_width, middle + 1.5 * half_width
