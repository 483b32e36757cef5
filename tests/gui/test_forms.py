"""Limits, noise, priors and register maps as forms on the Station page, synchronised with the text of the file."""

import csv
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from PySide6.QtCore import QModelIndex, QPoint, Qt
from PySide6.QtGui import QContextMenuEvent, QGuiApplication
from PySide6.QtWidgets import QApplication, QComboBox, QFileDialog, QLabel, QLineEdit, QListWidget, QMenu, QPushButton
from pytestqt.qtbot import QtBot

from calstation.config import library, versions
from calstation.gui.settings.form_view import FormTable
from calstation.gui.state import AppContext
from calstation.gui.text import language, say
from calstation.messages import Language
from calstation.records import audit_path, read_audit
from tests.gui.station_driver import PIN, PageDriver, station_page
from tests.site_folder import PRODUCT

pytestmark = pytest.mark.long

PROFILES = 9


class FormDriver(PageDriver):
    """Operate the forms of the Station page with mouse and keyboard."""

    def open(self, kind: str, name: str, title: str) -> None:
        """Show a form of a file."""
        self.show_section(PROFILES)
        self.page.profiles.open(kind, name)
        self.show_view(title)

    @property
    def table(self) -> FormTable:
        """Return the table of the current form."""
        (table,) = (each for each in self.root.findChildren(FormTable) if each.isVisible())
        return table

    @property
    def text(self) -> str:
        """Return the text of the file."""
        return self.page.profiles.editor.toPlainText()

    def index(self, row: str, column: str) -> QModelIndex:
        """Return the cell in the row and column with these headings."""
        model, (across, down) = self.table.model(), (Qt.Orientation.Horizontal, Qt.Orientation.Vertical)
        rows = [model.headerData(i, down, Qt.ItemDataRole.AccessibleTextRole) for i in range(model.rowCount())]
        columns = [model.headerData(i, across) for i in range(model.columnCount())]
        return model.index(rows.index(row), columns.index(column))

    def cell_text(self, row: str, column: str) -> str:
        """Return the text of a cell."""
        return str(self.index(row, column).data()).strip()

    def click(self, row: str, column: str, *, twice: bool = False) -> None:
        """Click a cell."""
        self.table.scrollTo(self.index(row, column))
        at = self.table.visualRect(self.index(row, column)).center()
        self._bot.mouseClick(self.table.viewport(), Qt.MouseButton.LeftButton, pos=at)
        if twice:
            self._bot.mouseDClick(self.table.viewport(), Qt.MouseButton.LeftButton, pos=at)

    def enter(self, row: str, column: str, text: str) -> None:
        """Double-click a cell and replace its value; an empty text keeps the value."""
        self.click(row, column, twice=True)
        editor = self.table.indexWidget(self.index(row, column))
        line = editor.lineEdit() if isinstance(editor, QComboBox) else editor
        assert isinstance(line, QLineEdit)
        if text:
            line.selectAll()
            self._bot.keyClicks(line, text)
        self.commit(line)

    def commit(self, line: QLineEdit) -> None:
        """Press Enter in an input, and wait until it is closed."""
        self._bot.keyClick(line, Qt.Key.Key_Return)
        self._bot.waitUntil(lambda: self.table.state() != self.table.State.EditingState)

    def select(self, row: str, column: str, choice: str) -> None:
        """Click a cell with choices and select one of them."""
        self.click(row, column)
        box = self.table.indexWidget(self.index(row, column))
        assert isinstance(box, QComboBox)
        assert box.view().isVisible()
        box.view().setCurrentIndex(box.model().index(box.findText(choice), 0))
        self._bot.keyClick(box.view(), Qt.Key.Key_Return)

    def problems(self) -> list[str]:
        """Return the messages below the form."""
        problem_list = self.find(QListWidget, "problems_list")
        return [problem_list.item(i).text() for i in range(problem_list.count()) if problem_list.isVisible()]

    def save(self) -> str:
        """Save, with a reason if one is required, and return the text of the stored file."""
        if self.find(QLineEdit, "change_reason_edit").isVisible():
            self.type("change_reason_edit", "customer requires it")
        self.press("save_station_button")
        draft = self.page.profiles._draft
        assert draft is not None
        return library.find(draft.kind, draft.name).read_text(encoding="utf-8")


