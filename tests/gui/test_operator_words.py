"""Texts for operators: no names of files and keys, numbers without exponents, limits as they were entered."""

import re
import tomllib

import pytest
import tomli_w
from PySide6.QtGui import QFontMetricsF
from PySide6.QtWidgets import QLabel, QPushButton
from pytestqt.qtbot import QtBot

from calstation.estimation import Diagnosis
from calstation.gui.engineer.result_view import _cells
from calstation.gui.operator import advice
from calstation.gui.operator.questions import ask as ask_notice
from calstation.gui.operator.verdict import FiguresTable
from calstation.gui.text import check_text, fault_text, language, rendered, say
from calstation.gui.widgets import theme
from calstation.judgement import Check, Where
from calstation.messages import Text, catalogue
from calstation.physics import limit_number
from calstation.results import FinishedRun
from calstation.sequencer import Fault
from tests.check_rows import check_row
from tests.gui.conftest import Operator, result_with
from tests.gui.station_driver import PIN
from tests.site_folder import SiteFolder

#: Names of files and keys of entries.
_TECHNICAL = re.compile(r"\.toml|[a-z]+\.[a-z]+_|[a-z]+_(?:deg|mps2|m)\b|/")


@pytest.mark.parametrize(
    ("limit", "value", "text"),
    [
        (1.5e-5, 1.0e-5, "3.1"),
        (1.5e-5, 1.501e-5, "3.094"),  # 3.096 °/h exceeds the limit, but not 3.1
        (9.7e-8, 5.0e-8, "0.02"),
        (1.21203420277384e-05, 1.0e-5, "2.5"),  # entered as 2.5 °/h
        (1e-3, 1.0, "206"),
    ],
)
def test_limits_have_as_many_digits_as_were_entered(limit: float, value: float, text: str) -> None:
    assert limit_number(limit, 4.84813681109536e-06, value) == text


@pytest.mark.parametrize(
    ("check", "value", "limit", "unit"),
    [
        (
            Check.compare("agreement", 2.543e-109, (1e-6, 1.0), "1", subject="excitation"),
            "< 0.000001",
            "≥ 0.000001",
            "",
        ),
        (Check.compare("sample_clock", 1.339e-5, 9.579e-5, "1"), "13.39", "≤ 95.79", "ppm"),
        (Check.compare("prior", 4.6e12, 5.0, "sigma"), "> 1000000000", "≤ 5", "σ"),
        (Check.compare("within", 1e-5, (-1.5e-5, 1.5e-5), "rad/s", subject="gyro_bias_x"), "2.063", "±3.1", "°/h"),
        (
            Check.compare("hysteresis", 1e-5, 2.9e-5, "rad/s", subject="rate", where=Where("gyro_bias_x")),
            *("2.063", "≤ 6", "°/h"),
        ),
    ],
)
def test_checks_have_units_and_numbers_without_exponents(check: Check, value: str, limit: str, unit: str) -> None:
    text = check_text(check)
    assert (text.value, text.limit, text.unit) == (value, limit, unit)


@pytest.mark.parametrize(("sigma", "shown", "limit"), [(1.9034e-5, "3.93", "3.9"), (1.8994e-5, "3.9", "3.918")])
def test_a_sigma_and_its_limit_are_shown_as_they_compare(sigma: float, shown: str, limit: str) -> None:
    check = Check.compare(
        "sigma_below", sigma, 1.9e-5 if sigma > 1.9e-5 else 1.89945e-5, "rad/s", subject="gyro_bias_x"
    )
    row = {"value": 1e-6, "sigma": sigma, "unit": "rad/s", "stage": "rate"}
    outcome = "passed" if check.passed else "failed"
    result = result_with(parameters={"gyro_bias_x": row}, stages=["rate"], outcome=outcome, checks=[check.to_json()])
    (figure,) = advice.figures(result)
    assert (figure.sigma, figure.limit) == (shown, f"σ ≤ {limit}")
    assert check_text(check).limit == f"≤ {limit}"
    cells = _cells(FinishedRun(result, None, {}), "gyro_bias_x")
    assert (cells["sigma"], cells["sigma_limit"]) == (shown, limit)


def test_a_checked_value_that_exceeds_its_limit_is_shown_larger() -> None:
    text = check_text(Check.compare("sample_clock", 9.57948e-5, 9.5791e-5, "1"))
    assert (text.value, text.limit) == ("95.795", "≤ 95.79")


