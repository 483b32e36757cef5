"""Hooks of a run, for example for a simulated operator; by default they do nothing."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # the window uses hooks but no devices or logs
    from calstation.config import RunConfiguration
    from calstation.connection import Devices
    from calstation.records import RawLogWriter
    from calstation.sequencer import Emit


class RunHooks:
    """Callbacks of one run; every method does nothing unless a subclass overrides it.

    Pass the class to `Engine.start` or `execute`; the engine's process imports it.
    """

    def adjust(self, setup: RunConfiguration) -> RunConfiguration:
        """Return the configuration to use for the run. Raises ConfigurationError."""
        return setup

    def listener(self, setup: RunConfiguration, folder: Path, emit: Emit) -> Emit:
        """Return the listener for the run's events, given the folder of its log. Called before any device is opened."""
        return emit

    def connected(self, devices: Devices) -> None:
        """Process the open and identified devices."""

    def log_opened(self, log: RawLogWriter) -> None:
        """Process the run's log, which is open and empty."""
