"""`watch`: follow a log of IMUs on one body, calibrate what is off, keep what was found for the next."""

import sys
from pathlib import Path

from rich.console import Console

from calstation.estimation.pair_static import SENSORS
from calstation.estimation.pair_watch import WatchEvent
from calstation.station.pair_run import pair_folder, watch_log

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
        said = _SAID[event.kind].format(number=event.number, **event.values)
        out.print(f"{event.time:9.1f} s  {said}", highlight=False, markup=False)

    watched = watch_log(log, folder or pair_folder(), command, tell)
    calibrated = {e.number for e in watched.events if e.kind == "calibrated"}
    good = True
    for number, check in watched.checks.items():
        for sensor in SENSORS:
            shown = check.secondary[sensor]
            verdict = "within" if shown.within else "calibrated" if number in calibrated else "OFF"
            good = good and verdict != "OFF"
            out.print(
                f"imu{number} {sensor}: {shown.value:.3g} at rest (threshold {shown.limit:.3g})  {verdict}",
                highlight=False,
                markup=False,
            )
    if not watched.checks:
        out.print("no rest to check at", highlight=False)
    return 0 if good and watched.checks else 1