@pytest.fixture
def locked(app: AppContext, site_folder: Any, qtbot: QtBot) -> FormDriver:
    """The page in the role of an operator."""
    return station_page(app, site_folder, qtbot, FormDriver)


@pytest.fixture
def forms(locked: FormDriver) -> FormDriver:
    """The page in the role of an engineer."""
    locked.app.role.set_first_pin(PIN)
    return locked


def shipped(kind: str, name: str) -> str:
    return (library.shipped_folder() / kind / f"{name}.toml").read_text(encoding="utf-8")


# Limits


@pytest.mark.parametrize(
    ("code", "line"),
    [("en", "Gyro bias, Highest (°/h): 3.09397 → 2.5"), ("zh_CN", "陀螺零偏，最大（°/h）：3.09397 → 2.5")],
)
def test_compare_shows_changed_numbers_in_the_units_of_the_form(forms: FormDriver, code: Language, line: str) -> None:
    forms.open("products", "nav_a", "Limits")
    forms.enter("gyro bias", "Highest", "2.5")
    language.use(code)
    forms.show_view(say("common.compare"))
    shown = forms.page.profiles.diff.toPlainText().splitlines()
    language.use("en")
    assert line in shown
    assert "+within = 1.21203420277384e-05" in shown, "the text of the file follows"


def test_a_reason_is_required_for_changed_limits(forms: FormDriver, site_folder: Any) -> None:
    forms.open("products", "nav_a", "Limits")
    save, reason = forms.find(QPushButton, "save_station_button"), forms.find(QLineEdit, "change_reason_edit")
    assert not reason.isVisible()
    QApplication.processEvents()
    page = forms.page
    assert page._stack.mapTo(page, QPoint(0, 0)).y() == page.nav.mapTo(page, QPoint(0, 0)).y(), "no empty row above"
    top = forms.table.mapTo(forms.root, QPoint(0, 0))
    forms.enter("gyro bias", "Highest", "2.5")
    assert reason.isVisible()
    QApplication.processEvents()
    assert forms.table.mapTo(forms.root, QPoint(0, 0)) == top, "the next click must not hit another row"
    assert not save.isEnabled()
    assert save.toolTip() == "State the reason for the change."
    language.use("zh_CN")
    assert save.toolTip() == "请填写修改的原因。"
    language.use("en")
    forms.type("change_reason_edit", "field returns")
    forms._bot.keyClick(reason, Qt.Key.Key_Return)
    assert versions.list_versions("products", "nav_a") == (), "Enter does not save"
    forms.press("save_station_button")
    assert not reason.isVisible()
    assert versions.list_versions("products", "nav_a")[0].reason == "field returns"
    *_, event = read_audit(audit_path(site_folder.home)).entries  # the first is that a PIN was set
    assert (event.event, event.why, event.values["version"]) == ("file_saved", "field returns", 2)
    forms.show_view("Text")
    assert "field returns" in forms.find(QListWidget, "versions_list").item(0).text()
    forms.page.profiles.editor.setPlainText(re.sub(r"turns = 2", "turns = 3", forms.text))
    assert not reason.isVisible(), "only limits need a reason"
    forms.press("save_station_button")
    assert versions.list_versions("products", "nav_a")[0].reason == ""


