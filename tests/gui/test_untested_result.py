"""A parameters-only result is shown without a verdict, and no register is written from it."""

from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QTabBar
from synthetic.many_logs import record_logs

from calstation.gui.engineer import EngineerPage
from calstation.gui.text import language
from calstation.results import resolve, write_json
from tests.gui.conftest import Operator
from tests.helpers import ignore_progress

pytestmark = pytest.mark.timeout(120)


@pytest.mark.long
def test_parameters_only_result_has_no_verdict_on_the_engineer_page(operator: Operator, tmp_path: Path) -> None:
    (log,) = record_logs(ignore_progress, tmp_path / "logs", 1, seed=4)
    file = tmp_path / "alone.json"
    write_json(file, resolve(log, diagnostics=False).result.to_json())
    operator.window.show_page("engineer_page")
    page = operator.window.findChild(EngineerPage, "engineer_page")
    assert page is not None
    page.analysis.open(file)
    operator.until(lambda: page.analysis.result.view.finished is not None)
    operator.until_no_job()
    tabs = page.findChild(QTabBar, "engineer_views")
    for number in (*range(tabs.count()), 1):
        operator.qtbot.mouseClick(tabs, Qt.MouseButton.LeftButton, pos=tabs.tabRect(number).center())
        operator.until_no_job()
    assert tabs.currentIndex() == 1
    assert "solved offline, parameters only: not judged" in operator.says()
    assert page.registers.target is None
    language.use("zh_CN")
    assert "离线解算，仅参数：不作判定" in operator.says()
    assert page.registers.why_not_write()
