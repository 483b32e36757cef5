"""A check value in every row of a raw log, so that damage is found to the row and costs no other.

References
----------
M. Dietzfelbinger, *Universal hashing and k-wise independent random variables via integer arithmetic without primes*,
STACS 1996: multiply, add, take the upper half. S. Vigna's splitmix64 gives the multipliers.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

#: Name of the column.
CHECK = "check"

_MASK = (1 << 64) - 1
#: What nothing adds up to: a row of zeros that was never written does not pass.
_BEGIN = np.uint64(0x9E3779B97F4A7C15)


def row_checks(rows: np.ndarray) -> NDArray[np.uint32]:
    """The check values of rows, shape (n,), over all their columns but that of the check itself."""
    total = np.full(len(rows), _BEGIN, np.uint64)
    place = 0
    for name in rows.dtype.names or ():
        if name == CHECK:
            continue
        values = rows[name].reshape(len(rows), -1)
        for column in values.T:
            total += _word(column) * _multiplier(place)
            place += 1
    return (total >> np.uint64(32)).astype(np.uint32)


def _word(column: np.ndarray) -> NDArray[np.uint64]:
    """A column's bits, one word a row."""
    if column.dtype.itemsize == 8:
        return np.ascontiguousarray(column).view(np.uint64)
    return column.astype(np.uint64)


@cache
def _multiplier(place: int) -> np.uint64:
    """An odd number of 64 random bits for each place in a row."""
    z = ((place + 1) * int(_BEGIN)) & _MASK
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & _MASK
    return np.uint64((z ^ (z >> 31)) | 1)