def test_limits_are_edited_in_display_units_and_saved_in_si(forms: FormDriver) -> None:
    forms.open("products", "nav_a", "Limits")
    assert forms.cell_text("gyro bias", "Unit") == "°/h"
    assert forms.cell_text("gyro bias", "Lowest") == "−3.09397"
    assert forms.cell_text("gyro scale factor", "Sigma below") == "4"
    forms.enter("gyro bias", "Highest", "2.5")
    assert forms.cell_text("gyro bias", "Lowest") == "−2.5", "one number in the file stands for both ends"
    forms.enter("gyro scale factor", "Lowest", "-1000")
    text = forms.save()
    before = shipped("products", "nav_a")
    changed = [line for line in text.splitlines() if line not in before.splitlines()]
    assert changed == ["within = 1.21203420277384e-05", "within = [-0.001, 0.0015]"]
    assert len(text.splitlines()) == len(before.splitlines()), "all comments are kept"
    assert versions.list_versions("products", "nav_a")[0].author == forms.page.drafts.author.by
    forms.page.drafts.reload()
    assert forms.cell_text("gyro bias", "Highest") == "2.5"
    assert forms.cell_text("gyro scale factor", "Lowest") == "−1000"
    assert forms.cell_text("gyro scale factor", "Highest") == "1500"


@pytest.mark.parametrize(("kind", "name"), [("products", "nav_a"), ("imus", "dsp_modbus"), ("imus", "stim300")])
def test_opening_and_leaving_a_cell_changes_nothing(forms: FormDriver, kind: str, name: str) -> None:
    profiles = forms.page.profiles
    forms.show_section(PROFILES)
    profiles.open(kind, name)
    for form in profiles.forms:
        if form.form.kind != kind:
            continue
        profiles.views.setCurrentWidget(form)
        for row in range(form.model.rowCount()):
            for column in range(form.model.columnCount()):
                index = form.model.index(row, column)
                if form.model.flags(index) & Qt.ItemFlag.ItemIsEditable:
                    form.table.setCurrentIndex(index)
                    form.table.edit(index)
                    editor = form.table.indexWidget(index)
                    form.table.commitData(editor)
                    form.table.closeEditor(editor, form.table.itemDelegate().EndEditHint.NoHint)
    assert forms.text == shipped(kind, name)
    assert not forms.page.drafts.dirty


def test_invalid_limit_is_marked_and_cannot_be_saved(forms: FormDriver) -> None:
    forms.open("products", "mems_c", "Limits")
    forms.enter("accel bias", "Sigma below", "x")
    assert forms.problems() == ["Accel bias, Sigma below (µg): Not a number; type one like 12.5."]
    cell = forms.index("accel bias", "Sigma below")
    assert cell.data(Qt.ItemDataRole.UserRole) == "bad"
    assert cell.data(Qt.ItemDataRole.ToolTipRole) == forms.problems()[0]
    assert not forms.find(QPushButton, "save_station_button").isEnabled()
    forms.enter("accel bias", "Sigma below", "-2")
    assert forms.problems() == ["Accel bias, Sigma below (µg): Out of range; it must be greater than 0."]
    forms.enter("accel bias", "Sigma below", "90")
    forms.enter("accel bias", "Lowest", "5000")
    assert forms.problems() == ["Accel bias (µg): The lowest value must be below the highest."]
    forms.press("discard_station_button")
    assert forms.problems() == []


def test_value_limit_below_its_sigma_limit_is_pointed_out_and_may_be_saved(forms: FormDriver) -> None:
    forms.open("products", "mems_c", "Limits")
    forms.enter("gyro bias", "Highest", "2")
    (sentence,) = forms.problems()
    assert sentence.startswith("Gyro bias (°/h): The limit of the value, ±2, is below the limit of its sigma, 3.919;")
    assert "within = 9.6" in forms.save()
    language.use("zh_CN")
    assert "小于其标准差限差" in forms.problems()[0]


def test_stop_sigma_above_the_sigma_limit_is_pointed_out_and_may_be_saved(forms: FormDriver) -> None:
    forms.open("products", "mems_c", "Limits")
    forms.enter("gyro bias", "Stop at sigma", "3")
    assert forms.problems() == []
    forms.enter("gyro bias", "Stop at sigma", "9")
    (sentence,) = forms.problems()
    assert sentence.startswith(
        "Gyro bias, Stop at sigma (°/h): A stage may end at a sigma of 9, above the limit of 3.919;"
    )
    assert "[targets]" in forms.save()
    language.use("zh_CN")
    assert "大于限差 3.919" in forms.problems()[0]


