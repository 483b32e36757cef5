"""Compiled small-matrix operations agree with NumPy."""

import numpy as np
import pytest

from calstation.estimation.navigation.small_matrices import add_product, subtract_transposed_product


@pytest.mark.parametrize(("rows", "inner", "columns"), [(3, 39, 39), (15, 45, 45), (6, 45, 88), (9, 45, 1)])
def test_products_agree_with_numpy(rows, inner, columns):
    random = np.random.default_rng(rows)
    A, B, C = (random.normal(size=shape) for shape in ((rows, inner), (inner, columns), (rows, columns)))
    added, subtracted = C.copy(), B.copy()
    add_product(A, B, added)
    subtract_transposed_product(A, C, subtracted)
    np.testing.assert_allclose(added, C + A @ B, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(subtracted, B - A.T @ C, rtol=0.0, atol=1e-12)
