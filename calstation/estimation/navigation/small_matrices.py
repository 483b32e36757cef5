"""Compiled products, Cholesky factor and triangular solves for small matrices, with sums in a fixed order.

BLAS takes twice as long for matrices of this size.
"""

import numpy as np

from calstation.physics import FloatArray, kernel


@kernel
def cholesky(S: FloatArray, L: FloatArray) -> None:
    """Write the lower Cholesky factor of a matrix, shape (n, n); NaN if it is not positive definite."""
    n = S.shape[0]
    L[:] = 0.0
    for i in range(n):
        for j in range(i + 1):
            s = S[i, j]
            for k in range(j):
                s -= L[i, k] * L[j, k]
            L[i, j] = np.sqrt(s) if i == j else s / L[j, j]


@kernel
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


@kernel
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


@kernel
def add_product(A: FloatArray, B: FloatArray, out: FloatArray) -> None:
    """Add A B, shape (n, k), to `out` for A of shape (n, m) and B of shape (m, k), where n and m are multiples of 3.

    Blocks of three rows of each matrix are processed together, so that loaded values are reused.
    """
    for i in range(0, len(A), 3):
        u, v, w = out[i], out[i + 1], out[i + 2]
        for m in range(0, len(B), 3):
            a, b, c = A[i, m], A[i, m + 1], A[i, m + 2]
            d, e, f = A[i + 1, m], A[i + 1, m + 1], A[i + 1, m + 2]
            g, h, o = A[i + 2, m], A[i + 2, m + 1], A[i + 2, m + 2]
            x, y, z = B[m], B[m + 1], B[m + 2]
            for j in range(B.shape[1]):
                p, q, r = x[j], y[j], z[j]
                u[j] += a * p + b * q + c * r
                v[j] += d * p + e * q + f * r
                w[j] += g * p + h * q + o * r


@kernel
def subtract_transposed_product(A: FloatArray, B: FloatArray, out: FloatArray) -> None:
    """Subtract Aᵀ B, shape (n, k), from `out` for A of shape (m, n) and B of shape (m, k); see `add_product`."""
    for i in range(0, len(out), 3):
        u, v, w = out[i], out[i + 1], out[i + 2]
        for m in range(0, len(A), 3):
            a, b, c = A[m, i], A[m + 1, i], A[m + 2, i]
            d, e, f = A[m, i + 1], A[m + 1, i + 1], A[m + 2, i + 1]
            g, h, o = A[m, i + 2], A[m + 1, i + 2], A[m + 2, i + 2]
            x, y, z = B[m], B[m + 1], B[m + 2]
            for j in range(B.shape[1]):
                p, q, r = x[j], y[j], z[j]
                u[j] -= a * p + b * q + c * r
                v[j] -= d * p + e * q + f * r
                w[j] -= g * p + h * q + o * r
