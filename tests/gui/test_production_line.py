"""Production features of the operator page, operated by real clicks: sounds, badges, shift counter, picture, labels."""

import json
import socket
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import QPoint, QSettings, Qt, QUrl
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import QCheckBox, QLabel, QLineEdit, QPushButton, QWidget

from calstation import sound
from calstation.config import ConfirmationRequired, library
from calstation.gui.operator import starting
from calstation.gui.operator.loading import Loading
from calstation.gui.operator.production import shift_counter
from calstation.gui.state.engine_link import EngineLink
from calstation.jobs import JobQueue
from calstation.results import ShiftCount
from calstation.sequencer import StateChanged
from tests.dead_logs import write_dead_log
from tests.gui.conftest import RESULT, SERIAL, Operator
from tests.gui.test_operator_events import end_run, simulated_run
from tests.site_folder import ONE_STAGE, STATION

NAMES = {"B1234": "Li Na", "B5678": "Wang Wei"}
ZPL = "^XA^CI28^FO16,16^FD$serial^FS^FO16,64^FD$product $station $operator $verdict^FS^XZ\n"

__all__ = ["simulated_run"]


def use_station(operator: Operator, product: dict[str, Any] | None = None, **station: Any) -> None:
    """Configure the product and the station of the window with these entries."""
    operator.site_folder.write(product, station)
    operator.window.app.set_station(operator.site_folder.station)


def sign_in(operator: Operator, badge: str) -> None:
    """Type a badge and Enter into the operator's field, as a scanner does."""
    edit = operator.widget("operator_edit", QLineEdit)
    edit.setFocus()
    edit.selectAll()
    operator.qtbot.keyClicks(edit, badge)
    operator.qtbot.keyClick(edit, Qt.Key.Key_Return)


def run_to_pass(operator: Operator) -> None:
    """Calibrate a unit on the virtual bench."""
    operator.scan(SERIAL)
    operator.press("start_button")
    operator.until(lambda: operator.verdict)
    assert operator.verdict == "PASS", operator.says()
    operator.until_ended()


