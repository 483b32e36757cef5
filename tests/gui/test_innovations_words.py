"""The share of outliers among the innovations of a stage is one of components, of which an epoch has three."""

from pathlib import Path

import numpy as np
import pytest
from PySide6.QtWidgets import QLabel
from pytestqt.qtbot import QtBot

from calstation.estimation.common import Consistency, RestResiduals
from calstation.estimation.method import Innovations
from calstation.gui.engineer.diagnostics_views import InnovationsView
from calstation.gui.state import AppContext
from calstation.results import Diagnostics, StageDiagnostics
from tests.gui.conftest import SERIAL


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("en", "4 epochs, 8.33 % of their 12 components beyond ±3 σ (0.27 % expected)"),
        ("zh_CN", "4 个历元，共 12 个分量，超出 ±3 σ 的占 8.33 %（理论 0.27 %）"),
    ],
)
def test_share_of_outliers_is_of_the_components(app: AppContext, qtbot: QtBot, code: str, words: str) -> None:
    normalised = np.zeros((4, 3))
    normalised[1, 2] = 4.0
    innovations = Innovations(np.arange(4), normalised)
    rests = RestResiduals(*(np.zeros(0) for _ in range(9)))
    stage = StageDiagnostics("rate", 0, 100.0, Consistency(1.0, 0.9, 1.1, 12), innovations, rests, ())
    view = InnovationsView()
    qtbot.addWidget(view)
    view.show()
    app.set_language(code)
    view.show_data(Diagnostics(Path("x.h5"), SERIAL, (stage,)))
    assert words in [each.text() for each in view.findChildren(QLabel)]
    app.set_language("en")
