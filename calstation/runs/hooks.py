"""Hooks of a run, for instance for a simulated operator; by default they do nothing."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # the window names hooks, but has no use for devices and logs
    from calstation.config import ResolvedConfiguration
    from calstation.connection import Devices
    from calstation.records import RawLogWriter
    from calstation.sequencer import Emit


class RunHooks:
    """Accompanies one run; every method does nothing unless a subclass overrides it.

    `Engine.start` and `execute` take the class; the engine's process imports it.
    """

    def adjust(self, setup: ResolvedConfiguration) -> ResolvedConfiguration:
        """The configuration with which the run is made. Raises ConfigurationError."""
        return setup

    def listener(self, setup: ResolvedConfiguration, folder: Path, emit: Emit) -> Emit:
        """The sink of the run's events, whose log goes to `folder`; called before any device is opened."""
        return emit

    def connected(self, devices: Devices) -> None:
        """The devices are open and identified."""

    def log_opened(self, log: RawLogWriter) -> None:
        """The run's log is open and empty."""
