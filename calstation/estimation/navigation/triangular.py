"""Compiled Cholesky factor and triangular solutions for small matrices, whose sums always have the same order."""

import numba as nb
import numpy as np

from calstation.physics import FloatArray


@nb.njit(cache=True)
def cholesky(S: FloatArray, L: FloatArray) -> None:
    """Write the lower Cholesky factor of a positive definite matrix, shape (n, n); NaN if it is not."""
    n = S.shape[0]
    L[:] = 0.0
    for i in range(n):
        for j in range(i + 1):
            s = S[i, j]
            for k in range(j):
                s -= L[i, k] * L[j, k]
            L[i, j] = np.sqrt(s) if i == j else s / L[j, j]


@nb.njit(cache=True)
def forward(L: FloatArray, B: FloatArray) -> None:
    """Replace B, shape (n, m), by L⁻¹ B."""
    n, m = B.shape
    for i in range(n):
        for k in range(i):
            t = L[i, k]
            for j in range(m):
                B[i, j] -= t * B[k, j]
        t = 1.0 / L[i, i]
        for j in range(m):
            B[i, j] *= t


@nb.njit(cache=True)
def backward(L: FloatArray, B: FloatArray) -> None:
    """Replace B, shape (n, m), by L⁻ᵀ B."""
    n, m = B.shape
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            t = L[k, i]
            for j in range(m):
                B[i, j] -= t * B[k, j]
        t = 1.0 / L[i, i]
        for j in range(m):
            B[i, j] *= t
