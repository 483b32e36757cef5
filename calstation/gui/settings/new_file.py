"""Asks inline for the name of a new file made from a copy."""

from PySide6.QtCore import QEvent, Signal
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QLineEdit, QPushButton, QVBoxLayout

from calstation.config import editing as settings
from calstation.config import library
from calstation.errors import ConfigurationError
from calstation.gui.settings.drafts import Drafts
from calstation.gui.settings.inputs import ChoiceBox
from calstation.gui.widgets import theme


class NewFileBar(QFrame):
    """Hidden until `ask`; `made(kind, path)` when the file is there."""

    made = Signal(str, object)

    def __init__(self, drafts: Drafts) -> None:
        super().__init__()
        self._drafts = drafts
        self._kind = "stations"
        self.setProperty("kind", "panel")
        self._title, self._message = QLabel(), QLabel()
        self._title.setFont(theme.font(bold=True))
        self._message.setWordWrap(True)
        self.name_edit = QLineEdit()
        self.name_edit.setObjectName("new_name_edit")
        self.name_edit.setFixedWidth(26 * theme.GRID)
        self.name_edit.textEdited.connect(lambda _: self._check())
        self.name_edit.returnPressed.connect(self._make)
        self._from = QLabel()
        self.source_box = ChoiceBox(lambda: [(name, name) for name in library.names(self._kind)])
        self.source_box.setObjectName("new_source_combo")
        self.source_box.setMinimumWidth(26 * theme.GRID)
        self.make_button, self._cancel = QPushButton(), QPushButton()
        self.make_button.setObjectName("make_file_button")
        self.make_button.setProperty("kind", "primary")
        self.make_button.clicked.connect(self._make)
        self._cancel.clicked.connect(self.hide)
        row = QHBoxLayout()
        row.setSpacing(theme.GRID)
        for widget in (self._title, self.name_edit, self._from, self.source_box):
            row.addWidget(widget)
        row.addStretch(1)
        row.addWidget(self.make_button)
        row.addWidget(self._cancel)
        column = QVBoxLayout(self)
        column.setContentsMargins(2 * theme.GRID, theme.GRID, theme.GRID, theme.GRID)
        column.setSpacing(theme.GRID // 2)
        column.addLayout(row)
        column.addWidget(self._message)
        self.retranslate()
        self.hide()

    def ask(self, kind: str, source: str) -> None:
        """Ask for the name of a new file of a kind, offered as a copy of `source`."""
        self._kind = kind
        self.source_box.fill()
        self.source_box.show_value(source)
        self.name_edit.clear()
        self.retranslate()
        self.show()
        self.name_edit.setFocus()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        titles = {
            "stations": self.tr("New station, file name"),
            "products": self.tr("New product, file name"),
            "imus": self.tr("New IMU profile, file name"),
            "tables": self.tr("New table profile, file name"),
        }
        self._title.setText(titles[self._kind])
        self._from.setText(self.tr("copied from"))
        self.make_button.setText(self.tr("Create"))
        self._cancel.setText(self.tr("Cancel"))
        self._check()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def _check(self) -> None:
        """Say beside the name what is wrong with it, once something is typed."""
        name = self.name_edit.text()
        taken = name in library.names(self._kind)
        sound = settings.is_name(name)
        message = ""
        if taken:
            message = self.tr("This name is taken; choose another.")
        elif name and not sound:
            message = self.tr("Only letters a to z, digits, - and _; a letter or digit first.")
        self._say(message)
        self.make_button.setEnabled(sound and not taken)
        self.make_button.setToolTip("" if sound and not taken else message or self.tr("Type a name first."))

    def _make(self) -> None:
        if not self.make_button.isEnabled():
            return
        name, source = self.name_edit.text(), library.find(self._kind, self.source_box.value())
        try:
            path = self._drafts.create(self._kind, name, source)
        except ConfigurationError as error:
            self._say(str(error))
            return
        self.hide()
        self.made.emit(self._kind, path)

    def _say(self, message: str) -> None:
        self._message.setText(message)
        self._message.setVisible(bool(message))
        theme.set_kind(self._message, "error" if message else "muted")
