"""Keys during a run in a terminal."""

import os
import pty
import subprocess
import sys

import pytest

IN_BACKGROUND = """
import os, subprocess, sys
running = subprocess.Popen([sys.executable, "-c", sys.argv[1]], process_group=0)
_, status = os.waitpid(running.pid, os.WUNTRACED)
sys.exit(1 if os.WIFSTOPPED(status) else os.waitstatus_to_exitcode(status))
"""
LISTENS = "import time; from calstation.cli.show import on_line; on_line('e', print); time.sleep(0.5)"


@pytest.mark.long
def test_background_run_is_not_suspended_by_reading_the_keyboard() -> None:
    child, terminal = pty.fork()
    if child == 0:
        os._exit(subprocess.call([sys.executable, "-c", IN_BACKGROUND, LISTENS]))
    _, status = os.waitpid(child, 0)
    os.close(terminal)
    assert os.waitstatus_to_exitcode(status) == 0
