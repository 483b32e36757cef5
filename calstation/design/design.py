"""Request for a schedule, and the resulting schedule with its properties."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calstation.estimation.effects import EffectLimit
from calstation.physics import NAMES, FloatArray

#: Name of the stage.
STAGE = "designed"

#: Angles of the outer and the inner joint, °, and the rest at these angles, s.
Move = tuple[float, float, float]


@dataclass(frozen=True)
class Reached:
    """Sigmas at the end of a schedule and their limits, SI, shape (30,); a missing limit is infinite."""

    sigma: FloatArray
    limits: FloatArray  #: Limits before the margin is applied.

    @property
    def ratios(self) -> FloatArray:
        """Sigmas over limits, shape (30,)."""
        return np.asarray(self.sigma / self.limits)

    @property
    def worst(self) -> float:
        """Largest ratio of a sigma to its limit."""
        return float(self.ratios.max())

    @property
    def limiting(self) -> str:
        """Name of the parameter with the largest ratio."""
        return NAMES[int(np.argmax(self.ratios))]


@dataclass(frozen=True)
class DesignRequest:
    """Request for a schedule."""

    station: Path | None = None  #: Station file; None for the default.
    product: Path | None = None  #: Product file; None for the default.
    margin: float = 0.8  #: Fraction of its limit that no sigma may exceed.
    #: Duration of the stage, s, for which the smallest sigmas are searched; None for the shortest schedule.
    duration: float | None = None
    as_present: bool = False  #: Whether to match the sigmas of the product's current stages instead of its limits.
    time_limit: float | None = None  #: Time for the search, s; None for the usual effort.
    seed: int = 0
    rate_dps: float | None = None  #: Rate of moves; None for a fraction of the table's.
    acceleration_dps2: float | None = None  #: Acceleration of moves; None for a fraction of the table's.
    stop: Path | None = None  #: The search ends with its best result so far once this file exists.


@dataclass(frozen=True)
class Variation:
    """A condition that differs from the planned one, and the time at which every target is reached."""

    name: str  #: ``mounting``, ``heading`` or ``noise``.
    value: float  #: Rotation of the mounting, rad; heading, rad; ratio of the noise.
    duration: float | None  #: Duration until all targets are reached, s; None if they are not reached after all moves.
    worst: float  #: Largest ratio of a sigma to its target at that time, or after all moves.


@dataclass(frozen=True)
class Design(Reached):
    """A schedule and its properties; `sigma` is the sigma after the planned moves."""

    moves: tuple[Move, ...]  #: Moves; the last ones are a reserve.
    planned: int  #: Number of moves after which the targets are reached.
    least: int  #: Number of moves that are always made, because the product's diagnosis needs them.
    rate_dps: float
    acceleration_dps2: float
    duration: float  #: Duration of the planned moves, s.
    longest: float  #: Duration of all moves, s.
    margin: float  #: Fraction of their limits that no sigma exceeds.
    stop_targets: dict[str, float] | None  #: Sigmas at which the stage ends, SI; None for the product's limits.
    present: float | None  #: Duration of the product's current stages, s; None if this table cannot execute them.
    searched: bool  #: Whether the search found it; otherwise it is a random walk that reaches the targets.
    front: tuple[tuple[float, float], ...]  #: Durations, s, and the smallest worst ratio found for each.
    variations: tuple[Variation, ...]
    hidden: tuple[EffectLimit, ...]  #: Size of each effect that the planned moves cannot detect.
    rests: tuple[float, ...]  #: Durations of the planned rests, s.
    gravity_rest: float | None  #: Shortest rest, s, suitable for the product's gravity check; None without this check.
    latitude_sigma: float | None  #: Sigma of the latitude measured by the gyros, rad; None if they do not resolve it.
    noise_seen: float  #: Smallest relative error of the assumed noise that the innovations detect.
    seconds: float  #: Duration of the search, s.

    def schedule(self) -> dict[str, Any]:
        """Return the values of `[schedule.designed]`."""
        stops = self.stop_targets is None and self.planned < len(self.moves)
        values: dict[str, Any] = {
            "rate_dps": self.rate_dps,
            "acceleration_dps2": self.acceleration_dps2,
            "stop_at_limits": stops,
            "least_moves": self.least,
        }
        if stops:
            values["margin"] = round(self.margin, 4)
        if self.stop_targets:
            values["targets"] = self.stop_targets
        return {**values, "moves": [list(move) for move in self.moves]}

    def to_json(self) -> dict[str, Any]:
        """Return the design as JSON data."""
        ratios = {name: float(r) for name, r in zip(NAMES, self.ratios, strict=True) if r > 0.0}
        return {
            "schema": "calstation.design/1",
            "duration_s": self.duration,
            "longest_duration_s": self.longest,
            "default_duration_s": self.present,
            "margin": self.margin,
            "searched": self.searched,
            "worst_sigma_over_limit": self.worst,
            "limiting": self.limiting,
            "rate_dps": self.rate_dps,
            "acceleration_dps2": self.acceleration_dps2,
            "moves": [list(move) for move in self.moves],
            "planned_moves": self.planned,
            "least_moves": self.least,
            "sigma_over_limit": ratios,
            "front": [list(point) for point in self.front],
            "variations": [vars(variation) for variation in self.variations],
            "gravity_rest_s": self.gravity_rest,
            "latitude_sigma_rad": self.latitude_sigma,
            "noise_seen": self.noise_seen,
            "hidden": [{**vars(limit), "size": _finite(limit.size)} for limit in self.hidden],
            "search_s": self.seconds,
        }


def _finite(value: float) -> float | None:
    """Return a number, or None for an infinite one, which JSON does not support."""
    return value if np.isfinite(value) else None
