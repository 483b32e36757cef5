"""Request for a schedule, permitted speeds, the resulting design, and the product that contains it."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from calstation.config import (
    Confirmation,
    ProductConfig,
    RunConfiguration,
    Version,
    edit_toml,
    library,
    read_text,
    versions,
)
from calstation.devices.profiles import channel_range
from calstation.errors import ConfigurationError
from calstation.estimation.common import SolveContext, rest_mean_variance
from calstation.estimation.effects import EffectLimit
from calstation.jobs import ProgressCallback
from calstation.parsing import parse_toml
from calstation.physics import NAMES, FloatArray
from calstation.schema import KeyPath
from calstation.sequencer import stage_times, table_task

#: Name of the stage.
STAGE = "designed"
#: Placeholder for the serial number of a unit of the product.
SERIAL = "design"
#: Fractions of the table's limits that a schedule uses.
_RATE_FRACTION, _ACCELERATION_FRACTION = 0.85, 0.75
#: Fraction of the gyro range that a move may use.
_GYRO_RANGE_FRACTION = 0.8
#: Limit of the product's gravity check in sigmas of the force at a rest.
_GRAVITY_SIGMAS = 4.0
#: Suffix of the names of products with a designed stage.
_NAME_SUFFIX = ", designed"
#: Checks that refer to the rests of one stage.
_REST_CHECKS = ("improvement_at_rest", "level")

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
    margin: float = 0.8  #: Fraction of its limit that a sigma must not exceed.
    #: Duration of the stage for which the smallest sigmas are searched, s; None for the shortest schedule.
    duration: float | None = None
    as_present: bool = False  #: Whether to match the sigmas of the product's current stages instead of its limits.
    time_limit: float | None = None  #: Longest duration of the search, s; None for the usual effort.
    seed: int = 0
    rate_dps: float | None = None  #: Rate of moves; None for a fraction of the table's limit.
    acceleration_dps2: float | None = None  #: Acceleration of moves; None for a fraction of the table's limit.
    stop: Path | None = None  #: File whose existence ends the search with the best result so far.


@dataclass(frozen=True)
class Variation:
    """A condition other than the planned one, and the time at which every target is reached."""

    name: str  #: ``mounting``, ``heading`` or ``noise``.
    value: float  #: Rotation of the mounting, rad, heading, rad, or factor of the noise.
    duration: float | None  #: Duration until all targets are reached, s; None if they are not reached after all moves.
    worst: float  #: Largest ratio of a sigma to its target at that time, or after all moves.


@dataclass(frozen=True)
class Design(Reached):
    """A schedule and its properties; `sigma` is the sigma after the planned moves."""

    moves: tuple[Move, ...]  #: Planned moves and reserve.
    #: Number of moves after which the targets are reached and the product's diagnosis has the data it requires.
    planned: int
    rate_dps: float
    acceleration_dps2: float
    duration: float  #: Duration of the planned moves, s.
    longest: float  #: Duration of all moves, s.
    margin: float  #: Fraction of their limits that no sigma exceeds.
    stop_targets: dict[str, float] | None  #: Sigmas at which the stage ends, SI; None for the product's limits.
    present: float | None  #: Duration of the product's current stages, s; None if this table cannot execute them.
    searched: bool  #: Whether the search found the schedule; otherwise, it is a random walk that reaches the targets.
    front: tuple[tuple[float, float], ...]  #: Durations, s, and the smallest worst ratio found for each.
    variations: tuple[Variation, ...]
    undetermined: tuple[str, ...]  #: Parameters that the planned moves do not determine, so that a run fails.
    hidden: tuple[EffectLimit, ...]  #: Size of each effect below which the planned moves cannot detect it.
    rests: tuple[float, ...]  #: Durations of the planned rests, s.
    gravity_rest: float | None  #: Shortest rest, s, suitable for the product's gravity check; None without this check.
    latitude_sigma: float | None  #: Sigma of the latitude measured by the gyros, rad; None if they do not resolve it.
    noise_seen: float  #: Smallest relative error of the assumed noise that the innovations reveal.
    seconds: float  #: Duration of the search, s.

    def schedule(self) -> dict[str, Any]:
        """Return the values of `[schedule.designed]`."""
        stops = self.stop_targets is None and self.planned < len(self.moves)
        values: dict[str, Any] = {
            "rate_dps": self.rate_dps,
            "acceleration_dps2": self.acceleration_dps2,
            "stop_at_limits": stops,
            "least_moves": self.planned,  # determines the planned duration of a run
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
            "least_moves": self.planned,
            "sigma_over_limit": ratios,
            "front": [list(point) for point in self.front],
            "variations": [vars(variation) for variation in self.variations],
            "gravity_rest_s": self.gravity_rest,
            "latitude_sigma_rad": self.latitude_sigma,
            "noise_seen": self.noise_seen,
            "undetermined": list(self.undetermined),
            "hidden": [{**vars(h), "size": h.size if np.isfinite(h.size) else None} for h in self.hidden],
            "search_s": self.seconds,
        }


def speeds(setup: RunConfiguration, request: DesignRequest) -> tuple[float, float]:
    """Return the rate, °/s, and acceleration, °/s², of all moves, from the request or as fractions of the limits."""
    limits, imu = setup.table.geometry().limits, setup.solve_context().imu
    per_count = imu.gyro_lsb * (imu.sample_rate if imu.output == "increment" else 1.0)
    ends = channel_range(setup.imu.frame)
    reach = float(np.min(np.minimum(-ends.low[:3], ends.high[:3]))) * per_count
    factor = 2.0**0.5  # because two perpendicular joints move simultaneously
    rate = np.rad2deg(min(_RATE_FRACTION * min(limits.rate), _GYRO_RANGE_FRACTION * reach / factor))
    acceleration = _ACCELERATION_FRACTION * np.rad2deg(min(limits.acceleration))
    return request.rate_dps or _rounded(rate), request.acceleration_dps2 or _rounded(acceleration)


def _rounded(value: float) -> float:
    """Return a positive number rounded down to two digits."""
    size = 10.0 ** np.floor(np.log10(value) - 1.0)
    return float(np.floor(value / size + 1e-9) * size)


def gravity_rest(product: ProductConfig, context: SolveContext) -> float | None:
    """Return the shortest rest, s, that is suitable for the product's gravity check; None without this check."""
    check = product.checks.gravity_at_rest if product.checks is not None else None
    if check is None:
        return None
    max_variance = (check.within / _GRAVITY_SIGMAS) ** 2
    rests = np.arange(1.0, check.shortest_rest_s, 0.5)
    return next(
        (float(rest) for rest in rests if rest_mean_variance(context, rest) < max_variance), check.shortest_rest_s
    )


