"""A folder with a short product and a virtual station, for runs through the real protocols."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import tomli_w

from calstation.config import RunRequest
from calstation.runs import RunHooks, execute
from calstation.sequencer import Command, Control, Event, Fault, Finalized

QUICK = {"rate_dps": 100.0, "acceleration_dps2": 100.0}
#: A whole calibration in a few minutes of device time, a few seconds on the bench.
PRODUCT: dict[str, Any] = {
    "name": "short",
    "imu": "bench_nav",
    "serial_pattern": r"SN-\d{6}",
    "schedule": {
        "rate": {"turns": 1, "dwell_s": 2.0, **QUICK},
        "six_position": {"dwell_s": 3.0, "oblique_dwell_s": 3.0, **QUICK},
        "excitation": {"rounds": 1, "dwell_s": 3.0, "place_dwell_s": 2.0, **QUICK},
        "azimuth_flip": {"rounds": 1, "dwell_s": 12.0, **QUICK},
    },
    "limits": {
        "gyro_bias": {"within": 1.5e-5, "sigma_below": 1e-5},
        "gyro_scale": {"within": 2e-3, "sigma_below": 1e-3},
        "accel_bias": {"within": 0.0074, "sigma_below": 6e-3},
        "accel_scale": {"within": 1e-3, "sigma_below": 1e-4},
    },
}
#: Changes for a product whose only stage judges all of its limits.
ONE_STAGE: dict[str, Any] = {
    "stages": ["six_position"],
    "limits": {name: PRODUCT["limits"][name] for name in ("accel_bias", "accel_scale")},
}
STATION: dict[str, Any] = {
    "name": "test bench",
    "site": {"latitude_deg": 34.25, "longitude_deg": 108.9, "height_m": 400.0, "azimuth_deg": 0.0},
    "table": {"profile": "bench"},
}
#: The bench's settings. Its watchdog runs in host time, and a busy computer may stand still for a second.
BENCH: dict[str, Any] = {"seed": 5, "start_deg": [1.0, -1.0]}


def with_corrected_output(profile: str) -> str:
    """Return a shipped profile changed to a unit whose only stream is corrected by its registers."""
    before, _, corrected = profile.partition("[corrected]\n")
    return before.replace('order = "before_registers"', 'order = "after_registers"') + corrected.split("\n", 1)[1]


class SiteFolder:
    """A folder with a station file, a product file and their runs.

    home : site folder of the program, in which the files are if it is given
    """

    def __init__(self, folder: Path, home: Path | None = None) -> None:
        self.folder, self.home = folder, home or folder
        self.runs = folder / "runs"
        self.product = folder / "product.toml" if home is None else home / "products" / "short.toml"
        self.station = folder / "station.toml" if home is None else home / "stations" / "test.toml"
        for file in (self.station, self.product):
            file.parent.mkdir(parents=True, exist_ok=True)
        self.events: list[Event] = []
        self.control = Control()
        self.hooks: type[RunHooks] | None = None  #: Instead of the hooks of the station.
        self.write()

    def write(
        self,
        product: dict[str, Any] | None = None,
        station: dict[str, Any] | None = None,
        *,
        surveyed: bool = True,
        **bench: Any,
    ) -> None:
        """Write both files, with changes to the product, the station and its bench; gravity may be unknown."""
        self.product.write_text(tomli_w.dumps({**PRODUCT, **(product or {})}), encoding="utf-8")
        site = {**STATION["site"], **({"gravity_mps2": 9.79547} if surveyed else {})}
        entries = {**STATION, "site": site, "bench": {**BENCH, **bench}, **(station or {})}
        self.station.write_text(tomli_w.dumps(entries), encoding="utf-8")

    def write_station(self, *, slots: list[dict[str, Any]], bench: dict[str, Any]) -> None:
        """Write the station file with slots for several units."""
        self.write(station={"slots": slots}, **bench)

    def request(self, *stages: str, serial: str = "SN-000042") -> RunRequest:
        """Request a run of these stages."""
        return RunRequest(serial, self.station, self.product, stages or None, self.runs, "tester")

    def run(self, *stages: str, on_event: Callable[[Event], None] | None = None) -> Finalized:
        """Run in this process and return the verdict."""

        def emit(event: Event) -> None:
            self.events.append(event)
            if on_event is not None:
                on_event(event)

        self.execute(emit, *stages)
        ended = self.events[-1]
        assert isinstance(ended, Finalized)
        assert Path(ended.result_file).is_file()
        return ended

    def execute(self, emit: Callable[[Event], None], *stages: str) -> None:
        """Run in this process. Raises the errors of `execute`."""
        execute(self.request(*stages), emit, self.control, self.hooks)

    def events_of(self, kind: type) -> list[Any]:
        """Return the events of a type."""
        return [event for event in self.events if isinstance(event, kind)]

    def fault(self) -> Fault:
        """Return the only fault."""
        (fault,) = self.events_of(Fault)
        return fault

    def once(self, kind: type, command: Command, *, after: int = 0) -> Callable[[Event], None]:
        """Send a command at the event of a type that follows `after` others."""
        seen = 0

        def watch(event: Event) -> None:
            nonlocal seen
            if isinstance(event, kind) and getattr(event, "stage", "x"):
                if seen == after:
                    self.control.send(command)
                seen += 1

        return watch
