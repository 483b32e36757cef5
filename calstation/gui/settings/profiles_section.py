"""All files as text: products, IMUs, tables and stations; readable, edited with marks, compared with older versions."""

import difflib
from pathlib import Path

from PySide6.QtCore import QEvent, QSignalBlocker
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import (
    QComboBox,
    QHBoxLayout,
    QLabel,
    QListWidget,
    QPushButton,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from calstation.config import editing as settings
from calstation.config import library, version_store
from calstation.config.version_store import Version
from calstation.errors import ConfigurationError
from calstation.gui.settings.draft import Draft
from calstation.gui.settings.drafts import Drafts
from calstation.gui.settings.inputs import ChoiceBox
from calstation.gui.settings.new_file import NewFileBar
from calstation.gui.settings.readable import ReadableView
from calstation.gui.settings.toml_editor import DiffView, TomlEditor
from calstation.gui.settings.versions_panel import VersionsPanel
from calstation.gui.shell.context import AppContext
from calstation.gui.widgets import theme

_READABLE, _TEXT, _COMPARE = range(3)
_SIDE = 36 * theme.GRID


class ProfilesSection(QWidget):
    """One file at a time, with its versions beside it."""

    def __init__(self, app: AppContext, drafts: Drafts) -> None:
        super().__init__()
        self._app, self._drafts = app, drafts
        self._draft: Draft | None = None
        self._compared: Version | None = None
        self.kind_box = ChoiceBox(self._kinds)
        self.kind_box.setObjectName("file_kind_combo")
        self.kind_box.show_value("products")
        self.kind_box.setMinimumWidth(18 * theme.GRID)
        self.kind_box.typed.connect(self._fill)
        self.file_box = QComboBox()
        self.file_box.setObjectName("file_combo")
        self.file_box.setMinimumWidth(30 * theme.GRID)
        self.file_box.activated.connect(lambda _: self._open())
        self._new_button = QPushButton()
        self._new_button.setObjectName("new_file_button")
        self._new = NewFileBar(drafts)
        self._new_button.clicked.connect(
            lambda: self._new.ask(self.kind_box.value(), self.file_box.currentText())
        )
        self._new.made.connect(self._made)
        self._about = QLabel()
        self._about.setProperty("kind", "muted")
        self.readable, self.editor, self._diff = ReadableView(), TomlEditor(), DiffView()
        self.editor.textChanged.connect(self._typed)
        self.problems = QListWidget()
        self.problems.setObjectName("problems_list")
        self.problems.setWordWrap(True)
        self.problems.itemClicked.connect(lambda _: self._go())
        self.problems.itemActivated.connect(lambda _: self._go())
        self.versions = VersionsPanel()
        self.versions.setFixedWidth(_SIDE)
        self.versions.compared.connect(self._compare)
        self.versions.taken.connect(self._take)
        self._lay_out()
        drafts.changed.connect(self.refresh)
        drafts.saved.connect(lambda _: self._fill())
        app.theme_changed.connect(self._dress)
        self.retranslate()
        self._fill()

    def _lay_out(self) -> None:
        text = QWidget()
        beneath = QVBoxLayout(text)
        beneath.setContentsMargins(0, 0, 0, 0)
        beneath.setSpacing(theme.GRID)
        beneath.addWidget(self.editor, 1)
        beneath.addWidget(self.problems)
        self.views = QTabWidget()
        self.views.setObjectName("profile_views")
        self.views.setDocumentMode(True)
        self.views.tabBar().setProperty("kind", "views")
        self.views.tabBar().setDrawBase(False)
        for view in (self.readable, text, self._diff):
            self.views.addTab(view, "")
        top = QHBoxLayout()
        top.setSpacing(theme.GRID)
        top.addWidget(self.kind_box)
        top.addWidget(self.file_box)
        top.addWidget(self._new_button)
        top.addWidget(self._about, 1)
        middle = QHBoxLayout()
        middle.setSpacing(3 * theme.GRID)
        middle.addWidget(self.views, 1)
        middle.addWidget(self.versions)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(theme.GRID)
        column.addLayout(top)
        column.addWidget(self._new)
        column.addLayout(middle, 1)

    def lock(self, reason: str) -> None:
        """Forbid changes, with the reason as tooltip; "" allows them."""
        self.editor.setReadOnly(bool(reason))
        self.editor.setToolTip(reason)
        self._new_button.setEnabled(not reason)
        self._new_button.setToolTip(reason)
        if reason:
            self._new.hide()
        self.versions.lock(reason)

    def open(self, kind: str, name: str) -> None:
        """Show a file."""
        self.kind_box.show_value(kind)
        self._fill()
        self.file_box.setCurrentText(name)
        self._open()

    def refresh(self) -> None:
        """Show the draft in hand."""
        draft = self._draft
        if draft is None:
            return
        if self.editor.toPlainText() != draft.text:
            with QSignalBlocker(self.editor):
                self.editor.setPlainText(draft.text)
        said = [problem.text for problem in draft.problems]
        self.editor.mark(draft.problems, said)
        self.problems.clear()
        line = self.tr("Line {0}: {1}")
        self.problems.addItems(
            [line.format(p.line, text) for p, text in zip(draft.problems, said, strict=True)]
        )
        self.problems.setVisible(bool(said))
        self.problems.setFixedHeight((min(len(said), 3) * 3 + 1) * theme.GRID)
        self.readable.show_data(draft.kind, draft.data)
        self._say_about()
        self._show_difference()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self.kind_box.fill()
        self._new_button.setText(self.tr("New from copy"))
        for index, text in enumerate((self.tr("Readable"), self.tr("Text"), self.tr("Compare"))):
            self.views.setTabText(index, text)
        self.file_box.setAccessibleName(self.tr("File"))
        self.kind_box.setAccessibleName(self.tr("Kind of file"))
        self.refresh()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def _kinds(self) -> list[tuple[str, str]]:
        return [
            ("products", self.tr("Products")),
            ("imus", self.tr("IMUs")),
            ("tables", self.tr("Tables")),
            ("stations", self.tr("Stations")),
        ]

    def _fill(self) -> None:
        """Offer the files of the kind; stay with the present one where it is among them."""
        kind = self.kind_box.value()
        present = self.file_box.currentText()
        self.file_box.clear()
        names = library.names(kind)
        self.file_box.addItems(names)
        chosen = self._app.product_path
        if present not in names and kind == "products" and chosen is not None:
            present = chosen.stem
        self.file_box.setCurrentText(present if present in names else (names or [""])[0])
        self._open()

    def showEvent(self, event: QShowEvent) -> None:
        """Offer files that were put there beside the window."""
        super().showEvent(event)
        offered = [self.file_box.itemText(i) for i in range(self.file_box.count())]
        if offered != library.names(self.kind_box.value()):
            self._fill()

    def _open(self) -> None:
        name = self.file_box.currentText()
        if not name:
            return
        kind = self.kind_box.value()
        self._draft = self._drafts.of(kind, library.find(kind, name))
        self._compared = None
        self.versions.show_versions(self._draft)
        self.refresh()

    def _typed(self) -> None:
        if self._draft is not None and self.editor.toPlainText() != self._draft.text:
            self._draft.rewrite(self.editor.toPlainText())

    def _go(self) -> None:
        draft, row = self._draft, self.problems.currentRow()
        if draft is not None and 0 <= row < len(draft.problems):
            self.editor.go_to(draft.problems[row].line)

    def _compare(self, version: Version) -> None:
        self._compared = version
        self._show_difference()
        self.views.setCurrentIndex(_COMPARE)

    def _show_difference(self) -> None:
        draft = self._draft
        if draft is None:
            return
        if self._compared is None:
            other, name = draft.saved, self.tr("as saved")
        else:
            name = self.tr("version {0}").format(self._compared.number)
            try:
                other = version_store.text(draft.kind, draft.name, self._compared.number)
            except ConfigurationError as error:
                self._diff.show_lines([str(error)])
                return
        old, new = other.splitlines(), draft.text.splitlines()
        lines = list(difflib.unified_diff(old, new, name, self.tr("the text in hand"), lineterm="", n=4))
        same = self.tr("The text in hand is the same as {0}.").format(name)
        self._diff.show_lines(lines or [same])

    def _take(self, version: Version) -> None:
        draft = self._draft
        if draft is None:
            return
        self._compared = version
        try:
            draft.rewrite(version_store.text(draft.kind, draft.name, version.number))
        except ConfigurationError as error:
            self._diff.show_lines([str(error)])
            self.views.setCurrentIndex(_COMPARE)
            return
        self._compared = None
        self._show_difference()
        self.views.setCurrentIndex(_COMPARE)

    def _made(self, kind: str, path: Path) -> None:
        self.open(kind, path.stem)
        self.views.setCurrentIndex(_TEXT)

    def _say_about(self) -> None:
        draft = self._draft
        if draft is None or draft.path is None:
            return
        shipped = any(entry.path == draft.path and entry.shipped for entry in settings.entries(draft.kind))
        self._about.setText(
            self.tr("came with the program; saving makes this site's copy")
            if shipped
            else self.tr("this site's own")
        )
        self._about.setToolTip(str(draft.path))

    def _dress(self) -> None:
        self.editor.dress()
        self._diff.dress()
        self.refresh()
