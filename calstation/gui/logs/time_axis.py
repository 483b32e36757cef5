"""A plot axis labelled with the time since the start of a log."""

from collections.abc import Sequence

import pyqtgraph as pg

#: Allowed tick spacings, s.
_SPACINGS = (
    *(base * 10.0**power for power in range(-5, 0) for base in (1, 2, 5)),
    *(1.0, 2.0, 5.0, 10.0, 15.0, 30.0),
    *(60.0 * minutes for minutes in (1, 2, 5, 10, 15, 30)),
    *(3600.0 * hours for hours in (1, 2, 3, 6, 12, 24, 48, 96, 240, 480, 960)),
)


class TimeAxis(pg.AxisItem):  # type: ignore[misc]
    """A time axis with ticks at round numbers of seconds, minutes or hours."""

    def __init__(self) -> None:
        super().__init__("bottom")

    def tickSpacing(self, low: float, high: float, size: float) -> list[tuple[float, float]]:
        """Return the smallest tick spacing at which labels do not overlap."""
        least = (high - low) * 110 / max(size, 1.0)  # 110 px between ticks
        return [(next((s for s in _SPACINGS if s >= least), _SPACINGS[-1]), 0.0)]

    def tickStrings(self, values: Sequence[float], _: float, spacing: float) -> list[str]:
        """Return labels in the form h:mm:ss, with as many decimals as the spacing needs."""
        return [time_text(value, spacing) for value in values]


def time_text(seconds: float, resolution: float = 1.0) -> str:
    """Format seconds as h:mm:ss, with decimals if `resolution` is finer than a second."""
    decimals = next((d for d in range(5) if resolution >= 0.99 * 10.0**-d), 5)
    units = 10**decimals
    ticks = round(abs(seconds) * units)
    minutes, rest = divmod(ticks, 60 * units)
    hours, minutes = divmod(minutes, 60)
    sign = "−" if seconds < 0 and ticks else ""
    width = 3 + decimals if decimals else 2
    return f"{sign}{hours}:{minutes:02d}:{rest / units:0{width}.{decimals}f}"
