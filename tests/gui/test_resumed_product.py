"""A resumed run of another product: the question names it, and the header names it from the start of the run."""

from pathlib import Path

import pytest
from PySide6.QtWidgets import QComboBox

from calstation.config import RunRequest, library
from calstation.results import History
from calstation.runs import finish_incomplete
from tests.dead_logs import META, write_dead_log
from tests.gui.conftest import Operator
from tests.gui.test_units import serials, started, use_slots

__all__ = ["started"]  # fixture

NAMES = [("en", "MEMS grade C"), ("zh_CN", "MEMS C 级")]


@pytest.fixture
def interrupted(operator: Operator, monkeypatch: pytest.MonkeyPatch) -> Operator:
    """An operator at a station with two slots, whose batch of another product than the chosen one was interrupted."""
    use_slots(operator, 2)
    monkeypatch.setitem(META, "product", {"name": "MEMS grade C"})
    runs, units = operator.window.app.runs_folder, ["SN-000001", "SN-000002"]
    files = {"product": {"name": "mems_c", "sha256": "0"}}
    run = {"batch": "B-7", "batch_units": units, "station": "test bench", "seed": 5, "files": files}
    for slot, serial in zip("12", units, strict=True):
        write_dead_log(runs, serial, slot=slot, **run)
    finish_incomplete(runs)
    History(runs).refresh()
    return operator


def chosen(operator: Operator) -> str:
    """Return the name of the product in the header."""
    return str(operator.widget("product_combo", QComboBox).currentText())


@pytest.mark.parametrize(("language", "name"), NAMES)
def test_header_names_the_product_of_a_resumed_run(
    interrupted: Operator, started: list[RunRequest], language: str, name: str
) -> None:
    app = interrupted.window.app
    app.set_language(language)
    before = chosen(interrupted)
    interrupted.window.operator_page._starting.interrupted.offer()
    interrupted.until(lambda: name in interrupted.says())
    assert chosen(interrupted) == before
    assert name != before
    interrupted.press("resume_choice")
    (request,) = started
    assert request.product == library.find("products", "mems_c")
    assert chosen(interrupted) == name
    assert app.product_path == request.product  # with which failed units are calibrated again


def test_question_of_start_names_the_product(interrupted: Operator, started: list[RunRequest]) -> None:
    assert serials(interrupted) == ("SN-000001", "SN-000002")
    interrupted.press("start_button")
    assert "as MEMS grade C" in interrupted.says()
    interrupted.press("resume_choice")
    assert [request.product and Path(request.product).stem for request in started] == ["mems_c"]
    assert chosen(interrupted) == "MEMS grade C"