def test_limit_beyond_the_register_range_is_explained_in_display_units(forms: FormDriver) -> None:
    forms.open("products", "mems_c", "Limits")
    forms.enter("gyro bias", "Highest", "30000")
    (sentence,) = forms.problems()
    assert sentence.startswith("Gyro bias (°/h): The limit allows gyro_bias_x from −30000 to 30000, but register 0")
    assert "can store only −20626.5 to 20626.5" in sentence
    language.use("zh_CN")
    assert forms.problems()[0].startswith("陀螺零偏（°/h）：限差允许 gyro_bias_x 为 −30000 至 30000")


def test_limits_are_added_cleared_and_removed(forms: FormDriver) -> None:
    forms.open("products", "nav_a", "Limits")
    forms.choose("limits_add_combo", "gyro bias z")
    forms.press("limits_add_button")
    forms.enter("gyro bias z", "Sigma below", "0.01")
    forms.enter("gyro bias z", "Stop at sigma", "0.02")
    forms.click("accel quadratic", "Sigma below")
    forms._bot.keyClick(forms.table, Qt.Key.Key_Delete)
    forms.click("outer lever arm", "Unit")
    forms.press("limits_remove_button")
    text = forms.save()
    limits = tomllib.loads(text)["limits"]
    assert limits["gyro_bias_z"] == {"sigma_below": 4.84813681109536e-08}
    assert tomllib.loads(text)["targets"] == {"gyro_bias_z": 9.69627362219072e-08}
    assert "sigma_below" not in limits["accel_quadratic"]
    assert "outer_lever" not in limits
    comments = re.findall(r"^#.*", shipped("products", "nav_a"), re.MULTILINE)
    assert re.findall(r"^#.*", text, re.MULTILINE) == comments
    headers = re.findall(r"(?:^#.*\n)*^\[.*\]", text, re.MULTILINE)
    assert [h for h in headers if h.startswith("#")] == [
        h for h in re.findall(r"(?:^#.*\n)*^\[.*\]", shipped("products", "nav_a"), re.MULTILINE) if h.startswith("#")
    ], "each comment is still above its table"


@pytest.mark.parametrize(
    ("lang", "named"), [("en", "press Delete, and it follows again"), ("zh_CN", "按 Delete 键，即恢复跟随")]
)
@pytest.mark.parametrize("action", ["delete", "type the opposite"])
def test_a_lowest_limit_follows_the_highest_again(forms: FormDriver, action: str, lang: Language, named: str) -> None:
    forms.open("products", "nav_a", "Limits")
    forms.enter("gyro bias", "Lowest", "-0.5")
    forms.enter("gyro bias", "Highest", "0.75")
    assert forms.cell_text("gyro bias", "Lowest") == "−0.5"
    if action == "delete":
        forms.click("gyro bias", "Lowest")
        forms._bot.keyClick(forms.table, Qt.Key.Key_Delete)
    else:
        forms.enter("gyro bias", "Lowest", "-0.75")
    assert forms.problems() == []
    language.use(lang)
    assert any(named in each.text() for each in forms.root.findChildren(QLabel) if each.isVisible())
    language.use("en")
    assert forms.cell_text("gyro bias", "Lowest") == "−0.75"
    forms.enter("gyro bias", "Highest", "0.25")
    assert forms.cell_text("gyro bias", "Lowest") == "−0.25"


def test_typing_in_a_selected_cell_replaces_its_value(forms: FormDriver) -> None:
    forms.open("products", "nav_a", "Limits")
    forms.click("inner lever arm", "Sigma below")
    forms._bot.keyClick(forms.table, Qt.Key.Key_3)
    editor = forms.table.indexWidget(forms.index("inner lever arm", "Sigma below"))
    assert isinstance(editor, QLineEdit)
    forms._bot.keyClicks(editor, ".5")
    forms.commit(editor)
    assert tomllib.loads(forms.text)["limits"]["inner_lever"]["sigma_below"] == 0.0035


# Noise and priors


