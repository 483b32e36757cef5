"""A plan of faults for the virtual bench: what goes wrong in a run, at which stage, step or second.

seed = 7                          # draws the times given as a range
[[fault]]
kind = "drop_frames"
stage = "rate"                    # from the beginning of this stage, or look; without it from power-on
step = 2                          # and of its third step
time_s = [1.0, 5.0]               # and so many seconds of device time later; a number or a range
value = 3                         # what the kind takes; see `KINDS` and `calstation.bench.config.Order`

A look is one at the unit's output around a transfer: "reference" before it, "verifying" behind it.
"""

import os
import random
import signal
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, get_args

from pydantic import Field, field_validator, model_validator

from calstation.bench.config import OrderName
from calstation.config.resolved import ResolvedConfiguration
from calstation.records import raw_log
from calstation.schema import StrictModel, load, suggestion
from calstation.sequencer.events import Event, Message, StageStarted, StepStarted
from calstation.sequencer.ports import Emit

#: Kinds that the running bench carries out.
ORDERS: tuple[str, ...] = get_args(OrderName)

_SET_UP: Mapping[str, Callable[[dict[str, Any], float], dict[str, Any]]] = {
    "wrong_unit": lambda bench, value: {"serial": f"{bench['serial']}-OTHER"},
    "mounted_otherwise": lambda bench, value: {"mount_deg": [value, value]},
    "wrong_latitude": lambda bench, value: {"latitude_deg": bench["latitude_deg"] - value},
    "wrong_gravity": lambda bench, value: {"gravity_mps2": (bench.get("gravity_mps2") or 9.8) + value},
    "watchdog_off": lambda bench, value: {"watchdog_ms": 0},
    "interlock_open": lambda bench, value: {"interlock_closed": False},
    "never_ready": lambda bench, value: {"ready_time_s": 1e6},
    "single_bank_flash": lambda bench, value: {"flash_banks": 1},
}
_VALUES = {"mounted_otherwise": 20.0, "wrong_latitude": 10.0, "wrong_gravity": 0.05}
#: Kinds that make the bench another from the start; `stage`, `step` and `time_s` do not belong to them. Values:
#: degrees
#: that the unit is turned; degrees added to the latitude in the station file, while its gravity stays; m/s² by which
#: gravity is more than the station file's.
SET_UP = tuple(_SET_UP)

#: Kinds that befall the computer: the engine's process dies, its disk seems full, the folder is taken away.
HOST = ("engine_killed", "disk_full", "runs_folder_gone")

KINDS: tuple[str, ...] = (*ORDERS, *SET_UP, *HOST)


#: What a plan calls the looks at the unit before and behind a transfer: the messages that announce them.
LOOKS = ("reference", "verifying")


class PlannedFault(StrictModel):
    """`[[fault]]`: see the module."""

    kind: str
    stage: str | None = None
    step: int | None = Field(default=None, ge=0)
    time_s: float | list[float] = 0.0
    value: float | None = None

    @field_validator("kind")
    @classmethod
    def _known(cls, kind: str) -> str:
        if kind not in KINDS:
            mend = suggestion(kind, KINDS) or f"; choose from: {', '.join(KINDS)}"
            raise ValueError(f"'{kind}' is no fault{mend}")
        return kind

    @model_validator(mode="after")
    def _placed(self) -> "PlannedFault":
        times = self.time_s if isinstance(self.time_s, list) else [self.time_s, self.time_s]
        if len(times) != 2 or not 0.0 <= times[0] <= times[1]:
            raise ValueError(f"time_s = {self.time_s} must be a number or [earliest, latest], from 0 up")
        if self.step is not None and self.stage is None:
            raise ValueError("step needs the stage that it belongs to; add stage")
        if self.step is not None and self.stage in LOOKS:
            raise ValueError(f"stage '{self.stage}' has no steps to count; give time_s instead of step")
        if self.kind in SET_UP and (self.stage is not None or times[1] > 0.0):
            raise ValueError(f"'{self.kind}' is so from the start; remove stage, step and time_s")
        if self.kind in HOST and self.stage is None:
            raise ValueError(f"'{self.kind}' needs a stage; add it")
        return self