def stages_duration(setup: RunConfiguration) -> float | None:
    """Return the duration of all stages if no target ends them early, s; None if this table cannot execute them."""
    try:
        return sum(stage_times(table_task(setup).stages, setup.table.settle_s))
    except ConfigurationError:
        return None


def designed_product(text: str, design: Design) -> str:
    """Return the text of a product file with the designed stage as its only stage.

    Checks of the rests of other stages are removed; checks of gravity at rest and of motion angles apply to the stage.
    """
    data = parse_toml(text)
    checks = data.get("checks", {})
    changes: dict[KeyPath, Any] = {
        ("name",): f"{data['name'].removesuffix(_NAME_SUFFIX)}{_NAME_SUFFIX}",
        ("stages",): [STAGE],
    }
    changes["targets",] = None
    changes |= {("schedule", stage): None for stage in data.get("schedule", {})}
    changes |= {("limits", name, "sigma_below_after"): None for name in data.get("limits", {})}
    changes |= {("checks", name): None for name in _REST_CHECKS}
    if "motion_angle" in checks:
        changes["checks", "motion_angle", "stage"] = STAGE
        changes["checks", "motion_angle", "positions"] = None
    if design.gravity_rest is not None:
        changes["checks", "gravity_at_rest", "shortest_rest_s"] = design.gravity_rest
    for key, value in design.schedule().items():
        changes["schedule", STAGE, key] = multiline(value) if key == "moves" else value
    return edit_toml(text, changes)


def save_product(
    report: ProgressCallback, product: Path, name: str, designed: Callable[[str], str], author: str | Confirmation
) -> tuple[Path, Version]:
    """Job: save a product with the designed schedule in the site's folder; return its file and version.

    Raises ConfigurationError if the product would be invalid or cannot be written.

    Parameters
    ----------
    report : callback for the progress
    product : file of the original product
    name : name of the new product
    designed : returns the text of a product file with the schedule
    author : author of the new version, as in `versions.save`
    """
    report(0.5)
    version = versions.save("products", name, designed(read_text(product)), author)
    return library.find("products", name), version


def multiline(moves: list[list[float]]) -> tomlkit.items.Array:
    """Return an array with a line for every move."""
    array = tomlkit.array()
    array.extend(moves)
    return array.multiline(True)
