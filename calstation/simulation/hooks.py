"""Hooks of runs on the virtual bench: planned faults, and the simulated operator of a manual rig."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from calstation.config.resolved import ResolvedConfiguration
from calstation.connection.clock import BenchClock
from calstation.runs.hooks import RunHooks
from calstation.sequencer.ports import Emit
from calstation.simulation.fault_plan import FaultInjector, fault_plan, with_faults
from calstation.simulation.simulated_operator import SimulatedOperator

if TYPE_CHECKING:
    from calstation.connection.devices import Devices


class BenchHooks(RunHooks):
    """Injects the faults of the run's plan and turns a simulated manual rig; does nothing on hardware."""

    def __init__(self) -> None:
        self._operator = SimulatedOperator()
        self._injector: FaultInjector | None = None

    def adjust(self, setup: ResolvedConfiguration) -> ResolvedConfiguration:
        """The configuration with what the plan of faults changes in it."""
        return with_faults(setup)

    def listener(self, setup: ResolvedConfiguration, folder: Path, emit: Emit) -> Emit:
        """`emit` with the faults after it and the operator's motion before it."""
        plan = fault_plan(setup)
        if plan.fault:
            self._injector = FaultInjector(plan, folder)
            emit = self._injector.listening(emit)
        return self._operator.listening(emit) if setup.by_hand else emit

    def connected(self, devices: Devices) -> None:
        """Give both the bench to act on."""
        if not isinstance(devices.clock, BenchClock):
            return
        self._operator.carry = devices.clock.carry
        if self._injector is not None:
            self._injector.order = devices.clock.order
