"""A request of a schedule, and the schedule that was found with everything known about it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calstation.estimation.effects import EffectLimit
from calstation.physics import NAMES, FloatArray

#: Name of the stage.
STAGE = "designed"

#: Angles of the outer and the inner joint, °, and the rest there, s.
Move = tuple[float, float, float]


@dataclass(frozen=True)
class Reached:
    """Sigmas at the end of a schedule and the largest ones wanted, SI, shape (30,); a missing limit is infinite."""

    sigma: FloatArray
    limits: FloatArray  #: Before the margin.

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
        """Name of the parameter with that ratio."""
        return NAMES[int(np.argmax(self.ratios))]


@dataclass(frozen=True)
class DesignRequest:
    """Request of a schedule."""

    station: Path | None = None  #: Station file; None for the default.
    product: Path | None = None  #: Product file; None for the default.
    margin: float = 0.8  #: Fraction of its limit that every sigma must reach.
    #: Duration of the stage, s, for which the best sigmas are sought; None for the shortest schedule.
    duration: float | None = None
    as_present: bool = False  #: Whether to reach the sigmas of the product's present stages instead of its limits.
    time_limit: float | None = None  #: Time for the search, s; None for the usual effort.
    seed: int = 0
    rate_dps: float | None = None  #: Rate of moves; None for a fraction of the table's.
    acceleration_dps2: float | None = None  #: Acceleration of moves; None for a fraction of the table's.
    stop: Path | None = None  #: The search ends with its best answer so far once this file exists.


@dataclass(frozen=True)
class Variation:
    """A condition that differs from the planned one, and when every target is reached there."""

    name: str  #: ``mounting``, ``heading`` or ``noise``.
    value: float  #: Rotation of the mounting, rad; heading, rad; ratio of the noise.
    duration: float | None  #: Duration until all targets are reached, s; None if the moves are not enough.
    worst: float  #: Largest ratio of a sigma to what is wanted of it then, or after all moves.


@dataclass(frozen=True)
class Design(Reached):
    """A schedule and what is known about it; `sigma` is that after the planned moves."""

    moves: tuple[Move, ...]  #: The last ones are a reserve.
    planned: int  #: Number of moves after which the targets are reached.
    least: int  #: Number of moves that always take place, because they show what the product's diagnosis asks for.
    rate_dps: float
    acceleration_dps2: float
    duration: float  #: Duration of the planned moves, s.
    longest: float  #: Duration of all moves, s.
    margin: float  #: Fraction of their limits that all sigmas reach.
    stop_targets: dict[str, float] | None  #: Sigmas at which the stage ends, SI; None for the product's limits.
    present: float | None  #: Duration of the product's present stages, s; None if this table has no way for them.
    searched: bool  #: Whether the search found it; otherwise it is a random walk that reaches the targets.
    front: tuple[tuple[float, float], ...]  #: Durations, s, and the smallest worst ratio that was found for each.
    variations: tuple[Variation, ...]
    hidden: tuple[EffectLimit, ...]  #: How much of each effect the planned moves hide.
    rests: tuple[float, ...]  #: Durations of the planned rests, s.
    gravity_rest: float | None  #: Shortest rest, s, that the product's check of gravity can judge; None without it.
    latitude_sigma: float | None  #: Sigma of the latitude seen by the gyros, rad; None if they do not resolve it.
    noise_seen: float  #: Smallest relative error of the assumed noise that the innovations show.
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
    """Return a number, or None for an infinite one, which JSON has not."""
    return value if np.isfinite(value) else None
