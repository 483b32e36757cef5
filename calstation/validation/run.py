"""The whole validation: all areas in order, with progress and the remaining time."""

import os
import platform
import time
from collections.abc import Callable, Generator
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path

from calstation import __version__
from calstation.config import computer_user
from calstation.jobs import ProgressCallback
from calstation.messages import Text
from calstation.validation.computer import SystemClock, clock_lines, command_lines, disk_lines, rights_lines
from calstation.validation.installation import identity, installation_lines
from calstation.validation.lines import CheckStopped, Line, guarded
from calstation.validation.references import REFERENCES, reference_lines
from calstation.validation.rehearsals import CASES, rehearsal_lines
from calstation.validation.report import Validation, begin_record

#: Aspects that no validation on the virtual bench covers; the names are those of the family ``validation_scope``.
OUTSIDE = ("devices", "uncertainty", "network", "configuration", "people", "interpreter", "later")


def validate_installation(report: ProgressCallback, check_stopped: CheckStopped, runs: Path) -> Validation:
    """Run all checks and return their results. Raises StoppedError.

    Parameters
    ----------
    report : called with the fraction done, the remaining time, s, and the area
    check_stopped : raises StoppedError after Ctrl-C
    runs : folder of the runs, whose disk and rights are checked
    """
    started, begin, clock, runs = datetime.now(UTC), time.monotonic(), SystemClock(), runs.absolute()
    lines: list[Line] = []
    #: Area, its lines, their approximate number, and the share of the whole time at its end.
    areas: tuple[tuple[str, Callable[[], Generator[Line]], int, float], ...] = (
        ("rights", begin_record, 1, 0.0),
        ("installation", lambda: installation_lines(check_stopped), 100, 0.04),
        ("clock", clock_lines, 4, 0.05),
        ("disk", lambda: disk_lines(runs, check_stopped), 8, 0.05),
        ("rights", lambda: rights_lines(runs), 7, 0.05),
        ("calculation", lambda: reference_lines(check_stopped), 6 * REFERENCES, 0.25),
        ("time", lambda: command_lines(check_stopped), 1, 0.26),
        ("faults", lambda: rehearsal_lines(check_stopped), 3 * len(CASES), 1.0),
        ("clock", clock.lines, 1, 1.0),
        ("scope", _scope_lines, len(OUTSIDE), 1.0),
    )
    start = 0.0
    for area, make, count, end in areas:
        share = start
        report(share, _remaining(begin, share), area)
        with closing(guarded(area, "area", "", make)) as made:  # a rehearsal stops its runs when it is closed
            for number, line in enumerate(made, start=1):
                check_stopped()
                lines.append(line)
                share = start + (end - start) * min(number / count, 1.0)
                report(share, _remaining(begin, share), area)
        start = end
    report(1.0, 0.0, "")
    return Validation(
        computer=platform.node(),
        system=f"{platform.platform()}, {platform.machine()}, {os.cpu_count()} CPU",
        user=computer_user(),
        software=__version__,
        identity=identity(),
        started_utc=started.isoformat(timespec="seconds"),
        duration_s=round(time.monotonic() - begin, 1),
        lines=tuple(lines),
    )


def _remaining(begin: float, share: float) -> float | None:
    """Return the remaining time, s, estimated from the time used for a share of the whole."""
    return (time.monotonic() - begin) * (1.0 / share - 1.0) if share > 0.0 else None


def _scope_lines() -> Generator[Line]:
    for name in OUTSIDE:
        reason = Text(f"validation.outside_{name}")
        yield Line.unchecked("scope", name, "", "", reason, required=False)
