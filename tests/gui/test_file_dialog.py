"""File dialogs: an existing file is replaced only after a question, and a missing one is named."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QApplication, QLabel, QLineEdit, QPushButton, QTreeView, QWidget
from pytestqt.qtbot import QtBot

from calstation.gui.text import language
from calstation.gui.widgets import ask_file, ask_folder, ask_open
from calstation.gui.widgets.file_dialog import FileDialog


class Chooser:
    """Opens the dialogs of a widget; `chosen` contains the paths that were chosen."""

    def __init__(self, qtbot: QtBot) -> None:
        self.widget, self.qtbot, self.chosen = QWidget(), qtbot, list[Path]()
        qtbot.addWidget(self.widget)
        self.widget.show()

    @property
    def dialog(self) -> FileDialog:
        """The only open dialog."""
        (dialog,) = [each for each in self.widget.findChildren(FileDialog) if each.isVisible()]
        return dialog

    def type(self, name: str) -> None:
        """Type a name and Enter."""
        edit = self.dialog.findChild(QLineEdit, "fileNameEdit")
        assert isinstance(edit, QLineEdit)
        edit.selectAll()
        self.qtbot.keyClicks(edit, name)
        self.qtbot.keyClick(edit, Qt.Key.Key_Return)

    def press(self, name: str) -> None:
        """Press a button of the question."""
        button = self.dialog.findChild(QPushButton, name)
        assert isinstance(button, QPushButton)
        self.qtbot.mouseClick(button, Qt.MouseButton.LeftButton)

    def says(self) -> str:
        """Return the visible texts of the dialog."""
        return "\n".join(each.text() for each in self.dialog.findChildren(QLabel) if each.isVisible())


@pytest.fixture
def chooser(qtbot: QtBot) -> Iterator[Chooser]:
    yield Chooser(qtbot)
    language.use("en")


@pytest.mark.parametrize(
    ("code", "question", "missing"),
    [("en", "a.csv exists already.", "b.csv does not exist."), ("zh_CN", "a.csv 已经存在。", "b.csv 不存在。")],
)
def test_existing_file_is_replaced_after_a_question_and_a_missing_one_is_named(
    chooser: Chooser, tmp_path: Path, code: str, question: str, missing: str
) -> None:
    language.use(code)
    (tmp_path / "a.csv").write_text("old", encoding="utf-8")
    ask_file(chooser.widget, "Save", tmp_path / "c.csv", ["CSV (*.csv)"], chooser.chosen.append)
    chooser.type("a.csv")
    assert question in chooser.says()
    assert QApplication.activeModalWidget() is None
    focused = QApplication.focusWidget()
    assert focused is None or focused.objectName() == "keep_file_button", "a second Enter does not replace the file"
    chooser.press("keep_file_button")
    assert chooser.chosen == []
    chooser.type("a.csv")
    chooser.press("replace_file_button")
    assert chooser.chosen == [tmp_path / "a.csv"]

    ask_open(chooser.widget, "Open", tmp_path, ["CSV (*.csv)"], chooser.chosen.append)
    chooser.type("b.csv")
    assert missing in chooser.says()
    assert chooser.chosen == [tmp_path / "a.csv"]


def test_another_dialog_replaces_the_open_one(chooser: Chooser, tmp_path: Path) -> None:
    ask_open(chooser.widget, "Open", tmp_path, ["CSV (*.csv)"], chooser.chosen.append)
    ask_folder(chooser.widget, "Folder", tmp_path, chooser.chosen.append)
    assert chooser.dialog.windowTitle() == "Folder"
    assert not chooser.dialog.isModal()


def test_dialog_is_chinese_in_chinese(chooser: Chooser, tmp_path: Path) -> None:
    language.use("zh_CN")
    (tmp_path / "folder").mkdir()
    for ask in (
        lambda: ask_file(chooser.widget, "", tmp_path / "a.csv", ["CSV (*.csv)"], chooser.chosen.append),
        lambda: ask_open(chooser.widget, "", tmp_path, ["CSV (*.csv)"], chooser.chosen.append),
        lambda: ask_folder(chooser.widget, "", tmp_path, chooser.chosen.append),
    ):
        ask()
        parts = [*chooser.dialog.findChildren(QLabel), *chooser.dialog.findChildren(QPushButton)]
        texts = [each.text() for each in parts if each.isVisible() and each.text()]
        assert len(texts) >= 5
        for text in texts:
            assert not re.search("[A-Za-z]{2,}", text), text
        files = chooser.dialog.findChild(QTreeView, "treeView")
        assert isinstance(files, QTreeView)
        shown = [i for i in range(files.model().columnCount()) if not files.isColumnHidden(i)]
        assert "Folder" not in [files.model().index(0, i, files.rootIndex()).data() for i in shown]
