"""`watch`: follow a log of IMUs on one body, calibrate what is off, keep what was found for the next."""

import sys
from pathlib import Path
from typing import Any

from rich.console import Console

from calstation.estimation.pairs.static import SENSORS
from calstation.estimation.pairs.watch import WatchEvent
from calstation.physics.units import DEGREE, DEGREE_PER_HOUR, MICRO_G
from calstation.results.pair_run import pair_folder, watch_log

_SAID = {
    "triggered": "a check is due; waiting for a rest",
    "checked": "imu{number} checked",
    "primary_off": "the primary is off itself ({sensors}); imu{number} is not calibrated against it",
    "calibrating": "off: {secondaries}; waiting for motion",
    "calibrated": "imu{number} calibrated; what was found is kept",
    "given_up": "given up: {why}",
}


def watch_command(log: Path, folder: Path | None, command: bool) -> int:
    """Follow `log`; 0 where every secondary is within its thresholds at the end or has been calibrated, 1 otherwise."""
    out = Console(file=sys.stdout)

    def tell(event: WatchEvent) -> None:
        said = _SAID[event.kind].format(
            number=event.number, **{k: _words(v) for k, v in event.values.items()}
        )
        out.print(f"{event.time:9.1f} s  {said}", highlight=False, markup=False)

    watched = watch_log(log, folder or pair_folder(), command, tell)
    calibrated = {e.number for e in watched.events if e.kind == "calibrated"}
    good = True
    for number, check in watched.checks.items():
        for sensor in SENSORS:
            shown = check.secondary[sensor]
            verdict = "within" if shown.within else "calibrated" if number in calibrated else "OFF"
            good = good and verdict != "OFF"
            size, unit = _unit(sensor, shown.limit)
            out.print(
                f"imu{number} {sensor}: {_plain(shown.value / size)} {unit} at rest"
                f" (threshold {_plain(shown.limit / size)} {unit})  {verdict}",
                highlight=False,
                markup=False,
            )
    if not watched.checks:
        out.print("no rest to check at", highlight=False)
    return 0 if good and watched.checks else 1


def _unit(sensor: str, limit: float) -> tuple[float, str]:
    """SI size and name of the unit in which a threshold is read easily."""
    if sensor == "gyro":
        return (DEGREE_PER_HOUR, "°/h") if limit < 0.1 * DEGREE else (DEGREE, "°/s")
    return (MICRO_G, "µg") if limit < 10_000 * MICRO_G else (1.0, "m/s²")


def _words(value: Any) -> Any:
    """Lists as words, numbers of IMUs with their name."""
    if not isinstance(value, list | tuple):
        return value
    return ", ".join(f"imu{item}" if isinstance(item, int) else str(item) for item in value)


def _plain(value: float) -> str:
    """Three digits, never as a power of ten."""
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"
