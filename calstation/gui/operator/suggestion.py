"""A serial number for the virtual bench, so that one click runs: the first of a row that has not passed yet."""

import re
from collections.abc import Callable

from calstation.config.summary import RunSummary

_TRIED = 1000


def suggested_serial(run_summary: RunSummary, passed: Callable[[str], bool]) -> str:
    """SN-000001 and so on where the bench takes any number, its own where its file names one; "" for hardware."""
    if run_summary.bench is None:
        return ""
    own = run_summary.bench.get("serial")
    if own is not None:
        return str(own)
    for number in range(1, _TRIED):
        serial = f"SN-{number:06d}"
        if not re.fullmatch(run_summary.serial_pattern, serial):
            return ""
        if not passed(serial):
            return serial
    return ""
