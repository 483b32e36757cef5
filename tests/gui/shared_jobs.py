"""Job of the queue that is shared by the windows of several tests."""

import os

from calstation.jobs import ProgressCallback


def use_folder(report: ProgressCallback, folder: str, home: str) -> None:
    """Use a test's folder and site folder, as a process started there would."""
    os.chdir(folder)
    os.environ["CALSTATION_HOME"] = home
