"""The excess scatter of residuals is found however small their stated variance is."""

import numpy as np
import pytest

from calstation.estimation.positions.rows import excess


@pytest.mark.parametrize("variance", [1.0, 1e-20, 1e-200])
def test_excess_of_large_residuals(variance: float) -> None:
    for size in (1e4, 1e9, 1.234567e17):
        residual = np.full(7, size)
        assert excess(residual, np.full(7, variance), 6.9) == pytest.approx(size * np.sqrt(7 / 6.9))
