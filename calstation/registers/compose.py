"""Puts what was found behind the unit's own registers together with them into one set of registers."""

from collections.abc import Mapping

import numpy as np

from calstation.physics.arrays import FloatArray
from calstation.physics.parameters import NAMES, PARAMETERS, group_matrix, group_vector


def compose(old: Mapping[str, float], found: Mapping[str, float]) -> dict[str, float]:
    """Registers that correct the raw output as `old` and, behind it, `found` do one after the other.

    With raw = (I + M_old) y + b_old and y = (I + M) ω + b the raw output is
    (I + M_old)(I + M) ω + (I + M_old) b + b_old. Second-order terms and levers, which act on the
    specific force itself, add to first order. The accelerometer matrix stays lower triangular because
    the product of two is.

    Parameters
    ----------
    old, found : parameters by contract name, SI; a name that is missing is 0
    """
    was, now = _vector(old), _vector(found)
    result = was + now
    for sensor in ("gyro", "accel"):
        groups = (f"{sensor}_scale", f"{sensor}_misalign")
        before = np.eye(3) + group_matrix(was, *groups)
        matrix = before @ (np.eye(3) + group_matrix(now, *groups)) - np.eye(3)
        bias = before @ group_vector(now, f"{sensor}_bias") + group_vector(was, f"{sensor}_bias")
        for i, parameter in enumerate(PARAMETERS):
            if parameter.group in groups:
                result[i] = matrix[parameter.row, parameter.column]
            elif parameter.group == f"{sensor}_bias":
                result[i] = bias[parameter.row]
    return dict(zip(NAMES, result.tolist(), strict=True))


def _vector(values: Mapping[str, float]) -> FloatArray:
    return np.array([values.get(name, 0.0) for name in NAMES])
