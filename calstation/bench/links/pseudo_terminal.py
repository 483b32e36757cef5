"""Pseudo-terminals as serial lines (posix only)."""

import os
import sys


def open_raw() -> tuple[int, int, str]:
    """A new pseudo-terminal that passes bytes unchanged: master (non-blocking), slave, path of the slave.

    Raises OSError on platforms that have none.
    """
    if sys.platform == "win32":
        raise OSError("pseudo-terminals do not exist on Windows: use socket://")
    import tty

    master, slave = os.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    return master, slave, os.ttyname(slave)
