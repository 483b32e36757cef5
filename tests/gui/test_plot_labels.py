"""Labels of axes are centred on their axes, and do not cover the ticks."""

import numpy as np
import pyqtgraph as pg
import pytest
from pytestqt.qtbot import QtBot

from calstation.gui.widgets import ThemedPlot


@pytest.mark.parametrize("text", ["horizontal, °/h", "水平角速率，°/h"])
def test_label_set_after_the_plot_is_shown_is_centred_beside_the_ticks(qtbot: QtBot, text: str) -> None:
    plot = ThemedPlot()
    qtbot.addWidget(plot)
    plot.resize(600, 200)
    plot.addItem(pg.PlotDataItem(np.arange(5.0), np.arange(5.0)))
    plot.show()
    qtbot.wait(50)
    for side in ("left", "bottom"):
        plot.setLabel(side, text)
        axis = plot.getAxis(side)
        box, size = axis.mapRectFromItem(axis.label, axis.label.boundingRect()), axis.size()
        along = box.center().y() - size.height() / 2 if side == "left" else box.center().x() - size.width() / 2
        assert abs(along) < 2.0
    ticks = plot.getAxis("bottom").textHeight
    assert box.top() >= ticks - 5.0, "below the numbers"
