"""This computer: language, theme, folder of the runs, the engineer's name and PIN; nothing that changes a result."""

from pathlib import Path

from PySide6.QtCore import QEvent, QSignalBlocker, Qt
from PySide6.QtWidgets import (
    QFileDialog,
    QFrame,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from calstation.config import access as role
from calstation.errors import ConfigurationError
from calstation.gui.settings.drafts import Drafts, who_saves
from calstation.gui.settings.fields import Row, at_top, tab_through
from calstation.gui.settings.inputs import ChoiceBox
from calstation.gui.shell.context import AppContext
from calstation.gui.text import language
from calstation.gui.widgets import theme


class PersonalSection(QWidget):
    """Each setting is in force at once; only PIN and name ask for the engineer's role."""

    def __init__(self, app: AppContext, drafts: Drafts) -> None:
        super().__init__()
        self._app, self._drafts = app, drafts
        self._heading, self._pin_heading = QLabel(), QLabel()
        for label in (self._heading, self._pin_heading):
            label.setProperty("kind", "section")
        self.language_box = ChoiceBox(lambda: list(language.LANGUAGES))
        self.language_box.setObjectName("station_language_combo")
        self.language_box.typed.connect(lambda: app.set_language(self.language_box.value()))
        self.theme_box = ChoiceBox(lambda: [("light", self.tr("light")), ("dark", self.tr("dark"))])
        self.theme_box.setObjectName("theme_combo")
        self.theme_box.typed.connect(lambda: app.set_theme(self.theme_box.value()))
        self.runs_label, self.author_edit = QLabel(), QLineEdit()
        self.runs_label.setObjectName("runs_folder_label")
        self.runs_label.setWordWrap(True)
        self.runs_label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.runs_button = QPushButton()
        self.runs_button.setObjectName("runs_folder_button")
        self.runs_button.clicked.connect(self._choose_runs)
        self.author_edit.setObjectName("author_edit")
        self.author_edit.setPlaceholderText(who_saves())
        self.author_edit.textEdited.connect(lambda text: app.settings.setValue("author", text.strip()))
        self._runs_note = QLabel()
        self._runs_note.setProperty("kind", "muted")
        self._runs_note.setWordWrap(True)
        rows = [
            Row(self.language_box, lambda: self.tr("Language")),
            Row(self.theme_box, lambda: self.tr("Colours")),
            Row(self.author_edit, lambda: self.tr("Engineer's name in versions")),
            Row(self.runs_label, lambda: self.tr("Folder of the runs")),
            Row(self._runs_note, str),
            Row(self.runs_button, str),
        ]
        left = QVBoxLayout()
        left.setSpacing(theme.GRID)
        left.addWidget(self._heading)
        for row in rows:
            left.addWidget(row)
        left.addStretch(1)
        row_ = QHBoxLayout(self)
        row_.setContentsMargins(0, 0, 0, 0)
        row_.setSpacing(3 * theme.GRID)
        row_.addLayout(left)
        row_.addWidget(at_top(self._pin_panel()), 1)
        tab_through(self.language_box, self.theme_box, self.author_edit, self.runs_button, self.old_edit)
        app.theme_changed.connect(self.refresh)
        self.retranslate()

    def _pin_panel(self) -> QWidget:
        panel = QFrame()
        panel.setProperty("kind", "panel")
        self._pin_note, self._pin_message = QLabel(), QLabel()
        self._pin_note.setProperty("kind", "muted")
        for label in (self._pin_note, self._pin_message):
            label.setWordWrap(True)
        self.old_edit, self.new_edit, self.again_edit = QLineEdit(), QLineEdit(), QLineEdit()
        for edit, name in (
            (self.old_edit, "old_pin_edit"),
            (self.new_edit, "new_pin_edit"),
            (self.again_edit, "new_pin_again_edit"),
        ):
            edit.setObjectName(name)
            edit.setEchoMode(QLineEdit.EchoMode.Password)
            edit.textEdited.connect(lambda _: self._say_pin("", "muted"))
            edit.returnPressed.connect(self._change_pin)
        self.pin_button = QPushButton()
        self.pin_button.setObjectName("change_pin_button")
        self.pin_button.clicked.connect(self._change_pin)
        self._pin_rows = [
            Row(self.old_edit, lambda: self.tr("Current PIN")),
            Row(self.new_edit, lambda: self.tr("New PIN")),
            Row(self.again_edit, lambda: self.tr("The same again")),
            Row(self.pin_button, str),
        ]
        column = QVBoxLayout(panel)
        column.setContentsMargins(2 * theme.GRID, 2 * theme.GRID, 2 * theme.GRID, 2 * theme.GRID)
        column.setSpacing(theme.GRID)
        column.addWidget(self._pin_heading)
        column.addWidget(self._pin_note)
        for row in self._pin_rows:
            column.addWidget(row)
        column.addWidget(self._pin_message)
        column.addStretch(1)
        return panel

    def lock(self, reason: str) -> None:
        """Forbid what needs the engineer's role, with the reason as tooltip; "" allows it."""
        for widget in (self.author_edit, self.old_edit, self.new_edit, self.again_edit, self.pin_button):
            widget.setEnabled(not reason)
            widget.setToolTip(reason)
        self.refresh()

    def refresh(self) -> None:
        """Show what is in force."""
        with QSignalBlocker(self.language_box), QSignalBlocker(self.theme_box):
            self.language_box.show_value(language.current())
            self.theme_box.show_value(theme.current())
        self.runs_label.setText(str(self._app.runs_folder.absolute()))
        self.runs_label.setToolTip(self.runs_label.text())
        self.author_edit.setText(str(self._app.settings.value("author", "")))
        self._pin_rows[0].setVisible(role.has_pin())
        self.pin_button.setText(self.tr("Change the PIN") if role.has_pin() else self.tr("Set the PIN"))

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self._heading.setText(self.tr("This computer"))
        self._pin_heading.setText(self.tr("The engineer's PIN"))
        self._pin_note.setText(
            self.tr("It opens whatever changes results. Kept as a salted hash; nobody can read it back.")
        )
        self.theme_box.fill()
        self.runs_button.setText(self.tr("Choose a folder"))
        self._runs_note.setText(
            self.tr("Logs and results of new runs go into this folder, and the history looks there.")
        )
        self._say_pin("", "muted")
        self.refresh()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def _choose_runs(self) -> None:
        folder = QFileDialog.getExistingDirectory(
            self, self.tr("Folder of the runs"), str(self._app.runs_folder.absolute())
        )
        if folder:
            self._app.set_runs_folder(Path(folder))
            self.refresh()

    def _change_pin(self) -> None:
        if self.new_edit.text() != self.again_edit.text():
            self._say_pin(self.tr("The two are not the same."), "error")
            self.again_edit.setFocus()
            return
        if len(self.new_edit.text()) < role.SHORTEST:
            self._say_pin(self.tr("Too short: at least {0} characters.").format(role.SHORTEST), "error")
            self.new_edit.setFocus()
            return
        try:
            role.set_pin(self.old_edit.text(), self.new_edit.text())
        except ConfigurationError as error:
            wait = role.wait()
            text = self.tr("The current PIN is wrong.")
            if wait > 0.0:
                text += " " + self.tr("Wait {0:.0f} s.").format(max(1.0, wait))
            self._say_pin(text if role.has_pin() else str(error), "error")
            self.old_edit.setFocus()
            self.old_edit.selectAll()
            return
        for edit in (self.old_edit, self.new_edit, self.again_edit):
            edit.clear()
        self.refresh()
        self._say_pin(self.tr("The PIN has been changed."), "muted")

    def _say_pin(self, text: str, kind: str) -> None:
        self._pin_message.setText(text)
        theme.set_kind(self._pin_message, kind)
