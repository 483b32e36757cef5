"""The window is drawn in the shipped font."""

import pytest
from PySide6.QtGui import QFontInfo, QFontMetricsF
from PySide6.QtWidgets import QApplication

from calstation.gui.shell.main_window import MainWindow
from calstation.gui.widgets import theme


@pytest.mark.usefixtures("window")
def test_window_uses_the_shipped_font() -> None:
    font = QApplication.font()
    assert QFontInfo(font).family() == theme.FAMILY
    assert all(QFontMetricsF(font).inFontUcs4(ord(character)) for character in "aΩ²→标▼✓")


@pytest.mark.parametrize("bold", [False, True])
def test_figures_have_one_width(window: MainWindow, bold: bool) -> None:
    metrics = QFontMetricsF(theme.font(theme.SECTION, bold=bold))
    pairs = [first + second for first in "0123456789" for second in "0123456789"]
    assert len({metrics.horizontalAdvance(pair) for pair in pairs}) == 1
    assert metrics.horizontalAdvance("H") != QFontMetricsF(theme.font(theme.SECTION, bold=not bold)).horizontalAdvance(
        "H"
    )