class FaultPlan(StrictModel):
    """All that is to go wrong in a run."""

    seed: int = Field(default=1, ge=0)
    fault: list[PlannedFault] = Field(default_factory=list)

    def times(self) -> list[float]:
        """The second of every fault, ranges drawn."""
        drawn = random.Random(self.seed)
        return [drawn.uniform(*f.time_s) if isinstance(f.time_s, list) else f.time_s for f in self.fault]

    def adjust(self, setup: ResolvedConfiguration) -> ResolvedConfiguration:
        """The configuration with a wrong station file, and a bench with what is wrong from the start."""
        wrong = sum(self._value(fault) for fault in self.fault if fault.kind == "wrong_latitude")
        station = setup.station
        site = station.site.model_copy(update={"latitude_deg": station.site.latitude_deg + wrong})
        setup = replace(setup, station=station.model_copy(update={"site": site}))
        return replace(setup, bench_overrides=self.bench(setup.bench_settings() or {}))

    def bench(self, settings: Mapping[str, Any]) -> dict[str, Any]:
        """What becomes of the bench's settings: what is wrong from the start, and faults at a time.

        settings : of the bench without faults, with the wrong station file
        """
        changed: dict[str, Any] = {}
        orders = list(settings.get("orders", []))
        for fault, time in zip(self.fault, self.times(), strict=True):
            if fault.kind in SET_UP:
                changed |= _SET_UP[fault.kind]({**settings, **changed}, self._value(fault))
            elif fault.kind in ORDERS and fault.stage is None:
                orders.append({"order": fault.kind, "at": time, **_value(fault)})
        return changed | ({"orders": orders} if orders else {})

    @staticmethod
    def _value(fault: PlannedFault) -> float:
        return _VALUES.get(fault.kind, 0.0) if fault.value is None else fault.value


def load_fault_plan(path: Path) -> FaultPlan:
    """Read and check a plan. Raises ConfigurationError naming file, field and mend."""
    return load(FaultPlan, path)


def fault_plan(setup: ResolvedConfiguration) -> FaultPlan:
    """The plan of a run; an empty one where its configuration names none. Raises ConfigurationError."""
    return FaultPlan() if setup.fault_plan is None else load_fault_plan(setup.fault_plan)


def with_faults(setup: ResolvedConfiguration) -> ResolvedConfiguration:
    """The configuration of a run with its plan of faults. Raises ConfigurationError."""
    return setup if setup.fault_plan is None else fault_plan(setup).adjust(setup)


@dataclass
class FaultInjector:
    """Lets the plan's faults happen in a run as its events come by.

    Attributes
    ----------
    plan : what is to happen
    runs : folder of the runs
    order : gives an order to the bench; set when it is there
    """

    plan: FaultPlan
    runs: Path
    order: Callable[[Mapping[str, Any]], None] | None = None
    _stage: str = ""
    _step: int = -1
    _given: set[int] = field(default_factory=set)

    def listening(self, emit: Emit) -> Emit:
        """`emit` with the faults that belong to an event right behind it."""

        def emit_and_spoil(event: Event) -> None:
            emit(event)
            if isinstance(event, StageStarted):
                self._stage, self._step = event.stage, -1
                self._happen()
            elif isinstance(event, Message) and event.id in LOOKS:
                self._stage, self._step = event.id, -1
                self._happen()
            elif isinstance(event, StepStarted) and event.stage and event.stage == self._stage:
                self._step += 1
                self._happen()

        return emit_and_spoil

    def _happen(self) -> None:
        for i, (fault, time) in enumerate(zip(self.plan.fault, self.plan.times(), strict=True)):
            due = fault.stage == self._stage and (-1 if fault.step is None else fault.step) == self._step
            if not due or i in self._given:
                continue
            self._given.add(i)
            if fault.kind in HOST:
                _befall(fault.kind, self.runs)
            elif self.order is not None:
                self.order({"order": fault.kind, "after": time, **_value(fault)})


def _value(fault: PlannedFault) -> dict[str, float]:
    return {} if fault.value is None else {"value": fault.value}


def _befall(kind: str, runs: Path) -> None:
    if kind == "engine_killed":
        os.kill(os.getpid(), signal.SIGTERM if sys.platform == "win32" else signal.SIGKILL)
    elif kind == "runs_folder_gone":
        runs.rename(runs.with_name(f"{runs.name}.gone"))
    else:
        raw_log.free_space = lambda path: 0  # nobody fills a real disk for a rehearsal
