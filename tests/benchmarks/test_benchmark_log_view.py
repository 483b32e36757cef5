"""Blocking time and memory of the window while a one-hour log at 2 kHz is opened, zoomed and dragged."""

import os

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

import sys
from pathlib import Path
from time import perf_counter, thread_time

import numpy as np
import pytest

from calstation.estimation.common import SampleBlock
from calstation.records import LogMeta, RawLogWriter

RATE, HOURS = 2000.0, 1.0
META = {
    "site": {"latitude_deg": 34.25, "longitude_deg": 108.9, "height_m": 400, "azimuth_deg": 0.0},
    "imu": {
        "serial": "HOUR",
        "sample_rate_hz": RATE,
        "output": "increment",
        "gyro_lsb": 1e-8,
        "accel_lsb": 1e-6,
        "gyro_arw": 1e-7,
        "accel_vrw": 5e-5,
    },
}


@pytest.fixture(scope="module")
def hour(tmp_path_factory):
    """A one-hour raw log at 2 kHz in two stages: noise, slow rotations, a move every 10 s and some gaps."""
    path = tmp_path_factory.mktemp("hour") / "hour.h5"
    writer = RawLogWriter(path, LogMeta.model_validate(META))
    random = np.random.default_rng(1)
    count = int(HOURS * 3600 * RATE)
    for start in range(0, count, 20_000):
        seq = np.arange(start, start + 20_000, dtype=np.int64)
        seq += 500 * (seq // 1_000_000)
        angles = np.full((len(seq), 2), np.nan)
        angles[::100, 0] = np.sin(seq[::100] / 1e5)
        angles[::100, 1] = seq[::100] / 1e5
        writer.append(
            SampleBlock(
                "rate" if start < count // 2 else "excitation",
                seq,
                (seq + 1) / RATE,
                np.rint(random.normal(0.0, 1e3, (len(seq), 6)) + 1e5 * np.sin(seq / 3e4)[:, None]),
                angles,
                np.full(len(seq), start // 20_000, np.int64),
                np.ones(len(seq), np.bool_),
                np.full(len(seq), np.nan),
            )
        )
    writer.close("imported")
    return path


def resident() -> float:
    """Return the resident memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def test_zooming_a_one_hour_log_at_2_khz_does_not_block_the_window(hour, benchmark, figures, monkeypatch, tmp_path):
    from PySide6.QtWidgets import QApplication

    from calstation.gui.logs import OfflinePage
    from calstation.gui.state import AppContext
    from calstation.gui.widgets import theme

    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path))
    qt = QApplication.instance() or QApplication(sys.argv[:1])
    qt.setStyle("Fusion")
    theme.apply("light")
    app = AppContext()
    page = OfflinePage(app)
    page.resize(1920, 960)
    page.show()
    longest = {"wall": 0.0, "busy": 0.0}

    def turn():
        begin, busy = perf_counter(), thread_time()
        qt.processEvents()
        longest["wall"] = max(longest["wall"], perf_counter() - begin)
        longest["busy"] = max(longest["busy"], thread_time() - busy)

    def until(done):
        while not done():
            turn()

    turn()
    begin = perf_counter()
    page.open(hour)
    until(lambda: page.log is not None)
    opening = perf_counter() - begin
    turn()
    before = resident()
    finest = []

    def look_around():
        plot = page.plot
        for _ in range(16):
            plot.zoom(True)
            for _ in range(5):
                turn()
        until(lambda: plot.samples_per_column == 1)
        finest.append(plot.samples_per_column)
        for _ in range(16):
            plot.zoom(False)
            for _ in range(5):
                turn()
        left, right = plot.view
        for share in (0.3, 0.05, 0.002):
            for place in np.linspace(left, right, 40):
                plot.show_part(*(round(RATE * s) for s in (place, place + share * (right - left))))
                for _ in range(3):
                    turn()
        plot.whole()
        turn()

    benchmark.pedantic(look_around, rounds=1)
    grown = resident() - before
    app.close()
    figures(
        opening_s=round(opening, 1),
        longest_block_ms=round(1e3 * longest["wall"], 1),
        longest_busy_ms=round(1e3 * longest["busy"], 1),
        window_grew_mb=round(grown, 1),
    )
    assert finest == [1]
    assert longest["busy"] < 0.1
    assert grown < 100.0
