"""Attitude and rotation of a unit on the bench's table, from the true joint angles."""

import numpy as np

from calstation.bench.truth import TableTruth
from calstation.bench.truth.table import body_motion, to_body
from calstation.physics import FloatArray


def table_attitude(table: TableTruth, angles: FloatArray) -> FloatArray:
    """Return C_b^n at true joint angles (rad, shape (n, 2)), shape (n, 3, 3)."""
    chain = table.chain()
    basis = np.eye(3)
    columns = [
        [to_body(chain, float(outer), float(inner), basis[i]) for i in range(3)]
        for outer, inner in np.atleast_2d(angles)
    ]
    return np.array(columns)


def rotation_states(table: TableTruth, outer: FloatArray, inner: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ω_ib (rad/s) and its derivative (rad/s²) in b, each shape (n, 3).

    `outer` and `inner` hold angle, rate and acceleration of the joints, shape (n, 3).
    """
    chain, earth = table.chain(), table.earth_rate_n
    vectors = np.zeros((len(outer), 3, 3))
    for i in range(len(outer)):
        vectors[i, 1] = earth
        body_motion(chain, outer[i], inner[i], vectors[i])
    return vectors[:, 1], vectors[:, 2]
