"""Runs tests on a screen with a window manager, where focus, dialogs and windows behave as on a workstation."""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

#: Programs of the screen, which GUI tests elsewhere do not need.
_PROGRAMS = ("Xvfb", "openbox", "xdotool")


def run_on_desktop(file: str) -> None:
    """Run the tests of a file in this folder on a virtual screen with openbox; skip if a program is missing."""
    missing = [name for name in _PROGRAMS if shutil.which(name) is None]
    if missing:
        pytest.skip(f"a screen with a window manager needs {', '.join(missing)}")
    reading, writing = os.pipe()
    screen = ["Xvfb", "-displayfd", str(writing), "-screen", "0", "1920x1080x24", "-nolisten", "tcp"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    server = subprocess.Popen(screen, pass_fds=[writing], **quiet)  # type: ignore[call-overload]
    os.close(writing)
    manager = None
    try:
        with os.fdopen(reading) as number:
            display = f":{number.readline().strip()}"
        environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST_", "QT_", "WAYLAND_"))}
        environment |= {"DISPLAY": display, "QT_QPA_PLATFORM": "xcb"}
        manager = subprocess.Popen(["openbox"], env=environment, **quiet)  # type: ignore[call-overload]
        options = ["-x", "-q", "-p", "no:xdist", "-p", "no:cacheprovider", "--timeout", "60"]
        command = [sys.executable, "-m", "pytest", *options, str(Path(__file__).with_name(file))]
        with tempfile.TemporaryFile("w+") as output:  # not a pipe, which background processes would keep open
            code = subprocess.call(command, env=environment, stdout=output, stderr=output, timeout=200)
            output.seek(0)
            assert code == 0, output.read()[-8000:]
    finally:
        for process in filter(None, (manager, server)):
            process.terminate()
            process.wait()


def press_key(name: str) -> None:
    """Press a key of the keyboard; the window that has the focus receives it."""
    subprocess.run(["xdotool", "key", name], check=True)


def click_at(x: int, y: int, button: int = 1) -> None:
    """Click with the mouse at a position of the screen."""
    subprocess.run(["xdotool", "mousemove", str(x), str(y), "click", str(button)], check=True)
