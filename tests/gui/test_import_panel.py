"""Importing on the offline page: a recording is shown before anything is written, and the new log is opened."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QApplication, QComboBox, QFileDialog, QLineEdit, QPushButton
from pytestqt.qtbot import QtBot

from calstation.gui.help.manual import anchor, sections
from calstation.gui.logs import OfflinePage
from calstation.gui.state import AppContext
from calstation.gui.text import language
from tests.records.foreign_samples import imu_message, samples

WAIT = 60_000
UNITS = ("deg/s", "deg/s", "deg/s", "g", "g", "g")
HEADER = "t,gx,gy,gz,ax,ay,az"
TOML = (
    "[site]\nlatitude_deg = 34.25\nlongitude_deg = 108.9\nheight_m = 400.0\n"
    '[imu]\nserial = "H7"\nsample_rate_hz = 50.0\ngyro_arw = 4.4e-5\naccel_vrw = 5.9e-4\n'
    '[columns]\ntime_s = { from = "t" }\n'
)


def write_recording(folder: Path, unit: str = "g") -> Path:
    """Write a CSV of another program with a gap; accelerations are in g."""
    values = np.random.default_rng(0).normal([0, 0, 0, 0, 0, 1], 0.02, (300, 6))
    lines = [f"{0.02 * k:.2f},{','.join(f'{v:.5f}' for v in row)}" for k, row in enumerate(values) if k != 200]
    (path := folder / "walk.csv").write_text("\n".join([HEADER, *lines]))
    entries = zip(HEADER.split(",")[1:], [f"{s}_{a}" for s in ("gyro", "accel") for a in "xyz"], UNITS, strict=True)
    columns = "".join(f'{name} = {{ from = "{cell}", unit = "{u}" }}\n' for cell, name, u in entries)
    path.with_suffix(".toml").write_text(TOML + columns.replace('"g"', f'"{unit}"'))
    return path


@pytest.fixture
def page(app: AppContext, qtbot: QtBot) -> Iterator[OfflinePage]:
    app.settings.clear()
    offline_page = OfflinePage(app)
    qtbot.addWidget(offline_page)
    offline_page.resize(1366, 640)
    offline_page.show()
    qtbot.waitExposed(offline_page)
    yield offline_page
    for watch in (offline_page.importer.looker, offline_page.importer.exports.watch, offline_page.reader):
        watch.cancel()
    language.use("en")


def choose(page: OfflinePage, qtbot: QtBot, button: str, path: Path) -> None:
    """Click a button that opens a file dialog, and choose a file in it."""
    qtbot.mouseClick(page.findChild(QPushButton, button), Qt.MouseButton.LeftButton)
    (dialog,) = page.window().findChildren(QFileDialog)
    dialog.findChild(QLineEdit, "fileNameEdit").setText(str(path))
    dialog.accept()
    QApplication.processEvents()


def looked(page: OfflinePage, qtbot: QtBot) -> list[str]:
    """Wait for the contents, and return the texts of their rows."""
    qtbot.waitUntil(lambda: not page.importer.looker.busy, timeout=WAIT)
    rows = page.importer.rows
    cells = [rows.itemAtPosition(k, column) for k in range(rows.rowCount()) for column in (0, 1)]
    return [cell.widget().text() for cell in cells if cell is not None]


def test_recording_is_shown_and_imported(page: OfflinePage, qtbot: QtBot, tmp_path: Path) -> None:
    path = write_recording(tmp_path)
    choose(page, qtbot, "log_import_button", path)
    texts = looked(page, qtbot)
    assert "299, from 0 to 299, 6.0 s" in texts
    assert "1 (1 sample missing)" in texts
    assert "accel_x from 'ax', g" in texts
    assert not list(tmp_path.glob("*.h5")), "nothing is written before it is seen"
    language.use("zh_CN")
    QApplication.processEvents()
    assert "1 处，缺 1 个采样点" in looked(page, qtbot)
    language.use("en")
    choose(page, qtbot, "import_button", tmp_path / "new.h5")
    qtbot.waitUntil(lambda: page.log is not None, timeout=WAIT)
    assert page.log is not None
    assert page.log.path == tmp_path / "new.h5"
    assert page.log.facts.samples == 299


def test_units_that_gravity_contradicts_are_said_and_asked_about(
    page: OfflinePage, qtbot: QtBot, tmp_path: Path
) -> None:
    page.look_at(path := write_recording(tmp_path, unit="m/s2"))
    assert any("g instead of m/s²" in text for text in looked(page, qtbot))
    notice, imports = page.importer.notice, page.findChild(QPushButton, "import_button")
    assert notice.isVisible()
    assert notice.title_label.text() == "The units of this recording are wrong"
    assert "Correct the unit in [columns]" in notice.text_label.text()
    language.use("zh_CN")
    assert notice.title_label.text() == "这个数据的单位有误"
    assert "请改正 [columns] 中的单位" in notice.text_label.text()
    language.use("en")
    assert imports.property("kind") != "primary"
    assert not imports.hasFocus()

    qtbot.mouseClick(imports, Qt.MouseButton.LeftButton)
    assert not page.window().findChildren(QFileDialog), "nothing is imported before the question is answered"
    assert page.findChild(QPushButton, "import_not_choice").hasFocus()
    qtbot.keyClick(page.findChild(QPushButton, "import_not_choice"), Qt.Key.Key_Space)
    assert notice.title_label.text() == "The units of this recording are wrong"
    assert not page.window().findChildren(QFileDialog)
    qtbot.wait(0)  # the buttons of the closed question are deleted
    qtbot.mouseClick(imports, Qt.MouseButton.LeftButton)
    choose(page, qtbot, "import_anyway_choice", tmp_path / "new.h5")
    qtbot.waitUntil(lambda: page.log is not None, timeout=WAIT)

    write_recording(tmp_path)
    page.look_at(path)
    looked(page, qtbot)
    assert notice.isHidden()
    assert imports.property("kind") == "primary"


def test_columns_that_are_not_used_are_named(page: OfflinePage, qtbot: QtBot, tmp_path: Path) -> None:
    path = write_recording(tmp_path)
    first, *lines = path.read_text().splitlines()
    path.write_text("\n".join([f"{first},temperature_c", *(f"{line},25.0" for line in lines)]))
    choose(page, qtbot, "log_import_button", path)
    assert "not used: temperature_c" in looked(page, qtbot)
    language.use("zh_CN")
    QApplication.processEvents()
    assert "未使用：temperature_c" in looked(page, qtbot)


def test_missing_configuration_is_corrected_in_place(page: OfflinePage, qtbot: QtBot, tmp_path: Path) -> None:
    path = write_recording(tmp_path)
    path.with_suffix(".toml").rename(tmp_path / "other.toml")
    page.look_at(path)
    qtbot.waitUntil(page.importer.notice.isVisible, timeout=WAIT)
    assert not page.findChild(QPushButton, "import_button").isEnabled()
    edit = page.findChild(QLineEdit, "import_meta_edit")
    edit.setText(str(tmp_path / "other.toml"))
    qtbot.keyClick(edit, Qt.Key.Key_Return)
    assert "H7" in looked(page, qtbot)
    edit.setText(str(tmp_path / "third.toml"))
    assert not page.findChild(QPushButton, "import_button").isEnabled(), "what is imported has been seen"
    qtbot.mouseClick(page.findChild(QPushButton, "import_close_button"), Qt.MouseButton.LeftButton)
    assert not page.importer.isVisible()
    assert page.findChild(QLineEdit, "log_edit").text() == ""


@pytest.mark.parametrize(("code", "said"), [("en", "as in the manual under"), ("zh_CN", "示例见手册")])
def test_missing_configuration_refers_to_an_example_in_the_manual(
    page: OfflinePage, qtbot: QtBot, tmp_path: Path, code: str, said: str
) -> None:
    language.use(code)
    path = write_recording(tmp_path)
    path.with_suffix(".toml").unlink()
    page.look_at(path)
    qtbot.waitUntil(page.importer.notice.isVisible, timeout=WAIT)
    assert said in page.importer.notice.text_label.text()
    chapter, _, name = page.manual.partition("#")
    (section,) = [each for each in sections(chapter) if anchor(each.heading) == name]
    assert section.heading in page.importer.notice.text_label.text() or code == "zh_CN"  # the manual is in English
    assert "[columns]" in section.text


def test_topic_is_chosen_among_several(page: OfflinePage, qtbot: QtBot, tmp_path: Path) -> None:
    writer_type = pytest.importorskip("mcap.writer", reason="mcap is not installed").Writer
    with (path := tmp_path / "walk.mcap").open("wb") as stream:
        writer = writer_type(stream)
        writer.start()
        schema = writer.register_schema("sensor_msgs/msg/Imu", "ros2msg", b"")
        for topic in ("/a/imu", "/b/imu"):
            channel = writer.register_channel(topic, "cdr", schema)
            for k, each in enumerate(samples()):
                writer.add_message(channel, int(2e7 * k), imu_message(each, is_cdr=True), 0)
        writer.finish()
    path.with_suffix(".toml").write_text(TOML.partition("[columns]")[0])
    edit = page.findChild(QLineEdit, "log_edit")
    edit.setText(str(path))
    qtbot.keyClick(edit, Qt.Key.Key_Return)
    combo = page.findChild(QComboBox, "import_topic_combo")
    qtbot.waitUntil(lambda: combo.count() == 2, timeout=WAIT)
    combo.setCurrentIndex(1)
    qtbot.mouseClick(page.findChild(QPushButton, "import_look_button"), Qt.MouseButton.LeftButton)
    assert "298, from 0 to 299, 6.0 s" in looked(page, qtbot)
