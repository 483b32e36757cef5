"""Exact conversion between the parameters of a sensor and the matrix and offset in a unit's registers.

The error model is measured = (I + M) true + b. From the matrix R and offset B in its registers, a unit computes either

    corrected = C (measured − B)        offset before the matrix
    corrected = C measured − B          offset after it

where R is C itself ("correction"), or its inverse E = C⁻¹, the error matrix that the unit inverts ("error"). R may omit
the identity, C = I + R, and may then be negated, C = I − R. B may be added instead of subtracted. In every convention,
corrected = true holds exactly, not only to first order.
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
_TRIANGULAR = 1e-6


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
    def _sign(self) -> "Convention":
        if self.negated and self.identity:
            raise EntryError("profile.belongs_to", "negated", owner="identity = false")
        return self


@cache
def matrix_slots(sensor: str) -> tuple[str, ...]:
    """Return the names of a sensor's matrix elements in registers, row by row."""
    return tuple(f"{sensor}_matrix_{a}{b}" for a in AXES for b in AXES)


@cache
def offset_slots(sensor: str) -> tuple[str, ...]:
    """Return the names of a sensor's offsets in registers."""
    return tuple(f"{sensor}_offset_{axis}" for axis in AXES)


def _slots(sensor: str) -> tuple[str, ...]:
    return matrix_slots(sensor) + offset_slots(sensor)


#: Names that register entries may contain in addition to the parameters themselves.
SLOTS: tuple[str, ...] = tuple(name for sensor in SENSORS for name in _slots(sensor))


@cache
def parameter_of(name: str) -> str | None:
    """Return the parameter in a slot, or any other `name` itself; None for an element that the error model omits."""
    if name not in SLOTS:
        return name
    sensor, kind, element = name.split("_")
    if kind == "offset":
        return f"{sensor}_bias_{element}"
    name = f"{sensor}_scale_{element[0]}" if element[0] == element[1] else f"{sensor}_misalign_{element}"
    return name if name in NAMES else None


def to_registers(
    sensor: str, values: Mapping[str, float], slots: Iterable[str], matrix: Convention, offset: Convention
) -> dict[str, float]:
    """Convert parameters to the values of a sensor's slots.

    Parameters
    ----------
    sensor : gyro or accel
    values : parameters by name, SI
    slots : slots of the unit's registers; parameters without a slot are 0
    matrix, offset : conventions of the registers of the matrix and the offset
    """
    present = set(slots)
    names = {slot: parameter_of(slot) for slot in _slots(sensor)}
    parameters = np.array([values[name] if name and slot in present else 0.0 for slot, name in names.items()])
    error, bias = np.eye(3) + parameters[:9].reshape(3, 3), parameters[9:]
    correction = _inverse(error)
    stored = correction if matrix.matrix == "correction" else error
    if not matrix.identity:
        stored = (stored - np.eye(3)) * (-1.0 if matrix.negated else 1.0)
    shift = bias if offset.offset == "before" else correction @ bias
    shift = -shift if offset.added else shift
    contents = zip(names, (*stored.ravel().tolist(), *shift.tolist()), strict=True)
    return {slot: content for slot, content in contents if slot in present}


def from_registers(
    sensor: str, contents: Mapping[str, float], matrix: Convention, offset: Convention
) -> dict[str, float]:
    """Convert the values of a sensor's slots to parameters, SI, which are NaN if the matrix cannot be inverted.

    Raises DeviceFaultError if an accelerometer's matrix is not lower triangular, as the error model requires.
    """
    stored = np.zeros((3, 3)) if not matrix.identity else np.eye(3)
    for i, slot in enumerate(matrix_slots(sensor)):
        stored[i // 3, i % 3] = contents.get(slot, stored[i // 3, i % 3])
    if not matrix.identity:
        stored = np.eye(3) + stored * (-1.0 if matrix.negated else 1.0)
    error = _inverse(stored) if matrix.matrix == "correction" else stored
    if sensor == "accel" and np.any(np.abs(np.triu(error, 1)) > _TRIANGULAR):
        raise DeviceFaultError("imu.matrix_not_triangular")
    shift = np.array([contents.get(slot, 0.0) for slot in offset_slots(sensor)])
    shift = -shift if offset.added else shift
    bias = shift if offset.offset == "before" or not np.any(shift) else error @ shift
    parameters = zip(_slots(sensor), (*(error - np.eye(3)).ravel().tolist(), *bias.tolist()), strict=True)
    return {name: value for slot, value in parameters if slot in contents and (name := parameter_of(slot))}


def _inverse(matrix: FloatArray) -> FloatArray:
    try:
        return np.asarray(np.linalg.inv(matrix)) if np.all(np.isfinite(matrix)) else np.full((3, 3), np.nan)
    except np.linalg.LinAlgError:
        return np.full((3, 3), np.nan)


def legal_range(slot: str, sigmas: Mapping[str, float], convention: Convention) -> tuple[float, float] | None:
    """Return the range of the values in a slot for parameters within `sigmas`, to first order and widened by half.

    None is returned if the parameter has no sigma.
    """
    sigma = sigmas.get(parameter_of(slot) or "")
    if sigma is None:
        return None
    _, kind, element = slot.split("_")
    middle = 1.0 if kind == "matrix" and element[0] == element[1] and convention.identity else 0.0
    return middle - 1.5 * sigma, middle + 1.5 * sigma