# ---- sounds


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the sounds that the page has requested."""
    names: list[str] = []
    monkeypatch.setattr(starting, "play", names.append)
    return names


@pytest.mark.long
def test_scan_gives_a_symbol_and_a_sound_unless_muted(operator: Operator, played: list[str]) -> None:
    operator.scan(SERIAL)
    assert played == [], "the computer of the tests is muted"
    operator.window.show_page("station_page")
    box = operator.widget("sounds_check", QCheckBox)
    assert not box.isChecked()
    operator.qtbot.mouseClick(box, Qt.MouseButton.LeftButton, pos=QPoint(10, box.height() // 2))
    assert box.isChecked()
    operator.window.show_page("operator_page")
    symbol = operator.widget("serial_symbol", QWidget)
    operator.scan(SERIAL)
    assert played == ["accepted"]
    assert symbol.isVisible()
    assert "Serial number: accepted" in operator.says()
    operator.qtbot.keyClicks(operator.widget("serial_edit", QLineEdit), "x")
    assert not symbol.isVisible(), "an edited number has not been checked"
    operator.scan("WRONG 1")
    assert played == ["accepted", "refused"]
    assert symbol.isVisible()
    assert "Serial number: not valid" in operator.says()
    stored = QSettings(str(operator.site_folder.home / "window.ini"), QSettings.Format.IniFormat)
    operator.window.app.settings.sync()
    assert stored.value("sounds", type=bool) is True


@pytest.mark.parametrize("name", ["accepted", "refused"])
def test_sounds_can_be_played_without_an_audio_device(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sound, "_OPEN_S", 0.05)
    sound._play(name)
    monkeypatch.setattr(sound, "_SERVICES", ("NULL",))
    sound._play(name)
    monkeypatch.setitem(sys.modules, "miniaudio", None)
    sound._play(name)


# ---- sign-in


def test_without_sign_in_the_operator_is_optional(operator: Operator) -> None:
    assert operator.widget("operator_edit", QLineEdit).text() == ""
    assert operator.widget("start_button").isEnabled()
    assert not operator.widget("sign_out_button").isVisible()


@pytest.mark.long
def test_start_requires_a_badge_if_the_station_requires_it(operator: Operator) -> None:
    use_station(operator, ONE_STAGE, sign_in={"badge_pattern": r"B\d{4}", "names": NAMES})
    edit, start = operator.widget("operator_edit", QLineEdit), operator.widget("start_button", QPushButton)
    assert edit.text() == ""
    assert not start.isEnabled()
    assert start.toolTip() == "Scan your badge first."
    assert operator.message == "Scan your badge first."
    assert operator.window.focusWidget() is edit

    sign_in(operator, "B0000")
    assert "“B0000” is not a badge of this station." in operator.says()
    assert not start.isEnabled()
    sign_in(operator, "B1234")
    assert "B0000" not in operator.says()
    assert edit.text() == "Li Na"
    assert edit.isReadOnly()
    assert start.isEnabled()
    assert operator.window.app.operator == "Li Na"
    assert operator.window.focusWidget() is operator.widget("serial_edit")

    operator.press("sign_out_button")
    assert edit.text() == ""
    assert operator.window.app.operator is None
    assert not start.isEnabled()
    assert operator.window.focusWidget() is edit
    sign_in(operator, "B5678")
    run_to_pass(operator)
    (result,) = (json.loads(path.read_text(encoding="utf-8")) for path in operator.site_folder.runs.glob("SN-*.json"))
    assert result["operator"] == "Wang Wei"


def test_badge_scanned_into_the_serial_field_signs_in(operator: Operator, played: list[str]) -> None:
    operator.window.app.settings.setValue("sounds", True)
    use_station(operator, sign_in={"badge_pattern": r"B\d{4}"})
    operator.scan("B77")
    assert "does not match this product" in operator.says()
    operator.scan("B1234")
    edit = operator.widget("operator_edit", QLineEdit)
    assert edit.text() == "B1234"
    assert "does not match this product" not in operator.says()
    assert operator.widget("serial_edit", QLineEdit).text() != "B1234"
    operator.scan(SERIAL)
    assert operator.window.focusWidget() is operator.widget("start_button")
    operator.scan("B5678")
    assert edit.text() == "B5678", "the next operator takes over"
    assert played == ["refused", "accepted", "accepted", "accepted"]


@pytest.mark.parametrize(
    ("language", "unknown", "unit"),
    [
        ("en", "“B9999” is not a badge of this station.", "Scan your badge first, then the unit."),
        ("zh_CN", "“B9999”不是本工位的工牌。", "请先扫描工牌，再扫描产品。"),
    ],
)
def test_unknown_badge_is_not_taken_for_a_unit(operator: Operator, language: str, unknown: str, unit: str) -> None:
    """It also has the form of a serial number of the shipped products."""
    use_station(operator, {"serial_pattern": r"[A-Z]+-?\d+"}, sign_in={"badge_pattern": r"B\d{4}", "names": NAMES})
    operator.window.app.set_language(language)
    sign_in(operator, "B9999")
    assert unknown in operator.says()
    assert unit not in operator.says()
    sign_in(operator, SERIAL)
    assert unit in operator.says()
    sign_in(operator, "B1234")
    operator.scan("B9999")  # a number of both forms that is not listed is a serial number
    assert operator.widget("start_button").isEnabled()
    assert operator.widget("operator_edit", QLineEdit).text() == "Li Na"


@pytest.mark.parametrize(
    ("language", "asked"),
    [("en", "Scan your badge on the Operator page"), ("zh_CN", "请在操作员页扫描工牌")],
)
def test_sign_in_removes_the_notice_that_nobody_has_signed_in(operator: Operator, language: str, asked: str) -> None:
    use_station(operator, sign_in={"badge_pattern": r"B\d{4}"})
    operator.window.app.set_language(language)
    page, required = operator.window.operator_page, ConfirmationRequired(pin=False, badge=True, second=False)
    for button in (page._verdicts._certificates, page._verdict.certificate_button):
        assert button._person(required) is None
        assert asked in operator.says()
        sign_in(operator, "B1234")
        assert asked not in operator.says()
        operator.press("sign_out_button")
    page._documents.inform("none", "operator.certificates_exist", "", page.setFocus)
    sign_in(operator, "B1234")
    assert operator.widget("documents_notice").isVisible()  # it has another subject


@pytest.mark.long
@pytest.mark.parametrize(("language", "asked"), [("en", "Scan your badge first."), ("zh_CN", "请先扫描工牌。")])
def test_sign_in_removes_the_notice_of_the_history_page(operator: Operator, language: str, asked: str) -> None:
    use_station(operator, sign_in={"badge_pattern": r"B\d{4}"})
    operator.window.app.set_language(language)
    operator.window.show_page("history_page")
    page = operator.window._tabs["history_page"].page
    page._close_run()
    assert asked in operator.says()
    operator.window.app.identified.emit("B1234")
    assert asked not in operator.says()


@pytest.mark.parametrize(
    ("language", "asked", "refused"),
    [("en", "Scan your badge first.", "cannot be resumed"), ("zh_CN", "请先扫描工牌。", "无法继续")],
)
def test_resume_without_a_badge_asks_for_it_and_does_not_say_that_the_run_cannot_be_resumed(
    operator: Operator, language: str, asked: str, refused: str
) -> None:
    use_station(operator, sign_in={"badge_pattern": r"B\d{4}"})
    operator.window.app.set_language(language)
    write_dead_log(operator.window.app.runs_folder, station="test bench", seed=5)
    operator.window.operator_page._starting.interrupted.recover()
    operator.until(lambda: operator.window.findChild(QPushButton, "resume_choice") is not None)
    operator.press("resume_choice")
    assert asked in operator.widget("operator_notice").text_label.text()
    assert refused not in operator.says()
    assert operator.window.focusWidget() is operator.widget("operator_edit")
    sign_in(operator, "B1234")
    operator.until(lambda: operator.window.findChild(QPushButton, "resume_choice") is not None)


def test_scan_without_a_focused_field_goes_to_the_badge_field_first(operator: Operator) -> None:
    use_station(operator, sign_in={"badge_pattern": r"B\d{4}"})
    operator.widget("product_combo").setFocus()
    operator.qtbot.keyClick(operator.widget("product_combo"), "B")
    edit = operator.widget("operator_edit", QLineEdit)
    assert operator.window.focusWidget() is edit
    assert edit.text().upper() == "B"


def test_idle_operator_is_signed_out(operator: Operator) -> None:
    use_station(operator, sign_in={"badge_pattern": r"B\d{4}", "idle_minutes": 0.002})
    sign_in(operator, "B1234")
    operator.until(lambda: not operator.widget("start_button").isEnabled())
    assert operator.widget("operator_edit", QLineEdit).text() == ""
    assert operator.message == "Signed out after a time without input. Scan your badge first."


@pytest.mark.parametrize(
    ("language", "message", "refusal"),
    [
        (
            "en",
            "Signed out after a time without input. Scan your badge first.",
            "Scan your badge first, then the unit.",
        ),
        ("zh_CN", "长时间无操作，已退出登录。请先扫描工牌。", "请先扫描工牌，再扫描产品。"),
    ],
)
def test_result_of_a_signed_out_operator_asks_for_the_badge(
    simulated_run: Operator, language: str, message: str, refusal: str
) -> None:
    use_station(simulated_run, sign_in={"badge_pattern": r"B\d{4}", "idle_minutes": 60.0})
    simulated_run.window.app.set_language(language)
    sign_in(simulated_run, "B1234")
    link = simulated_run.window.app.engine_link
    link.event.emit(StateChanged("running", "preparing"))
    end_run(simulated_run, "stopped", advice="begin_again")
    assert simulated_run.message != message
    simulated_run.window.operator_page.header.badge_field._sign_out_idle()
    assert simulated_run.message == message
    assert simulated_run.says().count(message) == 2, "the bold sentence below the verdict says it, too"
    sign_in(simulated_run, SERIAL)
    assert refusal in simulated_run.says()
    sign_in(simulated_run, "B1234")
    assert message not in simulated_run.says()


@pytest.mark.long
def test_confirmation_after_sign_out_starts_no_run(operator: Operator, monkeypatch: pytest.MonkeyPatch) -> None:
    use_station(operator, ONE_STAGE, sign_in={"badge_pattern": r"B\d{4}", "names": NAMES})
    started: list[Any] = []
    monkeypatch.setattr(EngineLink, "start", lambda _, request: started.append(request))
    monkeypatch.setattr(JobQueue, "uses_device", True)
    sign_in(operator, "B1234")
    operator.scan(SERIAL)
    operator.press("start_button")
    assert "then press START again" in operator.says()
    monkeypatch.setattr(JobQueue, "uses_device", False)
    operator.window.operator_page.header.badge_field.sign_out()
    operator.press("clear_choice")
    assert "signs in with a badge" in operator.says()
    assert started == []
    sign_in(operator, "B5678")
    operator.scan(SERIAL)
    operator.press("start_button")
    assert [request.operator for request in started] == ["B5678"]


@pytest.mark.long
def test_engineer_page_starts_no_run_without_a_badge(operator: Operator, monkeypatch: pytest.MonkeyPatch) -> None:
    use_station(operator, ONE_STAGE, sign_in={"badge_pattern": r"B\d{4}", "names": NAMES})
    started: list[Any] = []
    monkeypatch.setattr(EngineLink, "start", lambda _, request: started.append(request))
    operator.window.show_page("engineer_page")
    start = operator.widget("engineer_start_button", QPushButton)
    edit = operator.widget("engineer_serial_edit", QLineEdit)
    edit.clear()
    operator.qtbot.keyClicks(edit, SERIAL)
    assert not start.isEnabled()
    assert start.toolTip() == "Scan your badge first."
    operator.window.show_page("operator_page")
    sign_in(operator, "B1234")
    operator.window.show_page("engineer_page")
    operator.press("engineer_start_button")
    assert [request.operator for request in started] == ["B1234"]


# ---- scans at any time


@pytest.mark.long
def test_scan_during_a_run_does_not_stop_it(operator: Operator) -> None:
    use_station(operator, ONE_STAGE)
    operator.scan(SERIAL)
    operator.press("start_button")
    operator.until(operator.in_a_stage)
    for key in (Qt.Key.Key_Space, Qt.Key.Key_Return):
        operator.qtbot.keyClick(operator.window.focusWidget() or operator.window, key)
    assert operator.run.state == "running"
    operator.until(lambda: operator.verdict)
    assert operator.verdict == "PASS"
    operator.scan("SN-000077")
    operator.until_ended()
    assert operator.widget("serial_edit", QLineEdit).text() == "SN-000077"
    assert operator.widget("start_button").isEnabled()
    assert operator.window.focusWidget() is operator.widget("start_button")


# ---- shift counter


def write_result(folder: Path, serial: str, outcome: str, started: datetime, **more: Any) -> None:
    """Write the result of a run."""
    folder.mkdir(exist_ok=True)
    name = f"{serial}_{started:%Y%m%dT%H%M%S}"
    result = {
        **RESULT,
        "unit": {"serial": serial},
        "outcome": outcome,
        "station": STATION["name"],
        "log": {"file": f"{name}.h5"},
        "started_utc": started.isoformat(timespec="seconds"),
        "duration_s": 600.0,
        **more,
    }
    (folder / f"{name}.json").write_text(json.dumps(result), encoding="utf-8")


@pytest.mark.long
def test_shift_counter_is_updated_while_idle_and_after_a_verdict(operator: Operator) -> None:
    label = operator.widget("shift_label", QLabel)
    operator.until(lambda: label.text() == "Since 00:00  ·  0 done")
    noon = datetime.now().astimezone().replace(hour=0, minute=0, second=1, microsecond=0).astimezone(UTC)
    write_result(operator.site_folder.runs, "SN-000001", "passed", noon)
    write_result(operator.site_folder.runs, "SN-000002", "failed", noon)
    write_result(operator.site_folder.runs, "SN-000003", "passed", noon - timedelta(days=1))
    use_station(operator, ONE_STAGE)
    counts = "2 done  ·  1 passed  ·  1 failed  ·  yield 50.0 %  ·  10:00 of table time per unit"
    operator.until(lambda: counts in label.text())
    operator.window.app.set_language("zh_CN")
    assert label.text().endswith("平均每台转台时间 10:00")
    operator.window.app.set_language("en")
    run_to_pass(operator)
    operator.until(lambda: "3 done  ·  2 passed  ·  1 failed  ·  yield 66.7 %" in label.text())
    assert label.isVisible()
    operator.widget("language_combo").setCurrentIndex(1)
    assert "完成 3" in label.text()


@pytest.mark.parametrize(("code", "text"), [("en", "10:00 on the rig per unit"), ("zh_CN", "平均每台在手动台上 10:00")])
def test_shift_counter_of_a_manual_rig_names_the_time_on_the_rig(operator: Operator, code: str, text: str) -> None:
    shift = operator.window.operator_page._shift
    operator.until(lambda: shift.text() == "Since 00:00  ·  0 done")
    operator.window.app.set_language(code)
    assert shift._summary is not None
    shift._summary = replace(shift._summary, by_hand=True)
    shift._counted(ShiftCount(passed=1, mean_duration=600.0))
    assert shift.text().endswith(text)


def test_shift_counter_names_partial_runs_that_failed(operator: Operator) -> None:
    label = operator.widget("shift_label", QLabel)
    operator.until(lambda: label.text() == "Since 00:00  ·  0 done")
    now = datetime.now(UTC)
    write_result(operator.site_folder.runs, "SN-000001", "passed", now)
    write_result(operator.site_folder.runs, "SN-000002", "failed", now, partial=True)
    use_station(operator, ONE_STAGE)
    operator.until(lambda: "yield 100.0 %" in label.text())
    assert label.text().endswith("not counted: 1 partial FAIL")
    operator.widget("language_combo").setCurrentIndex(1)
    assert label.text().endswith("未计入：部分标定不合格 1")


def test_shift_counter_restarts_with_a_new_shift(operator: Operator, monkeypatch: pytest.MonkeyPatch) -> None:
    label = operator.widget("shift_label", QLabel)
    operator.until(lambda: label.text())
    began = datetime(2026, 11, 23, 14, 0).astimezone()
    monkeypatch.setattr(shift_counter, "shift_start", lambda starts: began)
    operator.window.operator_page._shift._timer.timeout.emit()
    operator.until(lambda: label.text().startswith("Since 14:00"))


# ---- picture


def test_product_picture_is_shown_before_a_run(operator: Operator) -> None:
    loading = operator.window.findChild(Loading)
    assert loading is not None
    assert not loading.fixture.isVisible(), "the product has no picture"
    assert loading.picture.isVisible()
    operator.choose("nav_a")
    assert loading.fixture.isVisible()
    assert not loading.picture.isVisible()
    white, drawn = 0xFFFFFFFF, loading.fixture.grab().toImage()
    colours = {drawn.pixel(x, y) for x in range(0, drawn.width(), 3) for y in range(0, drawn.height(), 3)}
    assert white in colours
    assert len(colours) > 5
    operator.choose("mems_hand")
    assert not loading.fixture.isVisible()


# ---- labels


@pytest.fixture
def printer() -> Iterator[tuple[str, list[bytes]]]:
    """A label printer on this computer: its address and the received data."""
    received: list[bytes] = []
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            try:
                while True:
                    connection, _ = server.accept()
                    with connection, connection.makefile("rb") as stream:
                        received.append(stream.read())
            except OSError:
                return

        threading.Thread(target=serve, daemon=True).start()
        yield f"tcp://127.0.0.1:{server.getsockname()[1]}", received
        server.shutdown(socket.SHUT_RDWR)


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Files opened in other programs."""
    files: list[Path] = []

    def open_url(url: QUrl) -> bool:
        files.append(Path(url.toLocalFile()))
        return True

    monkeypatch.setattr(QDesktopServices, "openUrl", open_url)
    return files


