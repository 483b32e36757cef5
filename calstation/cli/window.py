"""`calstation` alone: the window where there is a screen, one click in the terminal where there is none."""

import os
import subprocess
import sys

#: What a window needs first; where a library or the screen is missing, Qt ends its process instead of telling.
_PROBE = "from PySide6.QtWidgets import QApplication; QApplication([])"

_PROBED_WITHIN = 60.0


def has_screen() -> bool:
    """Whether a window can be opened here."""
    if sys.platform in ("win32", "darwin"):
        return True
    if not any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")):
        return False
    try:
        probe = subprocess.run(
            [sys.executable, "-c", _PROBE], capture_output=True, timeout=_PROBED_WITHIN, check=False
        )
    except subprocess.TimeoutExpired:
        return False
    return probe.returncode == 0


def window_command() -> int | None:
    """Open the window and return its exit code when it is closed; None where there is no screen."""
    if not has_screen():
        return None
    from calstation.gui.shell.app import main

    return main()
