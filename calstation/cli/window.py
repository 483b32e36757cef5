"""`calstation` without a command: the window, or a run in the terminal if there is no screen."""

import os
import subprocess
import sys
from collections.abc import Callable


def window_command(run: Callable[[], int]) -> int:
    """Open the window; if there is no screen, call `run`. Returns the exit code."""
    if not has_screen():
        from calstation.cli.errors import complain
        from calstation.cli.text import say

        complain(say("cli.no_screen"))
        return run()
    from calstation.gui.shell import main

    return main()


def has_screen() -> bool:
    """Return whether a window can be opened on this computer."""
    if sys.platform in ("win32", "darwin"):
        return True
    if not any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")):
        return False
    # If a library or the screen is missing, Qt aborts the process without an exception, so test it in another process.
    probed = "from PySide6.QtWidgets import QApplication; QApplication([])"
    try:
        probe = subprocess.run([sys.executable, "-c", probed], capture_output=True, timeout=60.0, check=False)
    except subprocess.TimeoutExpired:
        return False
    return probe.returncode == 0
