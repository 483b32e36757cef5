"""The real window, offscreen, in a place of its own: no user's configuration, runs under the test's folder."""

import os

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from pytestqt.qtbot import QtBot

from calstation.gui import language, theme
from calstation.gui.app import create_window
from calstation.gui.main_window import MainWindow

QUICK = {"rate_dps": 100.0, "acceleration_dps2": 100.0}
SERIAL = "SN-000042"
PRODUCT: dict[str, Any] = {
    "name": "short",
    "imu": "bench_nav",
    "serial_pattern": r"SN-\d{6}",
    "schedule": {
        "rate": {"turns": 1, "dwell_s": 2.0, **QUICK},
        "six_position": {"dwell_s": 3.0, **QUICK},
        "excitation": {"rounds": 1, "dwell_s": 3.0, "place_dwell_s": 2.0, **QUICK},
        "azimuth_flip": {"rounds": 1, "dwell_s": 8.0, **QUICK},
    },
    "limits": {
        "gyro_bias": {"within": 1.5e-5, "sigma_below": 1e-5},
        "gyro_scale": {"within": 2e-3, "sigma_below": 1e-3},
        "accel_bias": {"within": 0.0074, "sigma_below": 6e-3},
        "accel_scale": {"within": 1e-3, "sigma_below": 1e-4},
    },
}
"""A whole calibration in a few minutes of device time, a few seconds of the bench's."""

STATION: dict[str, Any] = {
    "name": "test bench",
    "site": {"latitude_deg": 34.25, "longitude_deg": 108.9, "height_m": 400.0, "azimuth_deg": 0.0},
    "table": {"profile": "bench"},
}


class Place:
    """A site's own folder with one station and one product, and the runs made there."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.home = folder / "home"
        self.runs = folder / "runs"
        self.station = self.home / "stations" / "test.toml"
        self.product = self.home / "products" / "short.toml"
        for file in (self.station, self.product):
            file.parent.mkdir(parents=True)
        self.write()

    def write(self, product: dict[str, Any] | None = None, **bench: Any) -> None:
        """Write both files, with changes to the product and the bench's settings."""
        self.product.write_text(tomli_w.dumps({**PRODUCT, **(product or {})}), encoding="utf-8")
        settings = {"seed": 5, "start_deg": [1.0, -1.0], **bench}
        self.station.write_text(tomli_w.dumps({**STATION, "bench": settings}), encoding="utf-8")


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Place:
    """An empty place; configuration, settings and runs go nowhere else."""
    made = Place(tmp_path)
    monkeypatch.setenv("CALSTATION_HOME", str(made.home))
    monkeypatch.chdir(tmp_path)
    return made


@pytest.fixture
def window(place: Place, qtbot: QtBot) -> Iterator[MainWindow]:
    """The window on the place's station, English, light, shown at 1366x768."""
    made = create_window(place.station)
    assert isinstance(made, MainWindow)
    language.use("en")
    theme.apply("light")
    qtbot.addWidget(made)
    made.resize(1366, 768)
    made.show()
    qtbot.waitExposed(made)
    yield made
    made.app.close()
    language.use("en")