@pytest.mark.long
def test_label_is_printed_on_request_and_reprinted_from_the_history(
    operator: Operator, printer: tuple[str, list[bytes]]
) -> None:
    address, received = printer
    (operator.site_folder.product.parent / "label.zpl").write_text(ZPL, encoding="utf-8")
    use_station(operator, {**ONE_STAGE, "label": "label.zpl"}, label={"printer": address})
    run_to_pass(operator)
    assert received == []
    operator.press("label_button")
    operator.until(lambda: f"Labels sent to the printer: {SERIAL}" in operator.says())
    operator.until(lambda: received)
    assert f"^FD{SERIAL}^FS".encode() in received[0]
    assert b"^FDshort test bench " in received[0]
    assert b" SIMULATED^FS" in received[0], "the station is virtual"
    assert operator.window.focusWidget() is operator.widget("serial_edit")

    operator.window.show_page("history_page")
    operator.until(lambda: operator.widget("history_label_button").isVisible())
    operator.press("history_label_button")
    operator.until(lambda: len(received) == 2)
    assert received[1] == received[0]


@pytest.mark.long
def test_an_unreachable_printer_is_reported(operator: Operator) -> None:
    (operator.site_folder.product.parent / "label.zpl").write_text(ZPL, encoding="utf-8")
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    use_station(operator, {**ONE_STAGE, "label": "label.zpl"}, label={"printer": f"tcp://127.0.0.1:{port}"})
    run_to_pass(operator)
    operator.press("label_button")
    operator.until(lambda: "cannot be reached (connection refused)" in operator.says())
    assert "Switch it on" in operator.says()
    operator.press("unprinted_notice_close")
    assert "cannot be reached" not in operator.says()


