"""The view of a gimbal solution tells the predicted from the observed convergence, and cautions of large sigmas."""

import numpy as np
import pytest
from PySide6.QtWidgets import QLabel
from pytestqt.qtbot import QtBot

from calstation.gui.logs.methods.gimbal_view import GimbalView
from calstation.gui.text import language
from calstation.physics import ARCSECOND
from calstation.results.plots import GimbalAxis, GimbalPlotData


def plot_data(sigma: float) -> GimbalPlotData:
    """Return a solution of an axis with four turns by 30°, and a sigma of its misalignments, ″."""
    drift = np.array([57.6, 40.2, 28.1, 19.6]) * ARCSECOND
    predicted = drift[0] * 0.192 ** np.arange(4)
    axis = GimbalAxis("x", np.deg2rad(30.0), drift, predicted, 1.0, 2.0, 1.2, 0.192, converged=True)
    return GimbalPlotData((axis,), 20.0 * ARCSECOND, {"gyro_misalign_xy": (1e-4, sigma * ARCSECOND)})


def said(view: GimbalView) -> str:
    return "\n".join(label.text() for label in view.findChildren(QLabel) if not label.isHidden())


@pytest.mark.parametrize(("sigma", "cautions"), [(5.0, False), (25.0, True)])
def test_predicted_and_observed_convergence_stand_beside_each_other(qtbot: QtBot, sigma: float, cautions: bool) -> None:
    view = GimbalView()
    qtbot.addWidget(view)
    view.show_data(plot_data(sigma))
    try:
        assert "57.6 → 19.6″; predicted: each leaves 19.2 %, observed: 69.8 %" in said(view)
        assert (
            "the largest sigma of the misalignments, 25.0″, exceeds the threshold of 20.0″" in said(view)
        ) == cautions
        language.use("zh_CN")
        qtbot.wait(10)
        assert "预测每次剩 19.2 %，实测 69.8 %" in said(view)
        assert ("安装误差的最大标准差 25.0″ 大于阈值 20.0″" in said(view)) == cautions
    finally:
        language.use("en")
