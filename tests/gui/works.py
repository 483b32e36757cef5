"""Work for the workshop that windows of several tests share."""

import os

from calstation.jobs.queue import ProgressCallback


def live_in(tell: ProgressCallback, folder: str, home: str) -> None:
    """Go to a test's place, as a process started there would be."""
    os.chdir(folder)
    os.environ["CALSTATION_HOME"] = home