def test_check_of_rising_and_falling_temperature_names_half_the_difference() -> None:
    check = Check.compare("hysteresis", 1e-5, 2.9e-5, "rad/s", subject="rate", where=Where("gyro_bias_x"))
    assert "half their difference" in check_text(check).sentence
    language.use("zh_CN")
    assert "差值的一半" in check_text(check).sentence
    language.use("en")


def test_reason_names_further_checks_in_words() -> None:
    near = [
        {**check_row("within", name, value, 1.0, passed=True), "near_miss": True}
        for name, value in (("gyro_bias_x", 0.959), ("gyro_bias_y", 0.9))
    ]
    one, two = result_with(checks=near[:1]), result_with(checks=near)
    nearest = "At 95 % of its limit: gyro bias x"
    assert advice.brief_reason("passed", one) == nearest
    assert advice.brief_reason("passed", two) == f"{nearest} and 1 more"
    language.use("zh_CN")
    assert advice.brief_reason("passed", two) == "已达限差的 95 %：陀螺零偏 x，另有 1 项"
    language.use("en")


def test_tooltip_explains_what_is_close_to_the_limit(operator: Operator) -> None:
    row = {"value": 1.45e-5, "sigma": 1e-8, "unit": "rad/s", "stage": "rate"}
    check = {**check_row("within", "gyro_bias_x", 1.45e-5, [-1.5e-5, 1.5e-5], passed=True), "near_miss": True}
    figures = operator.window.operator_page._verdict._figures
    for code, words in (("en", "80 % of the limit"), ("zh_CN", "限差的 80 %")):
        language.use(code)
        figures.show_result(result_with(parameters={"gyro_bias_x": row}, checks=[check]))
        cells = [figures._grid.itemAt(i).widget() for i in range(figures._grid.count())]
        tips = [cell.toolTip() for cell in cells if cell.toolTip()]
        assert len(tips) == 6
        assert all(words in tip for tip in tips), tips
    language.use("en")


def test_operator_reads_no_file_and_key_of_a_wrong_entry(operator: Operator, site_folder: SiteFolder) -> None:
    station = tomllib.loads(site_folder.station.read_text(encoding="utf-8"))
    del station["site"]["latitude_deg"]
    site_folder.station.write_text(tomli_w.dumps(station), encoding="utf-8")
    window = operator.window
    window.app.station_changed.emit()
    notice = window.operator_page.notice
    for code, words, ask in (("en", "Latitude: ", "Ask an engineer"), ("zh_CN", "纬度：", "请工程师")):
        language.use(code)
        assert words in notice.text_label.text()
        assert ask in notice.text_label.text()
        assert not _TECHNICAL.search(notice.text_label.text()), notice.text_label.text()
    language.use("en")
    window.app.role.set_first_pin(PIN)
    assert f"{site_folder.station.name}: site.latitude_deg" in notice.text_label.text()
    window.app.role.lock()
    assert not _TECHNICAL.search(notice.text_label.text())


def test_operator_reads_which_entry_of_which_product_is_missing(operator: Operator, site_folder: SiteFolder) -> None:
    product = tomllib.loads(site_folder.product.read_text(encoding="utf-8"))
    del product["serial_pattern"]
    site_folder.product.write_text(tomli_w.dumps(product), encoding="utf-8")
    operator.window.app.product_changed.emit()
    notice, name = operator.window.operator_page.notice, site_folder.product.stem
    for code, title, text in (
        (
            "en",
            "This station and product cannot run",
            f"serial_pattern: The entry is missing. Ask an engineer to correct the product file “{name}”.",
        ),
        ("zh_CN", "这个工位和产品型号无法标定", f"serial_pattern：缺少此项。请工程师更正产品型号文件“{name}”。"),
    ):
        operator.window.app.set_language(code)
        assert text in notice.text_label.text()
        assert operator.says().count(title) >= 2  # the notice and the page use the same words


def test_operator_reads_no_file_and_key_of_a_fault(operator: Operator, site_folder: SiteFolder) -> None:
    what = Text.of("entry.at", field="site.gravity_mps2", what=Text("site.gravity_missing"))
    panel = operator.window.operator_page._verdict
    text = panel._fault_text(Fault("", "", 2, "entry.in_file", {"file": "/srv/line_7.toml", "what": what}))
    assert text.text.startswith("Surveyed gravity: Surveyed gravity is required")
    assert text.remedy == "Ask an engineer to correct it on the Station page."
    assert not _TECHNICAL.search(text.sentences)


