"""Summary of a run before its start."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from math import inf
from pathlib import Path

from calstation.config import RunRequest, SignInSection, check_station, library, load_configuration
from calstation.messages import Text
from calstation.physics import (
    NAMES,
    ManualMove,
    Orientation,
    Soak,
    TableGeometry,
    group_of,
    orientation_matrix,
    parameter_indices,
)
from calstation.quality import due_certificates
from calstation.records import open_log
from calstation.runs.resume import with_stages_of
from calstation.sequencer import DURATION, StagePlan, stage_times, step_time, table_task


@dataclass(frozen=True)
class StageSummary:
    """A planned stage and its duration in device time, s."""

    name: str
    duration: float


@dataclass(frozen=True)
class RunSummary:
    """Summary of a planned run."""

    station: str  #: Name of the station.
    product: str  #: Name of the product.
    bench: Mapping[str, object] | None  #: Settings of the virtual bench; None for hardware.
    table: str  #: Name of the table.
    outer_axis: tuple[float, float, float]  #: Unit vector in the body frame at home.
    inner_axis: tuple[float, float, float]  #: Unit vector in the body frame at home.
    serial_pattern: str  #: Regular expression for the whole serial number.
    serial_example: str  #: A serial number that matches.
    stages: tuple[StageSummary, ...]
    #: Approximate duration of writing and verifying the registers, s; None for a unit without registers.
    transfer: float | None
    #: Sigma to reach, SI, by group: the smallest of the product's limits after these stages and the stages' targets.
    targets: Mapping[str, float]
    load_angle: tuple[float, float]  #: Angles of the table while units are changed, degrees.
    operator_ends_stages: bool = False  #: Whether the operator page offers to end a repeated stage early.
    by_hand: bool = False
    joint_order: str = ""  #: Letters of a gimbal's joints from base to body; "" for a table.
    #: Unit vector opposite to gravity in the body frame at every manual position.
    positions: tuple[tuple[float, float, float], ...] = ()
    sign_in: SignInSection | None = None  #: How operators sign in; None if the station does not require badges.
    shift_starts: tuple[str, ...] = ("00:00",)  #: Local times, ``HH:MM``.
    picture: Path | None = None  #: Drawing of the unit in its fixture.
    slots: tuple[str, ...] = ()  #: Names of the slots for units on the table, in order; () for a single unit.
    slot_products: Mapping[str, str] = field(default_factory=dict)  #: Names of the slots' own products, by slot.
    #: Rotation from the unit's axes to the table's axes, by slot; () if all units are aligned with the table.
    orientations: tuple[Orientation, ...] = ()
    #: Overdue calibrations of table and site, which refuse production unless an engineer permits it.
    overdue: tuple[Text, ...] = ()
    check_standards: tuple[str, ...] = ()  #: Serial numbers of the check standards, whose runs are never refused.
    unjudged: tuple[str, ...] = ()  #: Entries of the product's limits that none of its stages can judge.
    omitted: tuple[str, ...] = ()  #: Stages of the product that the run omits; a run that omits any is partial.
    own_targets: frozenset[str] = frozenset()  #: Groups whose sigma to reach is a stage's target, not a limit.

    @property
    def over_temperature(self) -> bool:
        """Whether the run is over temperature, in a chamber."""
        return any(stage.name == "temperature" for stage in self.stages)

    @property
    def virtual(self) -> bool:
        """Whether the station is a virtual bench."""
        return self.bench is not None

    @property
    def fixed_serial(self) -> str:
        """Serial number of the only unit of a virtual bench; "" for hardware, with slots, or if it is not fixed."""
        return "" if self.bench is None or self.slots else str(self.bench.get("serial", ""))

    @property
    def faster(self) -> bool:
        """Whether the station is a virtual bench that is faster than hardware."""
        return self.bench is not None and self.bench.get("speed", 0.0) != 1.0


def run_summary(request: RunRequest) -> RunSummary:
    """Summarise a requested run, which need not name a serial number; a resumed run has the stages of its log.

    Raises ConfigurationError, or InputError if the log cannot be read.
    """
    if request.resume is not None:
        request = with_stages_of(request, open_log(request.resume))
    setup = load_configuration(request)
    check_station(setup)
    load, picture = setup.product.load_angle, setup.product.picture
    geometry = setup.table.geometry()
    plans = table_task(setup).stages
    targets = [target for plan in plans for target in plan.rule.targets.items()]
    by_stages = _by_group((NAMES[i], sigma) for name, sigma in targets for i in parameter_indices(name))
    limits = _by_group(setup.sigma_limits().items())
    own = {group: sigma for group, sigma in by_stages.items() if sigma < limits.get(group, inf)}
    return RunSummary(
        station=setup.station.name,
        product=setup.product.name,
        bench=setup.station.bench,
        table=setup.table.name,
        outer_axis=geometry.outer_axis,
        inner_axis=geometry.inner_axis,
        serial_pattern=setup.product.serial_pattern,
        serial_example=setup.product.example,
        stages=tuple(
            StageSummary(plan.name, seconds)
            for plan, seconds in zip(plans, stage_times(plans, setup.table.settle_s), strict=True)
        ),
        transfer=_transfer_time(plans) if setup.register_map.parameters else None,
        targets=limits | own,
        load_angle=(load.outer_deg, load.inner_deg),
        operator_ends_stages=setup.product.operator_ends_stages,
        by_hand=setup.table.by_hand,
        joint_order=setup.table.joint_order,
        positions=tuple(_up(geometry, step) for plan in plans for step in plan.steps() if isinstance(step, ManualMove))
        if setup.table.by_hand
        else (),
        sign_in=setup.station.sign_in,
        shift_starts=tuple(setup.station.shift_starts),
        picture=None if picture is None else library.find_beside(setup.sources["product"].path, picture),
        slots=setup.station.slot_names,
        slot_products=setup.slot_products(),
        orientations=tuple(orientation_matrix(slot.orientation) for slot in setup.station.slots),
        overdue=tuple(due.cause for due in due_certificates(setup.station, datetime.now(UTC))),
        check_standards=tuple(standard.serial for standard in setup.product.check_standards),
        unjudged=setup.unjudged_limits,
        omitted=tuple(stage for stage in setup.product.stages if stage not in setup.stages),
        own_targets=frozenset(own),
    )


def _transfer_time(plans: Sequence[StagePlan]) -> float:
    """Return the approximate duration of writing and verifying the registers, s, with the soak before it."""
    soaks = [step for plan in plans if plan.name == "temperature" for step in plan.steps() if isinstance(step, Soak)]
    return DURATION + (step_time(soaks[-1], (0.0, 0.0)) if soaks else 0.0)


def _up(geometry: TableGeometry, step: ManualMove) -> tuple[float, float, float]:
    x, y, z = geometry.body_to_home(step.outer, step.inner)[2]
    return float(x), float(y), float(z)


def _by_group(sigmas: Iterable[tuple[str, float]]) -> dict[str, float]:
    """Return the smallest sigma of each group."""
    smallest: dict[str, float] = {}
    for name, sigma in sigmas:
        group = group_of(name)
        smallest[group] = min(sigma, smallest.get(group, sigma))
    return smallest
