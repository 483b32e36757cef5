"""A typed name for numba's compiler: compiled functions keep their signatures under strict checking."""

from collections.abc import Callable
from typing import TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compile `function` at its first call and keep the machine code on disk beside the source."""
    return cast(F, numba.njit(cache=True)(function))
