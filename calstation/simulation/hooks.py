"""Run hooks for the virtual bench: planned faults, and the simulated operator of a manual rig."""

from __future__ import annotations

import os
import signal
import sys
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING

from calstation.bench import BenchClock
from calstation.config import RunConfiguration
from calstation.runs import RunHooks
from calstation.sequencer import Emit, Event, Message, StageStarted, StepStarted
from calstation.simulation.fault_plan import CAPTURES, FaultPlan, fault_plan, with_faults

if TYPE_CHECKING:
    from calstation.connection import Devices
    from calstation.records import RawLogWriter


class BenchHooks(RunHooks):
    """Injects the faults of the run's plan, and moves a simulated manual rig; see `station_hooks`."""

    def __init__(self) -> None:
        self._clock: BenchClock | None = None
        self._log: RawLogWriter | None = None
        self._stage, self._step = "", -1
        self._injected: set[int] = set()

    def adjust(self, setup: RunConfiguration) -> RunConfiguration:
        """Return the configuration changed according to the fault plan."""
        return with_faults(setup)

    def listener(self, setup: RunConfiguration, folder: Path, emit: Emit) -> Emit:
        """Return an event sink that moves the rig, calls `emit` and injects faults for every event."""
        plan = fault_plan(setup)

        def emit_with_faults(event: Event) -> None:
            if setup.table.by_hand:
                self._move_rig(event)
            emit(event)
            if plan.fault:
                self._inject(plan, folder, event)

        return emit_with_faults

    def connected(self, devices: Devices) -> None:
        """Store the bench's clock, which accepts fault commands."""
        if isinstance(devices.clock, BenchClock):
            self._clock = devices.clock

    def log_opened(self, log: RawLogWriter) -> None:
        """Store the log, so that a fault can simulate a full disk."""
        self._log = log

    def _move_rig(self, event: Event) -> None:
        if self._clock is not None and isinstance(event, StepStarted) and event.kind == "carry":
            outer, inner, rest = (float(value) for value in event.label[1:4])
            self._clock.carry(radians(outer), radians(inner), rest)

    def _inject(self, plan: FaultPlan, runs: Path, event: Event) -> None:
        """Inject the faults planned for this event."""
        if isinstance(event, StageStarted):
            self._stage, self._step = event.stage, -1
        elif isinstance(event, Message) and event.id in CAPTURES:
            self._stage, self._step = event.id, -1
        elif isinstance(event, StepStarted) and event.stage and event.stage == self._stage:
            self._step += 1
        else:
            return
        for i, (fault, time) in enumerate(zip(plan.fault, plan.times(), strict=True)):
            due = fault.stage == self._stage and (-1 if fault.step is None else fault.step) == self._step
            if not due or i in self._injected:
                continue
            self._injected.add(i)
            if fault.kind == "engine_killed":
                os.kill(os.getpid(), signal.SIGTERM if sys.platform == "win32" else signal.SIGKILL)
            elif fault.kind == "runs_folder_gone":
                runs.rename(runs.with_name(f"{runs.name}.gone"))
            elif fault.kind == "disk_full":
                if self._log is not None:
                    self._log.free_space = lambda path: 0
            elif self._clock is not None:
                value = {} if fault.value is None else {"value": fault.value}
                self._clock.inject({"order": fault.kind, "after": time, "unit": fault.unit, **value})
