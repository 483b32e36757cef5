"""Forms for laboratory, instruments, signatories, badges, label printer, check standards and two-person rules."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QLabel, QLineEdit, QPushButton, QWidget
from pytestqt.qtbot import QtBot

from calstation.config import library, versions
from calstation.gui.settings.form_view import FormTable
from calstation.gui.settings.standards_form import StandardsForm
from calstation.gui.state import AppContext
from calstation.gui.text import language
from calstation.gui.widgets.file_dialog import FileDialog
from calstation.records import audit_path, read_audit, select_audit
from tests.gui.station_driver import PIN, station_page
from tests.gui.test_forms import FormDriver

pytestmark = pytest.mark.long

LABORATORY, OPERATORS = 6, 7


class ListDriver(FormDriver):
    """Operate a page with several forms, of which one is chosen by its name."""

    name = ""

    @property
    def table(self) -> FormTable:
        """Return the table of the chosen form."""
        table: FormTable = self.find(FormTable, f"{self.name}_table")
        return table

    def problems_of(self, name: str) -> list[str]:
        """Return the messages below a form of the station."""
        text: str = self.find(QLabel, f"{name}_problems").text()
        return text.splitlines()

    def scan(self, name: str, text: str) -> None:
        """Type a text and Enter, as a scanner does."""
        edit = self.find(QLineEdit, name)
        edit.setFocus()
        QTest.keyClicks(edit, text)
        QTest.keyClick(edit, Qt.Key.Key_Return)

    def can_save(self) -> bool:
        """Return whether the changes can be saved."""
        return bool(self.find(QPushButton, "save_station_button").isEnabled())


@pytest.fixture
def operator(app: AppContext, site_folder: Any, qtbot: QtBot) -> ListDriver:
    """The page in the role of an operator."""
    return station_page(app, site_folder, qtbot, ListDriver)


@pytest.fixture
def forms(operator: ListDriver) -> ListDriver:
    """The page in the role of an engineer, with a station of its own."""
    operator.app.role.set_first_pin(PIN)
    operator.copy_station("line_4")
    return operator


def stored(name: str) -> str:
    return library.find("stations", name).read_text(encoding="utf-8")


def add_comments(name: str, text: str) -> str:
    """Append a text to a station file, and return the whole."""
    path = library.find("stations", name)
    path.write_text(f"{path.read_text(encoding='utf-8')}\n{text}", encoding="utf-8")
    return path.read_text(encoding="utf-8")


def comments(text: str) -> list[str]:
    return re.findall(r"#.*", text)


# Laboratory


def test_laboratory_and_its_lists_are_entered_saved_and_removed_again(forms: ListDriver) -> None:
    before = stored("line_4")
    forms.show_section(LABORATORY)
    forms.type("laboratory_name_edit", "Inertial Laboratory")
    assert forms.message("laboratory_address") == "Missing; fill it in."
    assert not forms.can_save()
    forms.type("laboratory_address_edit", "1 Sample Road, Cambridge")
    forms.type("laboratory_country_edit", "gb")
    assert forms.message("laboratory_country").startswith("Two capital letters, such as GB")
    assert forms.find(QLineEdit, "laboratory_country_edit").property("invalid")
    assert not forms.can_save()
    forms.type("laboratory_country_edit", "UK")
    assert forms.message("laboratory_country").startswith("“UK” is not a country of ISO 3166-1")
    assert not forms.can_save()
    forms.type("laboratory_country_edit", "GB")
    assert not forms.find(QLineEdit, "laboratory_country_edit").property("invalid")
    forms.name = "signatories"
    forms.press("signatories_add_button")
    assert forms.problems_of("signatories") == ["Row 1, Name, function: Missing; fill it in."]
    forms.enter("1", "Name, function", "Dr A. Example, head of laboratory")
    forms.press("signatories_add_button")
    forms.enter("2", "Name, function", "Li Na, engineer")
    forms.press("signatories_up_button")
    forms.name = "instruments"
    forms.press("instruments_add_button")
    forms.enter("1", "Instrument", "Rate table RT-200")
    assert forms.problems_of("instruments") == ["Row 1, Kind: Select the kind."]
    assert not forms.can_save()
    forms.select("1", "Kind", "table")
    forms.enter("1", "Calibrated", "2.3.2026")
    assert forms.problems_of("instruments") == [
        "Row 1, Calibrated: “2.3.2026” is not a date; type one like 2026-11-23."
    ]
    assert not forms.can_save()
    forms.enter("1", "Calibrated", "2026-03-02")
    forms.enter("1", "Due", "2025-03-02")
    assert forms.problems_of("instruments") == [
        "Row 1, Due: The next calibration must be after the last one, 2026-03-02."
    ]
    forms.enter("1", "Due", "2026-03-03")
    forms.press("instruments_add_button")
    forms.enter("2", "Instrument", "Thermometer")
    forms.select("2", "Kind", "other")
    forms.enter("2", "Calibrated", "2026-03-02")
    forms.enter("2", "Due", "2026-03-03")
    forms.press("save_station_button")
    assert stored("line_4") == before, "an overdue instrument is saved only after a warning"
    assert "Rate table RT-200" in forms.page.notice.text_label.text()
    assert "Thermometer" not in forms.page.notice.text_label.text(), "it does not refuse production runs"
    forms.press("save_overdue_button")
    assert "2026-03-03" in stored("line_4")
    forms.press("instruments_remove_button")
    forms.enter("1", "Due", "2036-03-02")
    forms.press("save_station_button")
    data = tomllib.loads(stored("line_4"))
    assert data["laboratory"] == {
        "name": "Inertial Laboratory",
        "address": "1 Sample Road, Cambridge",
        "country": "GB",
        "signatories": ["Li Na, engineer", "Dr A. Example, head of laboratory"],
    }
    (instrument,) = data["instruments"]
    assert instrument["name"] == "Rate table RT-200"
    assert instrument["kind"] == "table"
    assert (str(instrument["calibrated"]), str(instrument["due"])) == ("2026-03-02", "2036-03-02")
    assert comments(before) == comments(stored("line_4"))
    assert versions.list_versions("stations", "line_4")[0].author == forms.page.drafts.author.by
    saved = select_audit(read_audit(audit_path(library.site_folder())).entries, "file_saved")
    assert saved[-1].values["name"] == "line_4"
    forms.press("instruments_remove_button")
    forms.name = "signatories"
    for _ in range(2):
        forms.click("1", "Name, function")
        forms.press("signatories_remove_button")
    for name in ("name", "address", "country"):
        forms.type(f"laboratory_{name}_edit", "")
    forms.press("save_station_button")
    assert tomllib.loads(stored("line_4")) == tomllib.loads(before)


def test_unknown_entries_and_comments_of_a_laboratory_are_kept(forms: ListDriver) -> None:
    text = add_comments(
        "line_4",
        '# of the site\n[laboratory] # rented\nname = "A" # ours\naddress = "B"\nsignatories = ["C, D"] # on leave\n'
        '\n# traceable\n[[instruments]] # the table\nname = "T"\nkind = "table"\ncertificate = "P-1" # PTB\n',
    )
    forms.page.drafts.reload()
    forms.show_section(LABORATORY)
    forms.name = "instruments"
    assert forms.cell_text("1", "Certificate") == "P-1"
    forms.enter("1", "Certificate", "P-2")
    forms.press("instruments_add_button")
    forms.enter("2", "Instrument", "Level")
    assert forms.cell_text("2", "Kind") == "", "a station file has no default"
    forms.select("2", "Kind", "other")
    forms.name = "signatories"
    forms.enter("1", "Name, function", "E, F")
    forms.press("save_station_button")
    assert comments(stored("line_4")) == comments(text)
    assert 'signatories = ["E, F"] # on leave' in stored("line_4")
    assert 'certificate = "P-2" # PTB' in stored("line_4")


def test_folder_language_templates_and_signature_of_certificates_are_entered(forms: ListDriver, tmp_path: Path) -> None:
    before = stored("line_4")
    forms.show_section(LABORATORY)
    assert forms.page.nav.currentItem().text() == "Laboratory, certificates"
    assert "only on request" in forms.message("report_folder")
    forms.type("report_folder_edit", str(tmp_path / "absent"))
    assert forms.message("report_folder").startswith(f"{tmp_path / 'absent'} does not exist")
    language.use("zh_CN")
    assert "absent 不存在" in forms.message("report_folder")
    assert forms.page.nav.currentItem().text() == "实验室与证书 ●"
    language.use("en")
    forms.press("report_browse_button")
    dialog = forms.root.findChild(FileDialog)
    dialog.selectFile(str(tmp_path))
    dialog.accept()
    assert forms.find(QLineEdit, "report_folder_edit").text() == str(tmp_path)
    assert "does not exist" not in forms.message("report_folder")
    forms.choose("report_language_edit", "中文")
    forms.type("report_template_edit", "our-templates")
    assert "our-templates does not exist" in forms.message("report_template")
    (library.find("stations", "line_4").parent / "our-templates").mkdir()
    forms.type("report_signing_certificate_edit", "laboratory.p12")
    assert "laboratory.p12 does not exist" in forms.message("report_signing_certificate")
    (library.find("stations", "line_4").parent / "laboratory.p12").touch()
    forms.press("save_station_button")
    report = {
        "folder": str(tmp_path),
        "language": "zh",
        "template": "our-templates",
        "signing": {"certificate": "laboratory.p12"},
    }
    assert tomllib.loads(stored("line_4"))["report"] == report
    for name in ("folder", "template", "signing_certificate"):
        assert "does not exist" not in forms.message(f"report_{name}")
        forms.type(f"report_{name}_edit", "")
    forms.choose("report_language_edit", "that of the window")
    forms.press("save_station_button")
    assert tomllib.loads(stored("line_4")) == tomllib.loads(before)


# Operators


def test_badges_are_scanned_into_the_list_and_checked_against_their_form(forms: ListDriver) -> None:
    before = stored("line_4")
    forms.show_section(OPERATORS)
    forms.name = "badges"
    assert forms.find(QLabel, "sign_in_status_label").text().startswith("Sign-in is not required")
    forms.type("sign_in_badge_pattern_edit", "B[0-9")
    assert "is not a regular expression" in forms.message("sign_in_badge_pattern")
    forms.type("sign_in_badge_pattern_edit", r"B\d{4}")
    forms.type("sign_in_idle_minutes_edit", "0")
    assert forms.message("sign_in_idle_minutes") == "Out of range; it must be greater than 0."
    forms.type("sign_in_idle_minutes_edit", "15")
    assert forms.find(QLabel, "sign_in_status_label").text().startswith("Every run needs a badge; any")
    forms.scan("badges_add_edit", "B1234")
    assert forms.problems_of("badges") == ["B1234, Name: Missing; fill it in."]
    forms.enter("B1234", "Name", "Li Na")
    forms.select("B1234", "Engineer", "yes")
    forms.scan("badges_add_edit", "B1234")
    assert forms.find(QPushButton, "badges_add_button").toolTip() == "It is in the list already."
    forms.type("badges_add_edit", "")
    forms.scan("badges_add_edit", "X9")
    forms.enter("X9", "Name", "Wang Wei")
    assert forms.problems_of("badges") == [r"X9, Name: The badge does not have the format B\d{4}."]
    assert not forms.can_save()
    forms.press("badges_remove_button")
    forms.type("label_printer_edit", "192.168.1.40:99999")
    assert forms.message("label_printer").startswith("Not an address")
    forms.type("label_printer_edit", "192.168.1.40")
    forms.press("save_station_button")
    data = tomllib.loads(stored("line_4"))
    sign_in = {"badge_pattern": r"B\d{4}", "idle_minutes": 15, "names": {"B1234": "Li Na"}, "engineers": ["B1234"]}
    assert data["sign_in"] == sign_in
    assert data["label"] == {"printer": "tcp://192.168.1.40:9100"}
    forms.click("B1234", "Name")
    forms.press("badges_remove_button")
    forms.type("sign_in_badge_pattern_edit", "")
    assert forms.message("sign_in_badge_pattern") == "Missing; fill it in."
    forms.type("sign_in_idle_minutes_edit", "")
    forms.type("label_printer_edit", "")
    forms.press("save_station_button")
    assert tomllib.loads(stored("line_4")) == tomllib.loads(before)


@pytest.mark.parametrize(("code", "said"), [("en", "you have been signed out"), ("zh_CN", "您已退出登录")])
def test_saved_badges_that_lock_the_window_say_so(forms: ListDriver, code: str, said: str) -> None:
    forms.app.station_changed.connect(forms.app.role.lock)  # as the badge field of the Operator page does
    forms.show_section(OPERATORS)
    forms.type("sign_in_badge_pattern_edit", r"B\d{4}")
    language.use(code)
    forms.press("save_station_button")
    assert not forms.app.role.engineer
    assert said in forms.page._unsaved_label.text()
    language.use("en")


def test_engineer_needs_a_name_where_other_badges_have_one(forms: ListDriver) -> None:
    text = add_comments("line_4", '[sign_in]\nbadge_pattern = ".+" # any\nengineers = ["E1"] # on duty\n')
    forms.page.drafts.reload()
    forms.show_section(OPERATORS)
    forms.name = "badges"
    assert (forms.cell_text("E1", "Name"), forms.cell_text("E1", "Engineer")) == ("", "yes")
    forms.scan("badges_add_edit", "A7")
    forms.enter("A7", "Name", "Li Na")
    assert forms.problems_of("badges") == ["E1, Engineer: Name missing; the other badges have one."]
    language.use("zh_CN")
    assert forms.problems_of("badges") == ["E1，工程师：缺少姓名；其他工牌都有姓名。"]
    language.use("en")
    forms.enter("E1", "Name", "Dr Engineer")
    forms.press("save_station_button")
    assert comments(stored("line_4")) == comments(text)
    assert tomllib.loads(stored("line_4"))["sign_in"]["names"] == {"A7": "Li Na", "E1": "Dr Engineer"}


def test_operator_can_read_the_lists_but_not_change_them(operator: ListDriver) -> None:
    operator.show_section(OPERATORS)
    for name in ("badges_add_button", "badges_add_edit", "sign_in_badge_pattern_edit", "label_printer_edit"):
        widget = operator.find(QWidget, name)
        assert not widget.isEnabled(), name
        assert "engineer" in widget.toolTip()


# Products


def test_check_standards_and_their_references_are_edited_in_display_units(forms: ListDriver) -> None:
    forms.open("products", "mems_c", "Check standards")
    forms.name = "check_standards"
    forms.press("check_standards_add_button")
    forms.enter("1", "Serial number", "SN-000001")
    assert forms.problems() == [
        "Row 1, Interval, days: Missing; fill it in.",
        "Row 1: No reference; choose this row and add the parameters with their known values below the table.",
    ]
    forms.enter("1", "Interval, days", "7")
    forms.enter("1", "Date of the reference", "2026-11-02")
    forms.name = "reference"
    forms.choose("reference_add_combo", "gyro scale factor x")
    forms.press("reference_add_button")
    assert forms.problems() == [
        "Row 1, Gyro scale factor x, Value (ppm): Missing; fill it in.",
        "Row 1, Gyro scale factor x, Sigma (ppm): Missing; fill it in.",
    ]
    forms.enter("gyro scale factor x", "Value", "120")
    forms.enter("gyro scale factor x", "Sigma", "-5")
    assert forms.problems() == ["Row 1, Gyro scale factor x, Sigma (ppm): Out of range; it must be at least 0."]
    assert not forms.can_save()
    forms.enter("gyro scale factor x", "Sigma", "5")
    forms.name = "check_standards"
    assert forms.cell_text("1", "Parameters") == "1"
    forms.press("check_standards_add_button")
    forms.enter("2", "Serial number", "SN-000001")
    forms.enter("2", "Interval, days", "7")
    assert forms.find(QLabel, "reference_title").text() == "Reference of SN-000001"
    forms.name = "reference"
    assert forms.table.model().rowCount() == 0
    forms.choose("reference_add_combo", "accel bias z")
    forms.press("reference_add_button")
    forms.enter("accel bias z", "Value", "1000")
    forms.enter("accel bias z", "Sigma", "10")
    assert forms.problems() == [
        "Row 2, Serial number: Check standard SN-000001 is listed twice. List each check standard once."
    ]
    forms.name = "check_standards"
    forms.enter("2", "Serial number", "SN-000002")
    text = forms.save()
    first, second = tomllib.loads(text)["check_standards"]
    assert first["serial"] == "SN-000001"
    assert first["reference"] == {"gyro_scale_x": {"value": pytest.approx(1.2e-4), "sigma": pytest.approx(5e-6)}}
    assert str(first["date"]) == "2026-11-02"
    assert second["reference"] == {"accel_bias_z": {"value": 9.80665e-3, "sigma": pytest.approx(9.80665e-5)}}
    assert comments(text) == comments((library.shipped_folder() / "products" / "mems_c.toml").read_text("utf-8"))
    for _ in range(2):
        forms.click("1", "Serial number")
        forms.press("check_standards_remove_button")
    assert "check_standards" not in tomllib.loads(forms.save())


def test_reference_tables_with_headers_keep_their_comments(forms: ListDriver) -> None:
    forms.open("products", "mems_c", "Check standards")
    addition = (
        '\n[[check_standards]] # golden\nserial = "SN-000001"\ninterval_days = 7\n\n# from PTB\n'
        "[check_standards.reference.gyro_scale_x] # x\nvalue = 1.2e-4 # mean of ten\nsigma = 5.0e-6\n"
    )
    draft = forms.page.profiles._draft
    assert draft is not None
    draft.rewrite(draft.text + addition)
    forms.name = "reference"
    forms.enter("gyro scale factor x", "Value", "130")
    forms.choose("reference_add_combo", "gyro scale factor y")
    forms.press("reference_add_button")
    forms.enter("gyro scale factor y", "Value", "1")
    forms.enter("gyro scale factor y", "Sigma", "2")
    text = forms.save()
    for comment in ("# golden", "# from PTB", "# x", "# mean of ten"):
        assert comment in text
    (standard,) = tomllib.loads(text)["check_standards"]
    assert standard["reference"]["gyro_scale_x"]["value"] == pytest.approx(1.3e-4)
    assert standard["reference"]["gyro_scale_y"] == {"value": 1e-6, "sigma": 2e-6}
    forms.click("gyro scale factor x", "Value")
    forms.press("reference_remove_button")
    (standard,) = tomllib.loads(forms.save())["check_standards"]
    assert list(standard["reference"]) == ["gyro_scale_y"]


def test_a_problem_of_a_reference_is_selected_in_its_table(forms: ListDriver) -> None:
    forms.open("products", "mems_c", "Check standards")
    draft, view = forms.page.profiles._draft, forms.page.profiles.views.currentWidget()
    assert draft is not None
    assert isinstance(view, StandardsForm)
    standards = "".join(
        f'\n[[check_standards]]\nserial = "{serial}"\ninterval_days = 7\n'
        f"reference = {{ gyro_bias_x = {{ value = 0.0, sigma = {sigma} }} }}\n"
        for serial, sigma in (("A", 1.0), ("B", -1.0))
    )
    draft.rewrite(draft.text + standards)
    assert view.go_to(draft.problems[0])
    assert forms.find(QLabel, "reference_title").text() == "Reference of B"
    assert view.reference.table.currentIndex().column() == 2


def test_actions_that_two_people_confirm_are_chosen(forms: ListDriver) -> None:
    forms.open("products", "mems_c", "Two people")
    forms.name = "confirmation"
    shown = [text.text() for text in forms.find(FormTable, "confirmation_table").window().findChildren(QLabel)]
    assert any("with which their run was made" in text for text in shown)
    before = forms.text
    column = "A second engineer confirms"
    forms.select("issue of a certificate", column, "yes")
    forms.select("override of a failed unit or check standard", column, "yes")
    assert tomllib.loads(forms.save())["confirmation"] == {"required_for": ["certificate", "override"]}
    language.use("zh_CN")
    assert forms.cell_text("签发证书", "由第二位工程师确认") == "是"
    language.use("en")
    forms.select("issue of a certificate", column, "no")
    forms.select("override of a failed unit or check standard", column, "no")
    forms.save()
    assert forms.text == before
