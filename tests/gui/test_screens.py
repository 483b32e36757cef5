"""The window on screens of several sizes and scales, each in a separate process."""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import QByteArray, QRect, QSettings

from tests.gui.conftest import SiteFolder

#: Opens the window, shows each page in the given languages, and prints the rectangles of its visible widgets.
SCRIPT = """
import json, sys
from pathlib import Path
from PySide6.QtWidgets import QApplication, QLabel, QPushButton, QWidget
from calstation.gui.shell import create_window
from calstation.gui.state.run_strip import RunStrip

def seen(widget):
    corner = widget.mapTo(window, widget.rect().topLeft())
    shown = widget.visibleRegion().boundingRect().size() == widget.size()
    return [corner.x(), corner.y(), widget.width(), widget.height()] if shown else None

if __name__ == "__main__":
    window = create_window(Path(sys.argv[1]))
    window.show()
    pages = []
    for code in sys.argv[2:]:
        window.app.set_language(code)
        for name in ("operator_page", "engineer_page", "offline_page", "history_page", "quality_page", "station_page"):
            window.show_page(name)
            for _ in range(5):
                QApplication.processEvents()
            status = [window.findChild(QLabel, "message_label"), *window.findChildren(RunStrip)]
            pages.append([name, seen(window.stop_button), [seen(each) for each in status if each.isVisible()]])
    screen, frame = window.screen().availableGeometry(), window.frameGeometry()
    state = {
        "screen": screen.getRect(), "frame": frame.getRect(), "window": window.rect().getRect(), "pages": pages,
        "tabs": window.page_tabs.tabBar().width(), "scale": window.devicePixelRatio(),
        "wanted_tabs": window.page_tabs.tabBar().sizeHint().width(),
    }
    print(json.dumps(state))
    window.close()
"""

pytestmark = pytest.mark.long


def on_screen(site_folder: SiteFolder, size: tuple[int, int], script: str, languages: Sequence[str] = ()) -> Any:
    """Run a script on a screen of this size, px, with languages as arguments, and return what it prints."""
    screen = {"name": "one", "x": 0, "y": 0, "width": size[0], "height": size[1], "logicalDpi": 96}
    screens = {"screens": [{**screen, "logicalBaseDpi": 96, "dpr": 1}]}
    (site_folder.folder / "screens.json").write_text(json.dumps(screens), encoding="utf-8")
    file = site_folder.folder / "on_screen.py"
    file.write_text(script, encoding="utf-8")
    command = [sys.executable, str(file), str(site_folder.station), *languages]
    platform = {"QT_QPA_PLATFORM": "offscreen:configfile=screens.json"}
    environment = {"PYTHONPATH": str(Path(__file__).parents[2]), **os.environ, **platform}
    done = subprocess.run(command, env=environment, cwd=site_folder.folder, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def shown(site_folder: SiteFolder, size: tuple[int, int], scale: float, *languages: str) -> dict[str, Any]:
    """Show the window on a screen of this size, px, at this scale, with its pages in these languages."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("QT_SCALE_FACTOR", str(scale))
        return dict(on_screen(site_folder, size, SCRIPT, languages))


def fits(seen: dict[str, Any]) -> bool:
    """Return whether the frame lies within the screen, with the logical pixels of the frame rounded up."""
    return QRect(*seen["screen"]).adjusted(0, 0, 1, 1).contains(QRect(*seen["frame"]))


@pytest.mark.parametrize(
    ("size", "scale"),
    [
        ((1920, 1080), 1.5),
        ((1366, 768), 1.0),
        pytest.param((1920, 1080), 2.0, marks=pytest.mark.exhaustive),
        pytest.param((1280, 720), 1.0, marks=pytest.mark.exhaustive),
        pytest.param((1600, 900), 1.25, marks=pytest.mark.exhaustive),
        pytest.param((2560, 1440), 2.0, marks=pytest.mark.exhaustive),
        pytest.param((1920, 1080), 1.0, marks=pytest.mark.exhaustive),
    ],
)
def test_window_fits_the_screen_with_stop_and_status_on_every_page(
    site_folder: SiteFolder, size: tuple[int, int], scale: float
) -> None:
    seen = shown(site_folder, size, scale, "en", "zh_CN")
    assert seen["scale"] == scale
    assert fits(seen)
    assert seen["tabs"] >= seen["wanted_tabs"]
    assert len(seen["pages"]) == 12
    for page, stop, status in seen["pages"]:
        for part in (stop, *status):
            assert part is not None, page
            assert QRect(*seen["window"]).contains(QRect(*part)), page
        assert status, page


def test_window_saved_on_a_larger_screen_fits_the_current_screen(site_folder: SiteFolder) -> None:
    shown(site_folder, (3840, 2160), 1.0)
    settings = QSettings(str(site_folder.home / "window.ini"), QSettings.Format.IniFormat)
    assert isinstance(settings.value("geometry"), QByteArray)
    seen = shown(site_folder, (1366, 768), 1.0)
    assert fits(seen)


#: Opens the window as the command does, and prints its scale and the one that other programs inherit.
PROGRAM = """
import json, os
from PySide6.QtWidgets import QApplication, QWidget

def report():
    window = next(each for each in QApplication.topLevelWidgets() if each.windowTitle() == "calstation")
    print(json.dumps([window.devicePixelRatio(), os.environ.get("QT_SCALE_FACTOR")]))
    window.close()
    return 0

if __name__ == "__main__":
    QApplication.exec = report
    from calstation.cli.app import run_app
    run_app([])
"""


@pytest.mark.parametrize(
    ("size", "scale", "enlarged"),
    [
        ((1366, 768), None, 1.0),
        ((1920, 1080), None, 1.4),
        pytest.param((1920, 1080), "1.5", 1.5, marks=pytest.mark.exhaustive),
        pytest.param((3840, 2160), "2", 2.8, marks=pytest.mark.exhaustive),
    ],
)
def test_window_of_the_command_grows_with_the_screen(
    site_folder: SiteFolder, size: tuple[int, int], scale: str | None, enlarged: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("QT_SCALE_FACTOR", raising=False)
    if scale is not None:
        monkeypatch.setenv("QT_SCALE_FACTOR", scale)
    ratio, inherited = on_screen(site_folder, size, PROGRAM)
    assert ratio == pytest.approx(enlarged)
    assert inherited == scale  # a viewer that the window opens is not enlarged
