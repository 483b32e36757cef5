"""Summary of a run before it starts, and the products that a station can calibrate."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from calstation.config import library
from calstation.config.request import RunRequest
from calstation.config.resolved import ResolvedConfiguration, check_station, resolve_configuration
from calstation.devices.imu import RegisterMap
from calstation.errors import ConfigurationError
from calstation.physics import GROUPS, NAMES, Carry, TableGeometry, group_indices
from calstation.sequencer import DURATION, plan_time
from procedures import method


@dataclass(frozen=True)
class StageSummary:
    """A planned stage and its duration, s of device time."""

    name: str
    duration: float


@dataclass(frozen=True)
class RunSummary:
    """A planned run."""

    station: str  #: Name.
    product: str  #: Name.
    bench: Mapping[str, object] | None  #: Settings of the virtual bench; None for hardware.
    table: str  #: Name.
    outer_axis: tuple[float, float, float]  #: Unit vector in b at home.
    inner_axis: tuple[float, float, float]  #: Unit vector in b at home.
    serial_pattern: str  #: Regular expression for the whole serial number.
    stages: tuple[StageSummary, ...]
    #: Approximate duration of writing and verifying the registers, s; None for a unit without registers.
    transfer: float | None
    #: Largest sigma that the product allows after these stages, SI, by group with an estimate and a limit.
    targets: Mapping[str, float]
    attempts_allowed: int | None  #: Consecutive failures after which a unit is set aside; None for any number.
    load_angle: tuple[float, float]  #: Of the table while units are changed, degrees.
    by_hand: bool = False
    #: Direction of gravity in b at every manual position, unit vectors.
    positions: tuple[tuple[float, float, float], ...] = ()

    @property
    def virtual(self) -> bool:
        """Whether the station is a virtual bench."""
        return self.bench is not None


def run_summary(request: RunRequest) -> RunSummary:
    """Summarise the run of a request, whatever its serial number. Raises ConfigurationError."""
    setup = resolve_configuration(request)
    check_station(setup)
    load = setup.product.load_angle
    geometry = setup.table.geometry()
    plans = setup.task().stages
    return RunSummary(
        station=setup.station.name,
        product=setup.product.name,
        bench=setup.station.bench,
        table=setup.table.name,
        outer_axis=geometry.outer_axis,
        inner_axis=geometry.inner_axis,
        serial_pattern=setup.product.serial_pattern,
        stages=tuple(
            StageSummary(p.name, float(plan_time(p.steps(), p.rule, (0.0, 0.0), setup.table.settle_s))) for p in plans
        ),
        transfer=DURATION if RegisterMap(tuple(setup.imu.registers)).parameters else None,
        targets=_targets(setup),
        attempts_allowed=setup.product.attempts_allowed,
        load_angle=(load.outer_deg, load.inner_deg),
        by_hand=setup.by_hand,
        positions=tuple(_up(geometry, step) for plan in plans for step in plan.steps() if isinstance(step, Carry))
        if setup.by_hand
        else (),
    )


def _up(geometry: TableGeometry, step: Carry) -> tuple[float, float, float]:
    x, y, z = geometry.body_to_home(step.outer, step.inner)[2]
    return float(x), float(y), float(z)


def _targets(setup: ResolvedConfiguration) -> dict[str, float]:
    context = setup.solve_context()
    last = {name: stage for stage in setup.stages for name in method(stage).estimates(context)}
    limits = setup.product.limits
    found: dict[str, float] = {}
    for group in GROUPS:
        for name in (NAMES[i] for i in group_indices(group)):
            limit = limits.get(name, limits.get(group))
            sigma = limit.sigma_limit(last[name]) if limit is not None and name in last else None
            if sigma is not None:
                found[group] = min(sigma, found.get(group, sigma))
    return found


def compatible_products(station: Path | None, instead_of: Path | None) -> list[tuple[str, Path]]:
    """Name and file of every product that the station can calibrate, those with the IMU of `instead_of` first."""
    wanted = _read(RunRequest("-", station, instead_of))
    found = []
    for name in library.names("products"):
        path = library.find("products", name)
        setup = _read(RunRequest("-", station, path))
        if setup is None:
            continue
        try:
            check_station(setup)
        except ConfigurationError:
            continue
        other = wanted is None or setup.product.imu != wanted.product.imu
        found.append((other, name, path))
    return [(name, path) for _, name, path in sorted(found)]


def _read(request: RunRequest) -> ResolvedConfiguration | None:
    try:
        return resolve_configuration(request)
    except ConfigurationError:
        return None
