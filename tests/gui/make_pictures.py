"""Make the pictures of the window in `docs/images` for `make pictures`, or those named, from runs on the virtual bench.

The window is drawn off screen in its own font, so that the pictures do not depend on the computer.
"""

import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ |= {"QT_QPA_PLATFORM": "offscreen", "TZ": "UTC"}

from PySide6.QtCore import Qt
from PySide6.QtGui import QImage, QPixmap
from PySide6.QtWidgets import QApplication, QTabBar, QWidget

from calstation.config import library
from calstation.gui.shell import create_window
from calstation.gui.shell.main_window import MainWindow
from calstation.gui.text import language
from calstation.gui.widgets import TemperatureCurves, theme
from calstation.records import Verdict
from calstation.simulation import record_on_bench
from tests.thermal_results import thermal_result

FOLDER = Path(__file__).parents[2] / "docs" / "images"
#: Longest time for a part of a run, s.
WAIT = 120.0
#: Lowest set point of the pictured run over temperature, °C.
COLD = -42.0


def until(condition: Callable[[], object], seconds: float = WAIT) -> None:
    """Process events until a condition holds. Raises TimeoutError."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError
        QApplication.processEvents()
        time.sleep(0.005)


def save(widget: QWidget, name: str) -> None:
    """Save a picture of a widget after it has been drawn."""
    drawn(widget).save(str(FOLDER / f"{name}.png"))


def save_small(widget: QWidget, name: str) -> None:
    """Save a picture of a widget in 256 colours; those of Chinese chapters have names that end with ``.zh``."""
    suffix = ".png" if language.current() == "en" else ".zh.png"
    image = drawn(widget).toImage()
    image = image.convertToFormat(QImage.Format.Format_Indexed8, Qt.ImageConversionFlag.ThresholdDither)
    image.save(str(FOLDER / f"{name}{suffix}"), quality=0)


def drawn(widget: QWidget) -> QPixmap:
    """Return a widget after it has been drawn."""
    deadline = time.monotonic() + 0.5
    until(lambda: time.monotonic() > deadline)
    return widget.grab()


def open_window(station: str, product: str) -> MainWindow:
    """Open the window in its usual size with a shipped station and product."""
    window = create_window(library.find("stations", station))
    window.setWindowState(Qt.WindowState.WindowNoState)
    window.resize(1366, 768)
    window.show()
    window.create_engineer_page()
    window.app.set_product(library.find("products", product))
    start = window.operator_page.header.start_button
    until(start.isEnabled)
    return window


def picture_run() -> None:
    """Picture a run and the observability of its result."""
    window = open_window("virtual_bench", "nav_a")
    run = window.app.run
    window.operator_page.header.start_button.click()
    until(lambda: run.stage is not None and run.stage.name == "excitation" and run.stage.fraction > 0.6)
    save(window, "running")
    until(lambda: run.state == Verdict.PASSED and not window.app.engine_link.running)
    window.show_page("engineer_page")
    tabs = window.findChild(QTabBar, "engineer_views")
    assert isinstance(tabs, QTabBar)
    names = [tabs.tabText(index) for index in range(tabs.count())]
    until(lambda: not window.app.job_queue.busy)
    tabs.setCurrentIndex(names.index("Observability"))
    save(window, "observability")
    window.close()


def picture_by_hand() -> None:
    """Picture a position at rest on a manual rig."""
    window = open_window("virtual_hand", "mems_hand")
    panel = window.operator_page._live.position
    window.operator_page.header.start_button.click()
    until(lambda: panel._guided is not None and panel._guided.index >= 9 and panel._guided.state == "enough")
    save(window, "by_hand")
    window.app.run.stop()
    until(lambda: not window.app.engine_link.running)
    window.close()


def picture_method(folder: Path) -> None:
    """Picture the solution of a recording that was made by hand."""
    recording = record_on_bench(lambda *_, **__: None, "hand", folder / "hand.h5", "mems", 4)
    window = open_window("virtual_hand", "mems_hand")
    window.show_page("offline_page")
    window.offline_page.methods.select("multi_position")
    panel = window.offline_page.panel
    assert panel is not None
    panel.source.log_edit.setText(str(recording))
    panel.source.log_edit.returnPressed.emit()
    until(lambda: panel.solution is not None)
    save(panel.views, "methods")
    window.close()


def picture_over_temperature(chosen: str) -> None:
    """Picture a soak, the chamber after STOP, and the curve of a parameter of a unit with a small hysteresis."""
    window = open_window("virtual_chamber", "mems_c_thermal")
    window.app.set_language(chosen)
    window.app.runs_folder = Path(f"runs.{chosen}")  # otherwise START asks about the interrupted run
    run = window.app.run
    window.operator_page.header.start_button.click()
    until(lambda: run.chamber.latest is not None and run.chamber.latest.target_c == COLD)
    until(lambda: run.chamber.latest is not None and run.chamber.latest.air_c < COLD + 0.5)
    save_small(window, "temperature_soak")
    run.stop()
    until(lambda: run.chamber.latest is not None and run.chamber.latest.air_c > COLD + 20.0)
    save_small(window, "chamber_closed")
    until(lambda: not window.app.engine_link.running)
    curves = TemperatureCurves("curves_combo")
    curves.setStyleSheet(f"background: {theme.colours().window}")
    curves.resize(900, 480)
    curves.show_result(thermal_result())
    curves.show()
    save_small(curves, "over_temperature")
    curves.close()
    window.close()


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as home:
        os.environ["CALSTATION_HOME"] = home
        os.chdir(home)
        Path("window.ini").write_text("[General]\nlanguage=en\ntheme=light\nsounds=false\n", encoding="utf-8")
        pictures: dict[str, Callable[[], None]] = {
            "run": picture_run,
            "by_hand": picture_by_hand,
            "method": lambda: picture_method(Path(home)),
            "temperature": lambda: picture_over_temperature("en"),
            "temperature.zh": lambda: picture_over_temperature("zh_CN"),
        }
        for name in sys.argv[1:] or pictures:
            pictures[name]()
