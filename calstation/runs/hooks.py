"""Hooks of a run, for example for a simulated operator; by default they do nothing."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from calstation.config import load_bench

if TYPE_CHECKING:  # the window uses hooks but no devices or logs
    from calstation.config import RunConfiguration, StationConfig
    from calstation.connection import Devices
    from calstation.records import RawLogWriter
    from calstation.sequencer import Emit


class RunHooks:
    """Callbacks of one run; every method does nothing unless a subclass overrides it.

    Only a run on a virtual bench has others, see `station_hooks`.
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


def station_hooks(station: StationConfig) -> RunHooks:
    """Return the hooks of a run at a station: those of its virtual bench, or hooks that do nothing on hardware."""
    if station.bench is None:
        return RunHooks()
    hooks: type[RunHooks] = load_bench().hooks
    return hooks()
