"""Enlargement of the whole window on a large screen, so that its texts can be read from a distance."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress

#: Environment variable with the factor by which Qt enlarges everything, which it reads when an application is created.
_FACTOR = "QT_SCALE_FACTOR"

#: Width and height of the screen from which the window grows, logical px, and its maximum growth.
_WIDTH, _HEIGHT, _MAX_GROWTH = 1366, 768, 2.5


def growth(screen: tuple[int, int]) -> float:
    """Return the factor by which the window grows with the available width and height of its screen, logical px."""
    width, height = screen
    factor = min(width / _WIDTH, height / _HEIGHT, _MAX_GROWTH)
    return max(int(100 * factor) / 100, 1.0)


@contextmanager
def enlarged(screen: tuple[int, int]) -> Iterator[None]:
    """Enlarge an application that is created in this context; other programs do not inherit the factor."""
    given = os.environ.get(_FACTOR)
    with suppress(ValueError):  # Qt ignores a text that is not a number, too
        os.environ[_FACTOR] = str(growth(screen) * float(given or 1.0))
    try:
        yield
    finally:
        os.environ.pop(_FACTOR, None)
        if given is not None:
            os.environ[_FACTOR] = given
