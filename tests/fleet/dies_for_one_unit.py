"""Preload for workers in tests: solving the log of unit SN-00002 kills the worker."""

import os
import signal

from calstation.fleet import task
from calstation.results import resolve_log


def _resolve_log(log, *arguments, **more):
    if log.meta.imu.serial == "SN-00002":
        os.kill(os.getpid(), signal.SIGKILL)
    return resolve_log(log, *arguments, **more)


task.resolve_log = _resolve_log
