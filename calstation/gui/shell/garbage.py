"""Garbage collection that runs only in the thread of the window."""

import gc

from PySide6.QtCore import QCoreApplication, QTimer

#: Interval at which the thresholds for a collection are checked, ms.
_INTERVAL = 500


def collect_in_this_thread(app: QCoreApplication) -> None:
    """Collect garbage with a timer of the application instead of in whichever thread creates an object.

    Otherwise, a thread that reads a pipe could delete widgets while Qt uses them, which crashes the process.
    """
    if gc.isenabled():
        gc.disable()
        timer = QTimer(app, interval=_INTERVAL)
        timer.timeout.connect(collect_garbage)
        timer.start()


def collect_garbage() -> None:
    """Collect the generations that an automatic collection would collect now."""
    for generation in (2, 1, 0):
        if gc.get_count()[generation] > gc.get_threshold()[generation]:
            gc.collect(generation)
            return