@pytest.mark.long
def test_typst_label_is_written_as_a_pdf_in_the_runs_folder(operator: Operator, opened: list[Path]) -> None:
    use_station(operator, {**ONE_STAGE, "label": "label.typ"})  # the shipped template
    run_to_pass(operator)
    operator.press("label_button")
    operator.until(lambda: opened)
    (pdf,) = opened
    assert pdf.parent == operator.site_folder.folder / "labels"
    assert pdf.stem.startswith(SERIAL)
    assert pdf.read_bytes().startswith(b"%PDF-")
    assert str(pdf) in operator.says()


@pytest.mark.long
@pytest.mark.parametrize(("bench", "stages", "verdict"), [({"out_of_limits": True}, None, "FAIL"), ({}, 1, "PARTIAL")])
def test_label_is_not_offered_for_a_failed_or_partial_run(
    operator: Operator, bench: dict[str, Any], stages: int | None, verdict: str
) -> None:
    names = ["six_position", "rate"] if stages else ["six_position"]
    operator.site_folder.write({"stages": names, "label": "label.typ"}, **bench)
    operator.window.app.set_station(operator.site_folder.station)
    if stages:
        operator.window.app.choose(("six_position",), None)
    operator.scan(SERIAL)
    operator.press("start_button")
    operator.until(lambda: operator.verdict)
    assert verdict in operator.verdict
    assert not operator.widget("label_button").isVisible()
    operator.until_ended()
    operator.window.show_page("history_page")
    operator.until(lambda: operator.widget("history_result_button").isVisible())
    assert not operator.widget("history_label_button").isVisible()


@pytest.mark.long
def test_label_is_not_offered_for_a_stopped_run(operator: Operator) -> None:
    use_station(operator, {**ONE_STAGE, "label": "label.typ"})
    operator.scan(SERIAL)
    operator.press("start_button")
    operator.until(operator.in_a_stage)
    operator.press("stop_button")
    operator.until_ended()
    assert operator.verdict == "STOPPED"
    assert not operator.widget("label_button").isVisible()


def test_shipped_pictures_and_labels_exist() -> None:
    files = {name: library.find("products", name).parent for name in library.names("products")}
    assert (files["nav_a"] / "unit_on_table.svg").is_file()
    assert (files["nav_a"] / "label.typ").is_file()
    assert (files["tactical_b"] / "label.zpl").is_file()