def test_noise_is_entered_in_data_sheet_units(forms: FormDriver) -> None:
    forms.open("imus", "bench_nav", "Noise")
    assert (forms.cell_text("angle random walk", "Value"), forms.cell_text("angle random walk", "Unit")) == (
        "0.001",
        "°/√h",
    )
    forms.enter("angle random walk", "Value", "0.002")
    forms.enter("velocity random walk", "Value", "10")
    forms.enter("gyro bias instability", "Value", "0.01")
    assert forms.cell_text("gyro, one count (LSB)", "Unit") == "″"
    forms.select("output", "Value", "mean rate over the sample")
    assert forms.cell_text("gyro, one count (LSB)", "Unit") == "°/h"
    forms.enter("sample rate", "Value", "0")
    assert forms.problems() == ["Sample rate, Value (Hz): Out of range; it must be greater than 0."]
    forms.enter("sample rate", "Value", "400")
    profile = tomllib.loads(forms.text)
    assert profile["noise"]["gyro_arw"] == pytest.approx(0.002 * 2.908882086657216e-4)
    assert profile["noise"]["accel_vrw"] == 9.80665e-05
    assert profile["noise"]["gyro_bias_instability"] == 4.84813681109536e-08
    assert profile["stream"]["output"] == "rate"
    assert profile["stream"]["sample_rate_hz"] == 400
    assert "# rad/√s\n" in forms.text
    assert "gyro_lsb = 4.84813681109536e-08  # rad\n" in forms.text


def test_priors_and_their_drift_are_edited_in_one_table(forms: FormDriver) -> None:
    forms.open("imus", "bench_mems", "Priors")
    assert forms.cell_text("accel bias", "Change in a year, sigma") == "2039.43"
    forms.enter("accel bias", "Prior sigma", "5000")
    forms.choose("priors_add_combo", "gyro bias y")
    forms.press("priors_add_button")
    assert forms.problems() == ["Gyro bias y, Prior sigma (°/h): Missing; fill it in."]
    forms.enter("gyro bias y", "Prior sigma", "500")
    text = forms.save()
    priors = tomllib.loads(text)["prior"]
    assert priors["accel_bias"] == {"sigma": 0.0490332500000000}
    assert priors["gyro_bias_y"]["sigma"] == pytest.approx(500 * 4.848136811e-6)
    assert re.findall(r"#.*", text) == re.findall(r"#.*", shipped("imus", "bench_mems"))


# Register maps


def test_registers_are_edited_moved_added_and_removed_with_their_comments(forms: FormDriver) -> None:
    forms.open("imus", "dsp_modbus", "Registers")
    assert forms.cell_text("4", "Unit") == "µg"
    contents = str(forms.index("3", "Contents").data(Qt.ItemDataRole.ToolTipRole))
    assert contents.endswith("accel_matrix_zz"), "the whole list, which is too long for the column"
    forms.select("1", "Matrix by", "rows")
    forms.enter("4", "Scale (SI)", "2e-7")
    forms.enter("6", "Tolerance", "0.5")
    forms.enter("2", "Type", "f32")
    forms.click("3", "Address")
    forms.press("registers_up_button")
    forms.press("registers_up_button")
    assert forms.table.currentIndex().row() == 0
    assert not forms.find(QPushButton, "registers_up_button").isEnabled()
    forms.press("registers_add_button")
    assert forms.cell_text("7", "Address") == "227"
    forms.enter("7", "Contents", "g_sensitivity")
    assert forms.cell_text("7", "Unit") == "°/h/g"
    text = forms.save()
    registers = tomllib.loads(text)["registers"]
    before = tomllib.loads(shipped("imus", "dsp_modbus"))["registers"]
    assert [r["address"] for r in registers] == [200, 100, 118, 212, 218, 224, 227]
    assert registers[0] == before[2]
    assert registers[1] == {**before[0], "major": "row"}
    assert registers[2]["type"] == "f32"
    assert registers[3]["scale"] == 2e-7
    assert registers[5]["tolerance"] == 0.0005
    assert registers[6]["parameters"] == ["g_sensitivity"]
    assert "# Page 1, gyros: E column by column" in text.partition("address = 100")[0].rpartition("[[registers]]")[0]
    assert re.search(r"# Page 2, accelerometers.*\n\[\[registers\]\]\npage = 2\naddress = 200", text)
    forms.click("7", "Address")
    forms.press("registers_remove_button")
    forms.click("1", "Address")
    forms.press("registers_down_button")
    forms.press("registers_down_button")
    restored = forms.save()
    assert [r["address"] for r in tomllib.loads(restored)["registers"]] == [r["address"] for r in before]
    assert re.findall(r"^#.*", restored, re.MULTILINE) == re.findall(
        r"^#.*", shipped("imus", "dsp_modbus"), re.MULTILINE
    )