@pytest.mark.parametrize(
    ("code", "start", "remedy"),
    [
        ("en", "Confirmation of the site: The site (latitude", "Ask an engineer to verify these values and to confirm"),
        ("zh_CN", "站址确认：尚未在本机确认站址", "请工程师核实这些数值，并在“工位”页确认站址。"),
    ],
)
def test_operator_reads_that_an_engineer_verifies_and_confirms_the_site(
    operator: Operator, code: str, start: str, remedy: str
) -> None:
    operator.window.app.set_language(code)
    values = {"latitude": 31.2, "longitude": 121.5, "height": 12.0, "key": "host: 31.2"}
    for name, more in (("not_confirmed", {}), ("confirmed_elsewhere", {"confirmed": "host: 30"})):
        what = Text.of("entry.at", field="site.confirmed_on", what=Text.of(f"site.{name}", **values, **more))
        fault = Fault("", "", 2, "entry.in_file", {"file": "/srv/line_7.toml", "what": what})
        text = operator.window.operator_page._verdict._fault_text(fault)
        assert text.text.startswith(start)
        assert text.remedy.startswith(remedy)
        assert not _TECHNICAL.search(text.sentences)


#: Words of remedies that only engineers understand.
_FOR_ENGINEERS = re.compile(
    r"profile|station file|product file|\b[a-z]+_[a-z]+\b|\[[a-z]+\]|\bbaud\b|parity|calstation [a-z]"
)


@pytest.mark.parametrize(
    "name", ["connection", "imu", "link", "modbus", "motion", "preflight", "stream", "table", "verification"]
)
def test_operator_reads_no_entries_of_profiles_in_remedies_of_devices(name: str) -> None:
    for code, entry in catalogue.family(name).items():
        values = re.sub(r"\{[^}]*\}", "", entry.window or entry.remedy)  # without values
        if _FOR_ENGINEERS.search(values):
            assert entry.engineer, code


def test_operator_is_sent_to_an_engineer_who_reads_the_remedy(operator: Operator) -> None:
    fault = Fault("", "", 2, "imu.framed_2", {"detail": "", "register": "", "why": "", "reason": ""})
    nested = Text.of("imu.framed_2", **fault.values)
    for code, ask, key in (("en", "ask an engineer", "IMU profile"), ("zh_CN", "请找工程师", "配置文件")):
        language.use(code)
        assert ask in fault_text(fault, engineer=False).remedy
        assert key in fault_text(fault, engineer=True).remedy
        holds = Fault("", "", 2, "imu.holds_old", {"cause": nested})
        assert ask in fault_text(holds, engineer=False).remedy
        operator.window.operator_page.notice.dismiss()
        ask_notice(operator.window.operator_page.notice, "caution", Text.of("question.cannot_run", why=nested), {})
        assert ask in operator.window.operator_page.notice.text_label.text()
        assert key not in operator.window.operator_page.notice.text_label.text()
    language.use("en")


def test_times_in_the_window_have_no_time_zone() -> None:
    values = {"serial": "SN-1", "utc": "2026-11-28T01:02:03+00:00", "holds": "old"}
    assert "UTC" in str(Text("event.transfer_open", values))
    assert "UTC" not in say(Text("event.transfer_open", values))


@pytest.mark.long
def test_start_is_one_word_in_chinese(operator: Operator) -> None:
    language.use("zh_CN")
    operator.window.show_page("engineer_page")
    buttons = [operator.widget(name, QPushButton).text() for name in ("start_button", "engineer_start_button")]
    texts = [rendered(Text(f"advice.{name}")).sentences for name in ("next_partial",)]
    texts += [say(f"operator.message_{name}") for name in ("idle", "idle_slots")]
    language.use("en")
    assert buttons == ["开始", "开始"]
    assert all("“开始”按钮" in text for text in texts)
    for family in ("advice", "loading", "operator", "question"):
        for entry in catalogue.family(family).values():
            for english, chinese in ((entry.text, entry.zh), (entry.remedy, entry.zh_remedy)):
                assert english.count("START") == chinese.count("“开始”按钮"), chinese


