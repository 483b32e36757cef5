"""Garbage collection of the window's process in the thread of the window only."""

import gc

from PySide6.QtCore import QCoreApplication, QTimer

#: Interval at which garbage is collected if enough of it may have gathered, ms.
_INTERVAL = 500


def collect_in_this_thread(app: QCoreApplication) -> None:
    """Collect garbage by a timer of the application instead of in whichever thread creates an object.

    Threads that read pipes would delete widgets while Qt uses them, which crashes the process.
    """
    if gc.isenabled():
        gc.disable()
        timer = QTimer(app, interval=_INTERVAL)
        timer.timeout.connect(collect_garbage)
        timer.start()


def collect_garbage() -> None:
    """Collect the garbage of as many generations as an automatic collection would."""
    for generation in (2, 1, 0):
        if gc.get_count()[generation] > gc.get_threshold()[generation]:
            gc.collect(generation)
            return