def test_an_invalid_register_is_marked_at_its_cell(forms: FormDriver) -> None:
    forms.open("imus", "bench_mems", "Registers")
    forms.enter("1", "Highest", "100")
    (sentence,) = forms.problems()
    assert "gyro_bias_x in register 0 may need" in sentence
    assert sentence.startswith("Row 1 (°/h): ")
    assert "its range is −20626.5 to 100" in sentence
    forms.enter("1", "Highest", "20626.5")
    assert forms.problems() == []
    forms.enter("1", "Contents", "gyro_bias_x, gyro_bias_q")
    assert forms.problems()[0].startswith("Row 1, Contents: 'gyro_bias_q' is not a parameter or group.")
    forms.press("discard_station_button")
    forms.enter("2", "Address", "1.5")
    assert forms.problems() == ["Row 2, Address: Not a whole number; type one like 12."]
    forms.enter("2", "Address", "2")
    assert forms.problems()[0].startswith("Row 2, Address: Registers 2-10 overlap registers[1]")
    assert not forms.find(QPushButton, "save_station_button").isEnabled()


# Form and text


def test_form_and_text_stay_synchronised(forms: FormDriver) -> None:
    forms.open("products", "nav_a", "Limits")
    forms.enter("inner lever arm", "Highest", "30")
    forms.show_view("Text")
    assert "within = 0.03\n" in forms.text
    forms.page.profiles.editor.setPlainText(forms.text.replace("[limits.inner_lever]", "[limits.inner_lever_x]"))
    forms.show_view("Limits")
    assert forms.cell_text("inner lever arm x", "Highest") == "30"


def test_invalid_text_disables_the_form(forms: FormDriver) -> None:
    forms.open("products", "nav_a", "Limits")
    right = forms.text
    for wrong, reason in (
        (right.replace("[limits.gyro_bias]", "[limits.gyro_bias"), "The text is not valid TOML"),
        (re.sub(r"\[limits\.\w+\][^[]*", "", right).replace("[warm_up]", "limits = 3\n[warm_up]", 1), "limits"),
    ):
        forms.page.profiles.editor.setPlainText(wrong)
        label = forms.find(QLabel, "limits_form_reason")
        assert label.text().startswith("The text must be corrected before the form can show it: ")
        assert reason in label.text()
        assert not forms.table.isEnabled()
        add = forms.find(QPushButton, "limits_add_button")
        assert not add.isEnabled()
        assert add.toolTip() == label.text()
    forms.page.profiles.editor.setPlainText(right)
    assert forms.table.isEnabled()
    assert not label.isVisible()
    assert forms.cell_text("inner lever arm", "Highest") == "24"


def test_clicking_a_problem_outside_the_form_opens_the_text(forms: FormDriver) -> None:
    forms.open("products", "nav_a", "Limits")
    forms.page.profiles.editor.setPlainText(forms.text.replace("turns = 2", "turns = 0"))
    assert forms.problems()[0].startswith("Line 19: schedule.rate.turns: 0 is out of range")
    listed = forms.find(QListWidget, "problems_list")
    forms._bot.mouseClick(
        listed.viewport(), Qt.MouseButton.LeftButton, pos=listed.visualItemRect(listed.item(0)).center()
    )
    assert forms.page.profiles.views.currentWidget() is forms.page.profiles.editor
    assert forms.page.profiles.editor.textCursor().blockNumber() == 18


