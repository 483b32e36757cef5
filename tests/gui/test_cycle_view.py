"""The cycle times of a run on the engineer page and in the history: bars to scale, legend, results without phases."""

import json
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QLabel, QTabBar, QWidget
from pytestqt.qtbot import QtBot

from calstation.gui.engineer import EngineerPage
from calstation.gui.history import HistoryPage
from calstation.gui.shell.main_window import MainWindow
from calstation.gui.text import language
from calstation.gui.widgets import theme
from tests.gui.conftest import RESULT, Operator

pytestmark = [pytest.mark.long, pytest.mark.timeout(120)]
WAIT = 60_000
#: Phases of a run, 1000 s in all, 800 s of them in stages.
CYCLE = [
    {"phase": "opening", "seconds": 20.0},
    {"phase": "preparation", "seconds": 80.0},
    {"phase": "stage", "stage": "rate", "seconds": 300.0},
    {"phase": "pause", "seconds": 40.0},
    {"phase": "stage", "stage": "rate", "seconds": 100.0},
    {"phase": "solving", "stage": "rate", "seconds": 10.0},
    {"phase": "stage", "stage": "six_position", "seconds": 400.0},
    {"phase": "solving", "stage": "six_position", "seconds": 10.0},
    {"phase": "proof", "seconds": 40.0},
]


def write(folder: Path, name: str, **changes: Any) -> Path:
    """Write a result file without a log."""
    folder.mkdir(exist_ok=True)
    path = folder / f"{name}.json"
    started = {"started_utc": "2026-11-23T08:00:00+00:00", "log": {"file": f"{name}.h5"}}
    path.write_text(json.dumps({**RESULT, **started, **changes}), encoding="utf-8")
    return path


def widths(bar: QWidget) -> list[tuple[QColor, float]]:
    """Return the colours of a bar from left to right with their fractions of its width."""
    image = bar.grab().toImage()
    found: list[tuple[QColor, int]] = []
    for x in range(image.width()):
        colour = image.pixelColor(QPoint(x, image.height() // 2))
        if not found or found[-1][0] != colour:
            found.append((colour, 0))
        found[-1] = colour, found[-1][1] + 1
    return [(colour, count / image.width()) for colour, count in found if count > 2]


def open_cycle(window: MainWindow, path: Path, qtbot: QtBot) -> EngineerPage:
    """Open a result on the engineer page and click the cycle tab."""
    window.show_page("engineer_page")
    page = window.findChild(EngineerPage, "engineer_page")
    assert isinstance(page, EngineerPage)
    with qtbot.waitSignal(page.analysis.loaded, timeout=WAIT):
        page.analysis.open(path)
    tabs = page.findChild(QTabBar, "engineer_views")
    titles = [tabs.tabText(index) for index in range(tabs.count())]
    center = tabs.tabRect(titles.index("Cycle")).center()
    qtbot.mouseClick(tabs, Qt.MouseButton.LeftButton, pos=center)
    return page


def texts(page: QWidget) -> list[str]:
    """Return the texts of visible labels."""
    return [label.text() for label in page.findChildren(QLabel) if label.isVisible()]


@pytest.mark.parametrize("name", ["light", "dark"])
def test_bar_shows_the_phases_to_scale_in_both_languages(operator: Operator, qtbot: QtBot, name: str) -> None:
    window = operator.window
    theme.apply(name)
    try:
        page = open_cycle(window, write(operator.site_folder.runs, "one", cycle=CYCLE), qtbot)
        bar = page.findChild(QWidget, "cycle_bar")
        for code, words in (
            ("en", ("Cycle: 16:40.0", "Rate", "Preparation", "All stages", "Everything else")),
            ("zh_CN", ("节拍：16:40.0", "速率", "准备", "全部标定阶段", "其余合计")),
        ):
            language.use(code)
            qtbot.waitUntil(lambda words=words: set(words) <= set(texts(page)), timeout=WAIT)
            shown = texts(page)
            for numbers in (["6:40.0", "40.0 %"], ["13:20.0", "80.0 %"], ["3:20.0", "20.0 %"], ["0:20.0", "2.0 %"]):
                assert any(shown[k : k + 2] == numbers for k in range(len(shown))), (numbers, shown)
            shares = [share for _, share in widths(bar)]
            assert shares == pytest.approx([0.02, 0.08, 0.3, 0.04, 0.1, 0.01, 0.4, 0.01, 0.04], abs=0.005)
            colours = [colour for colour, _ in widths(bar)]
            assert colours[2] == colours[4], "a stage has one colour before and after a pause"
            assert len({colour.name() for colour in colours}) == 7
        others = [share for _, share in widths(page.findChild(QWidget, "cycle_others_bar"))]
        assert others == pytest.approx([0.1, 0.4, 0.2, 0.1, 0.2], abs=0.005)
    finally:
        theme.apply("light")


def test_result_without_phases_shows_a_message(operator: Operator, qtbot: QtBot) -> None:
    page = open_cycle(operator.window, write(operator.site_folder.runs, "old"), qtbot)
    assert page.analysis.cycle.currentWidget().isVisible()
    assert any("does not contain the phases of its run" in text for text in texts(page))
    language.use("zh_CN")
    qtbot.waitUntil(lambda: any("没有各环节的用时" in text for text in texts(page)), timeout=WAIT)
    language.use("en")
    new = write(operator.site_folder.runs, "new", cycle=CYCLE)
    with qtbot.waitSignal(page.analysis.loaded, timeout=WAIT):
        page.analysis.open(new)
    assert "Cycle: 16:40.0" in texts(page)


def test_history_shows_the_cycle_times_of_a_run(operator: Operator, qtbot: QtBot) -> None:
    write(operator.site_folder.runs, "one", cycle=CYCLE)
    operator.window.show_page("history_page")
    page = operator.window.findChild(HistoryPage)
    assert page is not None
    text = "16:40, of which 3:20 not in stages"
    qtbot.waitUntil(lambda: text in texts(page), timeout=WAIT)
    language.use("zh_CN")
    qtbot.waitUntil(lambda: "16:40，其中标定阶段以外 3:20" in texts(page), timeout=WAIT)