def test_operators_read_plain_words_in_both_languages() -> None:
    late, ended = Text.of("stream.late", seconds=1.0), Text.of("run.engine_ended", exit_code=-9, then="")
    passed = Text.of("question.passed_before", serial="SN-1", when="2026-11-28T01:02:03+00:00", product="M7")
    language.use("zh_CN")
    assert rendered(late).text == "1 秒内的数据没有按时收到。"
    assert "找工程师（采样率设置）" in rendered(late).remedy
    assert rendered(ended).text.startswith("标定程序意外退出（代码 ")
    assert rendered(passed).remedy.startswith("于 ")
    assert rendered(passed).remedy.endswith(" 按产品型号“M7”合格。要再标定一次吗？")
    assert say("answer.close_incomplete_job") == say("history.close_as_incomplete") == "结束，记为未完成"
    assert say("operator.suggested") == "建议序列号"
    assert rendered(Text.of("question.units_passed_before", serials=["SN-1"], products=["M7"])).text == "SN-1 已经合格"
    language.use("en")
    assert "ask an engineer (sample rate)" in rendered(late).remedy


def test_reason_of_a_failure_is_the_most_likely_cause_in_whole_sentences() -> None:
    values = {"during": "rate", "parameter": "gyro_bias_z"}
    jump = Diagnosis("jump", -3e-6, 1e-8, "rad/s", {"gyro_bias_z": -16645.0}, values)
    check = Check("effects", "rate", 9.0, 1.0, "1", False, diagnosis=jump)
    result = result_with()
    assert advice.failed_check_text(check, result).startswith("Most likely cause: gyro bias z jumped during Rate")
    assert advice.failed_check_text(check, result).endswith("This shifts gyro bias z by −16645 σ.")
    language.use("zh_CN")
    assert advice.failed_check_text(check, result).startswith("最可能的原因：陀螺零偏 z 在速率过程中发生跳变")
    assert advice.failed_check_text(check, result).endswith("使陀螺零偏 z 偏移 −16645 σ。")
    language.use("en")


def test_a_run_without_a_verdict_shows_no_figures() -> None:
    """Those that pass so far would contradict the failed checks on the Engineer page."""
    row = {"value": 1e-4, "unit": "1", "stage": "rate", "sigma": 1e-6}
    checks = [check_row("within", f"gyro_scale_{axis}", 1e-4, [-1e-3, 1e-3], passed=axis == "x") for axis in "xy"]
    values = {"parameters": {f"gyro_scale_{axis}": row for axis in "xy"}, "checks": checks}
    assert len(advice.figures(result_with(**values, outcome="failed"))) == 2
    for outcome in ("stopped", "fault"):
        assert advice.figures(result_with(**values, outcome=outcome)) == []


def test_decimal_points_of_figures_are_aligned(qtbot: QtBot) -> None:
    theme.apply("light")
    table = FiguresTable(28)
    qtbot.addWidget(table)
    rows = {"gyro_bias_x": (1e-5, "rad/s"), "accel_bias_x": (4.567e-4, "m/s²"), "accel_scale_y": (5e-3, "1")}
    parameters = {
        name: {"unit": unit, "sigma": value / (10 if unit == "1" else 1000), "value": value, "stage": "rate"}
        for name, (value, unit) in rows.items()
    }
    checks = [
        check_row(
            "within",
            name,
            value,
            [-2 * value, 2 * value] if unit != "1" else [-1e-3, 1e-3],
            passed=unit != "1",
            unit=unit,
        )
        for name, (value, unit) in rows.items()
    ]
    table.show_result(result_with(outcome="failed", stages=["rate"], parameters=parameters, checks=checks))
    table.resize(900, 300)
    table.show()
    qtbot.wait(50)
    points = set()
    for line in range(table._grid.rowCount()):
        item = table._grid.itemAtPosition(line, 2)
        cell = None if item is None else item.widget()
        if isinstance(cell, QLabel) and cell.text()[-1].isdigit():
            fraction = cell.text()[cell.text().index(".") :] if "." in cell.text() else ""
            width = QFontMetricsF(cell.font()).horizontalAdvance(fraction)
            points.add(cell.geometry().right() - cell.contentsMargins().right() - round(width))
    assert max(points) - min(points) <= 1


@pytest.mark.parametrize(("language", "at_rest"), [("en", "at rest"), ("zh_CN", "静止")])
def test_row_of_the_solver_says_nothing_about_the_table(operator: Operator, language: str, at_rest: str) -> None:
    operator.window.app.set_language(language)
    assert at_rest not in rendered(Text("preparation.preparing_solver")).remedy


@pytest.mark.parametrize(
    ("language", "action", "card"), [("en", "scan the next", "Remove it"), ("zh_CN", "扫描下一台", "取下")]
)
def test_card_of_a_batch_does_not_ask_for_the_next_unit(
    operator: Operator, language: str, action: str, card: str
) -> None:
    operator.window.app.set_language(language)
    assert action in advice.next_action("passed", None)
    assert advice.next_action("passed", None, in_batch=True) == card
