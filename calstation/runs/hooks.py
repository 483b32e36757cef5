"""Hooks of a run, for example for a simulated operator, which do nothing by default."""

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
    """Callbacks of a run, which do nothing unless a subclass overrides them.

    Only a run on a virtual bench uses a subclass; see `station_hooks`.
    """

    def adjust(self, setup: RunConfiguration) -> RunConfiguration:
        """Return the configuration to use for the run. Raises ConfigurationError."""
        return setup

    def listener(self, setup: RunConfiguration, folder: Path, emit: Emit) -> Emit:
        """Return the listener for the events of the run whose log is in `folder`, before any device is opened."""
        return emit

    def connected(self, devices: Devices) -> None:
        """Process the devices after they have been opened and identified."""

    def log_opened(self, log: RawLogWriter) -> None:
        """Process the log of the run after it has been created."""


def station_hooks(station: StationConfig) -> RunHooks:
    """Return the hooks of a run at a station, which do nothing unless the station is a virtual bench."""
    if station.bench is None:
        return RunHooks()
    hooks: type[RunHooks] = load_bench().hooks
    return hooks()
