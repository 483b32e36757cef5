"""The operator page says what is missing before a start, and shows nothing of another station or product."""

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel, QLineEdit, QPushButton

from calstation.config import library
from calstation.sequencer import StateChanged
from tests.gui.conftest import Operator
from tests.gui.test_operator_events import simulated_run
from tests.gui.test_units import NO_ANSWER, use_slots

__all__ = ["simulated_run"]  # fixture


def test_refused_serial_number_is_not_ready_and_named_below(operator: Operator) -> None:
    assert "READY" in operator.says().split("\n")
    start = operator.widget("start_button", QPushButton)
    operator.scan("SN-000042")
    operator.qtbot.keyClick(start, Qt.Key.Key_Return)
    assert "Enter" in operator.message
    operator.scan("TX-1")
    assert operator.message.startswith("The serial number 'TX-1'")
    lines = operator.says().split("\n")
    assert "NOT READY" in lines
    assert "READY" not in lines
    operator.window.app.set_language("zh_CN")
    assert "TX-1" in operator.message
    assert "未就绪" in operator.says()
    operator.window.app.set_language("en")
    operator.scan("SN-000042")
    assert operator.message == "Load a unit, scan its serial number, and press START."
    assert "READY" in operator.says().split("\n")


def test_scan_before_the_fault_is_read_says_what_to_do(simulated_run: Operator) -> None:
    operator, link = simulated_run, simulated_run.window.app.engine_link
    link.event.emit(StateChanged("fault", "preparing"))
    link.event.emit(NO_ANSWER)
    link.running_changed.emit(False)
    operator.until(lambda: operator.verdict == "FAULT")
    operator.scan("SN-000043")
    notice = operator.widget("operator_notice")
    words = [text.text() for text in notice.findChildren(QLabel) if text.isVisible()]
    assert "Read the fault and press Understood first." in words
    operator.press("acknowledge_button")
    assert "Read the fault" not in operator.says()
    assert operator.widget("serial_edit", QLineEdit).text() == "SN-000043"
    assert operator.widget("start_button").isEnabled()


def test_slots_of_the_last_station_are_not_shown_at_an_unusable_one(operator: Operator) -> None:
    use_slots(operator, 16)
    assert operator.widget("slot_16_tile").isVisible()
    operator.window.app.set_station(library.find("stations", "virtual_hand"))
    assert not operator.widget("slot_16_tile").isVisible()
    assert not operator.window.operator_page._loading.isVisible()
    assert "No run with this station and product" in operator.says()
    operator.window.app.set_language("zh_CN")
    assert "该工位和产品不能标定" in operator.says()
    operator.window.app.set_language("en")
    operator.choose("mems_hand")
    assert "No run with this station and product" not in operator.says()
