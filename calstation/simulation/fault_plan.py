"""Fault plans for the virtual bench: the faults of a run, each in a stage, in a step or at a time.

`docs/reference/faults.md` describes the file and every kind of fault.
"""

import random
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

from pydantic import Field, field_validator, model_validator

from calstation.bench import FaultCommand, FaultName
from calstation.config import RunConfiguration, in_file
from calstation.messages import Text
from calstation.schema import EntryError, StrictModel, load, near_miss
from calstation.simulation.bench_settings import bench_settings

#: Kinds that the running bench injects.
BENCH_FAULTS: tuple[str, ...] = get_args(FaultName)

_INITIAL_CHANGES: Mapping[str, Callable[[Mapping[str, Any], float], dict[str, Any]]] = {
    "wrong_unit": lambda bench, value: {"serial": f"{bench['serial']}-OTHER"},
    "mounted_otherwise": lambda bench, value: {"mount_deg": [value, value]},
    "wrong_latitude": lambda bench, value: {"latitude_deg": bench["latitude_deg"] - value},
    "wrong_gravity": lambda bench, value: {"gravity_mps2": (bench.get("gravity_mps2") or 9.8) + value},
    "watchdog_off": lambda bench, value: {"watchdog_ms": 0},
    "interlock_open": lambda bench, value: {"interlock_closed": False},
    "never_ready": lambda bench, value: {"ready_time_s": 1e6},
    "single_bank_flash": lambda bench, value: {"flash_banks": 1},
}
#: Kinds that affect one unit; the others affect the table or the site.
_UNIT_FAULTS = ("wrong_unit", "mounted_otherwise", "never_ready", "single_bank_flash")
#: Default values: mounting angle of the unit, deg; latitude error of the station file, deg; gravity error, m/s².
_VALUES = {"mounted_otherwise": 20.0, "wrong_latitude": 10.0, "wrong_gravity": 0.05}

#: Kinds that change the bench from the start; they have no `stage`, `step` or `time_s`.
INITIAL_FAULTS = tuple(_INITIAL_CHANGES)

#: Kinds that affect the computer: the engine's process is killed, the disk is full, or the run folder disappears.
HOST_FAULTS = ("engine_killed", "disk_full", "runs_folder_gone")

KINDS: tuple[str, ...] = (*BENCH_FAULTS, *INITIAL_FAULTS, *HOST_FAULTS)

#: Ids of the messages that announce the captures before and after a register transfer.
CAPTURES = ("reference", "verifying")


class PlannedFault(StrictModel):
    """One `[[fault]]` table of a plan.

    The fault occurs `time_s` seconds of device time (a number or a range) after the start of the `stage`, of its
    `step`, or after power-on. The captures of the unit's output for a register transfer are also stages: "reference"
    before the transfer, "verifying" after it.
    """

    kind: str
    stage: str | None = None
    step: int | None = Field(default=None, ge=0)
    time_s: float | list[float] = 0.0
    value: float | None = None
    unit: int = Field(default=1, ge=1)  #: Slot number of the affected unit, if several are on the table.

    @property
    def affects_unit(self) -> bool:
        """Whether the fault affects one unit instead of the table, the site or the computer."""
        return self.kind in _UNIT_FAULTS or (
            self.kind in BENCH_FAULTS and not FaultCommand.model_validate({"order": self.kind}).affects_table
        )

    @field_validator("kind")
    @classmethod
    def _check_kind(cls, kind: str) -> str:
        if kind not in KINDS:
            otherwise = Text.of("entry.choose_from", names=KINDS)
            raise EntryError("bench.unknown_fault", kind=kind, remedy=near_miss(kind, KINDS, otherwise))
        return kind

    @model_validator(mode="after")
    def _check_entries(self) -> "PlannedFault":
        times = self.time_s if isinstance(self.time_s, list) else [self.time_s, self.time_s]
        if len(times) != 2 or not 0.0 <= times[0] <= times[1]:
            raise EntryError("bench.fault_time", "time_s", value=str(self.time_s))
        if self.step is not None and self.stage is None:
            raise EntryError("bench.fault_step_without_stage", "step")
        if self.step is not None and self.stage in CAPTURES:
            raise EntryError("bench.fault_step_of_capture", "step", stage=self.stage)
        if self.kind in INITIAL_FAULTS and (self.stage is not None or times[1] > 0.0):
            raise EntryError("bench.fault_from_start", kind=self.kind)
        if self.kind in HOST_FAULTS and self.stage is None:
            raise EntryError("bench.fault_without_stage", kind=self.kind)
        return self


