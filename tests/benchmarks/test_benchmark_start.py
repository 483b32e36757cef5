"""Time from the start of the process to the first paint of the window, as a ratio to a bare window with a plot."""

import statistics
import subprocess
import sys

import pytest

pytest.importorskip("PySide6.QtWidgets", exc_type=ImportError)

from tests.site_folder import SiteFolder

ROUNDS = 7
MOST = 1.3

_PAINTED = """
import sys, time
from PySide6.QtCore import QEvent, QObject
from PySide6.QtWidgets import QApplication

class Painted(QObject):
    def eventFilter(self, watched, event):
        if event.type() == QEvent.Type.Paint:
            print(time.monotonic() - float(sys.argv[1]), flush=True)
            import os
            os._exit(0)
        return False
"""
_BARE = (
    _PAINTED
    + """
import pyqtgraph
app = QApplication([])
painted = Painted()
app.installEventFilter(painted)
from PySide6.QtWidgets import QMainWindow
window = QMainWindow()
window.setCentralWidget(pyqtgraph.PlotWidget())
window.resize(1280, 720)
window.show()
app.exec()
"""
)
_CALSTATION = (
    _PAINTED
    + """
application = QApplication.__init__

def with_filter(self, *arguments):
    application(self, *arguments)
    self.painted = Painted()
    self.installEventFilter(self.painted)

QApplication.__init__ = with_filter
from calstation.gui import main
main((1280, 720))
"""
)


def first_paint(code: str) -> float:
    """Return the time from the start of a process to the first paint of its window, s."""
    program = f"import time\nbegin = time.monotonic()\nimport sys\nsys.argv[1:] = [str(begin)]\n{code}"
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60.0, check=False)
    return float(found.stdout.split()[-1])


@pytest.mark.timeout(300)
def test_first_paint_takes_little_longer_than_that_of_a_bare_window(
    window_site: SiteFolder, monkeypatch: pytest.MonkeyPatch, benchmark, figures
) -> None:
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")

    def measure() -> tuple[float, float]:
        pairs = [(first_paint(_BARE), first_paint(_CALSTATION)) for _ in range(ROUNDS)][1:]
        return statistics.median(bare for bare, _ in pairs), statistics.median(own for _, own in pairs)

    bare, own = benchmark.pedantic(measure, rounds=1)
    figures(bare_s=round(bare, 2), window_s=round(own, 2), ratio=round(own / bare, 2))
    assert own < MOST * bare
