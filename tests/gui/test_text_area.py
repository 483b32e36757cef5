"""Areas of texts that scroll end between two lines."""

from collections.abc import Iterator
from itertools import pairwise

import pytest
from PySide6.QtWidgets import QApplication, QLabel, QWidget
from pytestqt.qtbot import QtBot

from calstation.gui.widgets import PlainLabel, column, label, row, scroll_area
from calstation.gui.widgets.text_area import TextArea

TEXT = "Gyro bias x is 2.85 °/h, outside the acceptance limit ±2.7 °/h. " * 3

#: Number of lower edges that are computed at most after a change of the size.
MAX_STEPS = 40


def half_lines(content: QWidget, end: int) -> list[str]:
    """Return the texts with a line that is partly below `end`."""
    texts = []
    for each in content.findChildren(QLabel):
        top, height = each.mapTo(content, each.rect().topLeft()).y(), each.height()
        lines = round(height / each.fontMetrics().lineSpacing())
        edges = [top + number * height / lines for number in range(lines + 1)]
        if any(low + 1 < end < high - 1 for low, high in pairwise(edges)):
            texts.append(each.text())
    return texts


@pytest.mark.parametrize("width", [200, 433])
def test_no_line_of_text_is_cut_at_the_lower_edge(qtbot: QtBot, width: int) -> None:
    content, long = QWidget(), label(wrap=True)
    long.setText(TEXT)
    rows = [row(PlainLabel(f"Started {number}"), (PlainLabel("2026-11-28 08:14"), 1)) for number in range(12)]
    column(long, *rows, on=content, spacing=5)
    area = scroll_area(content, texts=True)
    qtbot.addWidget(area)
    area.show()
    cut = 0
    for height in range(90, 130):
        area.resize(width, height)
        qtbot.wait(1)
        bar = area.verticalScrollBar()
        assert bar.maximum() > 0
        for value in (0, 7, 40, bar.maximum()):
            bar.setValue(value)
            qtbot.wait(1)
            end = bar.value() + area.viewport().height()
            assert half_lines(content, end) == [], (height, value)
            cut += area.viewport().height() < height
        assert bar.value() + area.viewport().height() == content.height(), "the last line is visible"
    assert cut > 20


@pytest.mark.parametrize("squeezed", [False, True])
def test_lower_edge_is_found_in_a_few_steps_at_every_size(
    qtbot: QtBot, monkeypatch: pytest.MonkeyPatch, squeezed: bool
) -> None:
    """While the contents are laid out, a label may be lower than its lines; the edge must not depend on itself then."""
    content, first, last = QWidget(), label(wrap=True), label(wrap=True)
    for each in (first, last):
        each.setText(TEXT)
    if squeezed:
        last.setMaximumHeight(40)
    column(first, last, on=content)
    area = scroll_area(content, texts=True)
    qtbot.addWidget(area)
    area.show()
    lines, counts = TextArea._lines, [0]

    def counted(self: TextArea) -> Iterator[tuple[int, int]]:
        counts[-1] += 1
        assert counts[-1] < MAX_STEPS, (area.width(), area.height())
        return lines(self)

    monkeypatch.setattr(TextArea, "_lines", counted)
    for width in range(60, 400, 20):
        for height in range(24, 220, 7):
            counts.append(0)
            area.resize(width, height)
            QApplication.processEvents()
    assert max(counts) > 1
