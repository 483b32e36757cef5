"""Longest blocking time of the GUI thread during a run, and memory use over hours.

A turn of the event loop, also that of the press of START, is judged by the CPU time of the GUI thread, so that other
processes do not decide.
"""

import itertools
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip("PySide6.QtWidgets", exc_type=ImportError)
os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

import numpy as np
from PySide6.QtCore import QCoreApplication, QObject, Qt, QTimer
from PySide6.QtWidgets import QApplication, QPushButton

from calstation.config import library
from calstation.gui.shell import create_window
from calstation.gui.shell.main_window import MainWindow
from calstation.gui.start import freeze_objects
from calstation.physics import GROUPS
from calstation.sequencer import StageProgress, StageStarted, StepStarted, TableMoved, Trace
from tests.database.result_files import write_result
from tests.site_folder import SiteFolder

RATE = 2000.0
#: s
MAY_BLOCK = 0.050

#: Units on the table, and runs in the history.
UNITS, OLD_RUNS = 16, 3000

#: Duration of the run on hardware to which the long stream corresponds.
HOURS = 12.0


class Probe(QObject):
    """A 5 ms timer on the GUI thread that measures its delay, and the CPU time of the thread in that delay."""

    def __init__(self) -> None:
        super().__init__()
        self.waits: list[float] = []
        self.works: list[float] = []
        self._wall, self._cpu = time.perf_counter(), time.thread_time()
        self._timer = QTimer(self, timerType=Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self._tick)
        self._timer.start(5)

    def _tick(self) -> None:
        wall, cpu = time.perf_counter(), time.thread_time()
        self.waits.append(wall - self._wall)
        self.works.append(cpu - self._cpu)
        self._wall, self._cpu = wall, cpu


@pytest.fixture
def window(window_site: SiteFolder) -> Iterator[MainWindow]:
    """A window connected to a bench whose unit sends 2000 samples per second."""
    profile = library.find("imus", "bench_nav").read_text(encoding="utf-8")
    assert "sample_rate_hz = 200.0" in profile
    (window_site.home / "imus").mkdir()
    fast = profile.replace("sample_rate_hz = 200.0", f"sample_rate_hz = {RATE}")
    (window_site.home / "imus" / "bench_nav.toml").write_text(fast, encoding="utf-8")
    made = create_window(window_site.station)
    assert isinstance(made, MainWindow)
    made.app.set_product(library.find("products", "short"))
    show_prepared(made)
    yield made
    made.close()


def until(condition: Callable[[], object], seconds: float) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        QApplication.processEvents()
        time.sleep(0.001)


def show_prepared(window: MainWindow) -> None:
    """Show a window, and wait until all of its pages have been created."""
    prepared = []
    window.prepared.connect(freeze_objects)
    window.prepared.connect(lambda: prepared.append(True))
    window.resize(1920, 1080)
    window.show()
    until(lambda: prepared, 60.0)


def resident() -> int:
    """Return the memory of this process, bytes."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.timeout(900)
def test_window_stays_responsive_over_a_whole_run(window: MainWindow, benchmark, figures) -> None:
    until(lambda: window.isVisible(), 10.0)
    button = window.findChild(QPushButton, "start_button")

    def run() -> Probe:
        probe = Probe()
        until(lambda: probe.works, 10.0)
        button.click()
        until(lambda: window.app.run.unit.verdict is not None or window.app.run.fault is not None, 800.0)
        return probe

    probe = benchmark.pedantic(run, rounds=1)
    assert window.app.run.state == "passed", window.app.run.fault
    log = window.app.run.unit.result.log
    samples = log.last_seq - log.first_seq + 1
    works, waits = np.array(probe.works), np.array(probe.waits)
    figures(
        samples=samples,
        longest_work_ms=round(1e3 * works.max(), 1),
        longest_wait_ms=round(1e3 * waits.max(), 1),
        wait_999_ms=round(1e3 * float(np.quantile(waits, 0.999)), 1),
        busy_percent=round(100.0 * works.sum() / waits.sum(), 1),
    )
    assert works.max() < MAY_BLOCK


@pytest.mark.timeout(1800)
def test_window_stays_responsive_during_a_batch_a_large_history_and_a_solution(
    window_site: SiteFolder, benchmark, figures
) -> None:
    log = window_site.run().log
    for k in range(OLD_RUNS):  # of other units than those on the table
        serial = f"SN-{900_000 + k % 400:06d}"
        write_result(window_site.runs, f"{serial}_{k}", k, serial)
    window_site.write(units=UNITS)
    window = create_window(window_site.station)
    app = window.app
    app.set_product(window_site.product)
    show_prepared(window)
    button = window.findChild(QPushButton, "start_button")
    until(lambda: button.isEnabled(), 120.0)

    def run() -> Probe:
        probe = Probe()
        until(lambda: probe.works, 10.0)
        button.click()
        until(lambda: app.run.in_progress and app.run.stage is not None, 300.0)
        window.offline_page.open(Path(log))
        until(lambda: window.offline_page.solve_button.isEnabled(), 300.0)
        window.offline_page.solve_button.click()
        for page in itertools.cycle(("history_page", "offline_page", "operator_page")):
            window.show_page(page)
            end = time.monotonic() + 2.0
            until(lambda end=end: time.monotonic() > end, 10.0)
            if app.run.ended:
                return probe
        raise AssertionError

    probe = benchmark.pedantic(run, rounds=1)
    works = np.array(probe.works)
    figures(
        units=UNITS,
        turns=len(works),
        longest_work_ms=round(1e3 * works.max(), 1),
        over_50_ms=int(np.sum(works > MAY_BLOCK)),
        work_999_ms=round(1e3 * float(np.quantile(works, 0.999)), 1),
    )
    window.close()
    assert works.max() < MAY_BLOCK


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is read from /proc")
@pytest.mark.timeout(900)
def test_memory_does_not_grow_during_a_run_of_hours(window: MainWindow, benchmark, figures) -> None:
    until(lambda: window.isVisible(), 10.0)
    window.app.run._running_changed(True) if window.app.engine_link.request else None
    sizes: list[int] = []

    def stream() -> None:
        emit = window.app.engine_link.event.emit
        emit(StageStarted("rate", 0, 1, 3600.0 * HOURS))
        count = int(HOURS * 3600.0 * 10.0)
        for k in range(count):
            now = 0.1 * k
            emit(TableMoved(0.1 * k, -0.1 * k, 0.1, -0.1, moving=True))
            emit(Trace((now, now + 0.05), (1e-3, 2e-3, 3e-3, 0.1, 0.2, 9.8) * 2))
            if k % 5 == 0:
                sigma = dict.fromkeys(GROUPS, 1.0 / (k + 1.0))
                emit(StageProgress("rate", k / count, 0.1 * (count - k), sigma))
            if k % 100 == 0:
                emit(StepStarted("rate", k, "move", ("whole_turns", "x", 720.0)))
            if k % 3 == 0:
                QCoreApplication.processEvents()
            if k % (count // 8) == 0:
                sizes.append(resident())

    benchmark.pedantic(stream, rounds=1)
    growth = (sizes[-1] - sizes[1]) / 2**20
    figures(hours=HOURS, first_mib=round(sizes[1] / 2**20), growth_mib=round(growth, 1))
    assert growth < 50.0