class FaultPlan(StrictModel):
    """All faults of a run."""

    seed: int = Field(default=1, ge=0)
    fault: list[PlannedFault] = Field(default_factory=list)

    def times(self) -> list[float]:
        """Return the time of each fault, s, drawn at random if the plan contains a range."""
        generator = random.Random(self.seed)
        return [generator.uniform(*f.time_s) if isinstance(f.time_s, list) else f.time_s for f in self.fault]

    def adjust(self, setup: RunConfiguration) -> RunConfiguration:
        """Return the configuration with the planned errors in the station file and the bench settings."""
        latitude_error = sum(self._value(fault) for fault in self.fault if fault.kind == "wrong_latitude")
        station = setup.station
        site = station.site.model_copy(update={"latitude_deg": station.site.latitude_deg + latitude_error})
        setup = replace(setup, station=station.model_copy(update={"site": site}))
        return replace(setup, bench_overrides=self._overrides(bench_settings(setup), setup.number))

    def _overrides(self, settings: Mapping[str, Any], number: int) -> dict[str, Any]:
        """Return the changed bench settings of a unit, including the orders of faults with a time."""
        changes: dict[str, Any] = {}
        orders = list(settings.get("orders", []))
        for fault, time in zip(self.fault, self.times(), strict=True):
            if fault.kind in _UNIT_FAULTS and fault.unit != number:
                continue
            if fault.kind in INITIAL_FAULTS:
                changes |= _INITIAL_CHANGES[fault.kind]({**settings, **changes}, self._value(fault))
            elif fault.kind in BENCH_FAULTS and fault.stage is None:
                value = {} if fault.value is None else {"value": fault.value}
                orders.append({"order": fault.kind, "at": time, "unit": fault.unit, **value})
        return changes | ({"orders": orders} if orders else {})

    @staticmethod
    def _value(fault: PlannedFault) -> float:
        return _VALUES.get(fault.kind, 0.0) if fault.value is None else fault.value


def load_fault_plan(path: Path) -> FaultPlan:
    """Read and check a plan. Raises ConfigurationError with file, field and remedy."""
    return load(FaultPlan, path)


def fault_plan(setup: RunConfiguration) -> FaultPlan:
    """Return the fault plan of a run, which is empty if none is configured. Raises ConfigurationError."""
    path = _plan_file(setup)
    return FaultPlan() if path is None else load_fault_plan(path)


def with_faults(setup: RunConfiguration) -> RunConfiguration:
    """Return the configuration of a run adjusted by its fault plan. Raises ConfigurationError."""
    path = _plan_file(setup)
    if path is None:
        return setup
    plan = load_fault_plan(path)
    with in_file(path):
        _check_units(plan, setup)
    return plan.adjust(setup)


def _plan_file(setup: RunConfiguration) -> Path | None:
    """Return the file of the fault plan: from the request, or else from the station file."""
    if setup.request.faults is not None:
        return setup.request.faults
    name = (setup.station.bench or {}).get("faults")
    return None if name is None else setup.sources["station"].path.parent / str(name)


def _check_units(plan: FaultPlan, setup: RunConfiguration) -> None:
    names, used_slots = setup.station.slot_names, setup.request.batch_slots
    units = [number for number, name in enumerate(names or ("",), start=1) if name in used_slots or not used_slots]
    for number, fault in enumerate(plan.fault):
        if fault.affects_unit and fault.unit not in units:
            raise EntryError("bench.fault_of_no_unit", "fault", number, "unit", unit=fault.unit, units=units)