def test_clicking_a_problem_selects_its_cell(forms: FormDriver) -> None:
    forms.open("products", "mems_c", "Limits")
    forms.enter("accel bias", "Sigma below", "x")
    forms.click("gyro bias", "Highest")
    listed = forms.find(QListWidget, "problems_list")
    at = listed.visualItemRect(listed.item(0)).center()
    forms._bot.mouseClick(listed.viewport(), Qt.MouseButton.LeftButton, pos=at)
    assert forms.table.currentIndex() == forms.index("accel bias", "Sigma below")


@pytest.mark.parametrize(
    ("kind", "name", "title", "cell"),
    [
        ("products", "nav_a", "Limits", ("gyro bias", "Highest")),
        ("imus", "dsp_modbus", "Noise", ("output", "Value")),
        ("imus", "dsp_modbus", "Priors", ("gyro bias", "Prior sigma")),
        ("imus", "dsp_modbus", "Registers", ("1", "Matrix by")),
    ],
)
def test_operator_can_read_and_copy_but_not_change_values(
    locked: FormDriver, kind: str, name: str, title: str, cell: tuple[str, str]
) -> None:
    locked.open(kind, name, title)
    locked.click(*cell, twice=True)
    locked._bot.keyClick(locked.table, Qt.Key.Key_Delete)
    locked._bot.keyClicks(locked.table, "7")
    assert locked.table.indexWidget(locked.index(*cell)) is None
    assert "engineer" in str(locked.index(*cell).data(Qt.ItemDataRole.ToolTipRole))
    for button in locked.page.profiles.views.currentWidget().findChildren(QPushButton):
        assert not button.isEnabled()
        assert "engineer" in button.toolTip()
    assert locked.text == shipped(kind, name)
    locked._bot.keyClick(locked.table, Qt.Key.Key_C, Qt.KeyboardModifier.ControlModifier)
    assert cell[1] in QGuiApplication.clipboard().text()


def test_a_form_is_saved_as_csv(forms: FormDriver, tmp_path: Path) -> None:
    forms.open("products", "nav_a", "Limits")
    at = QPoint(5, 5)
    event = QContextMenuEvent(QContextMenuEvent.Reason.Mouse, at, forms.table.viewport().mapToGlobal(at))
    QApplication.sendEvent(forms.table.viewport(), event)
    menu = forms.table.findChild(QMenu)
    assert isinstance(menu, QMenu)
    menu.actions()[1].trigger()
    menu.close()
    dialog = forms.root.findChild(QFileDialog)
    assert isinstance(dialog, QFileDialog)
    target = tmp_path / "limits.csv"
    dialog.fileSelected.emit(str(target))
    dialog.close()
    with target.open(encoding="utf-8-sig", newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0][:5] == ["parameter", "Unit", "Lowest", "Highest", "Sigma below"]
    assert rows[1][:5] == ["gyro_bias", "°/h", "-3.09397", "3.09397", "0.0200077"]


@pytest.mark.parametrize(("code", "said"), [("en", "determines gyro bias"), ("zh_CN", "都不能确定陀螺零偏")])
def test_limits_without_a_stage_are_listed_and_changed_stages_need_a_reason(
    forms: FormDriver, code: Language, said: str
) -> None:
    language.use(code)
    library.site_folder().joinpath("products").mkdir(exist_ok=True)
    path = library.site_folder() / "products" / "short.toml"
    path.write_text(tomli_w.dumps(PRODUCT), encoding="utf-8")
    forms.open("products", "short", say("form.tab_limits"))
    draft = forms.page.profiles._draft
    assert draft is not None
    assert forms.problems() == []
    draft.set({("stages",): ["six_position"]})
    assert any(said in problem for problem in forms.problems())
    assert forms.find(QLineEdit, "change_reason_edit").isVisible()
    draft.set({("stages",): None})
    assert not forms.find(QLineEdit, "change_reason_edit").isVisible()
    draft.set({("confirmation", "required_for"): ["override"]})
    assert forms.find(QLineEdit, "change_reason_edit").isVisible()
    language.use("en")
