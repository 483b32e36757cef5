"""Asks inline for the name of a new file made from a copy."""

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QFrame, QLineEdit

from calstation.config import editing, library
from calstation.errors import ConfigurationError
from calstation.gui.settings.drafts import Drafts
from calstation.gui.settings.inputs import ChoiceBox
from calstation.gui.text import error_text, on_language_change, term
from calstation.gui.widgets import button, column, enable, label, row, theme


class NewFileBar(QFrame):
    """Hidden until `ask`; emits `made(kind, path)` when the file exists."""

    made = Signal(str, object)

    def __init__(self, drafts: Drafts) -> None:
        super().__init__()
        self._drafts = drafts
        self._kind = "stations"
        self.setProperty("kind", "panel")
        self._title, self._message = label(), label(kind="error", wrap=True)
        self._title.setFont(theme.font(bold=True))
        self._name = QLineEdit()
        self._name.setObjectName("new_name_edit")
        self._name.setFixedWidth(26 * theme.GRID)
        self._name.textEdited.connect(lambda _: self._check())
        self._name.returnPressed.connect(self._make)
        self._source = ChoiceBox(lambda: [(name, name) for name in library.names(self._kind)], "new_source_combo")
        self._source.setMinimumWidth(26 * theme.GRID)
        self._make_button = button("make_file_button", lambda: self.tr("Create"), self._make, kind="primary")
        inputs = row(
            self._title,
            self._name,
            label(lambda: self.tr("copied from")),
            self._source,
            None,
            self._make_button,
            button("", lambda: self.tr("Cancel"), self.hide),
        )
        margins = (2 * theme.GRID, theme.GRID, theme.GRID, theme.GRID)
        column(inputs, self._message, on=self, spacing=theme.GRID // 2, margins=margins)
        on_language_change(self, self._check)
        self.hide()

    def ask(self, kind: str, source: str) -> None:
        """Ask for the name of a new file of a kind; `source` is offered as the file to copy."""
        self._kind = kind
        self._source.fill()
        self._source.show_value(source)
        self._name.clear()
        self._check()
        self.show()
        self._name.setFocus()

    def _check(self) -> None:
        """Show what is wrong with the name once something is typed."""
        self._title.setText(term("setting", f"new_{self._kind}"))
        name = self._name.text()
        message = ""
        if name in library.names(self._kind):
            message = self.tr("This name is taken; choose another.")
        elif name and not editing.is_name(name):
            message = self.tr("Only letters a to z, digits, - and _; a letter or digit first.")
        self._show_message(message)
        enable(self._make_button, message or ("" if name else self.tr("Type a name first.")))

    def _make(self) -> None:
        if not self._make_button.isEnabled():
            return
        source = library.find(self._kind, self._source.value())
        try:
            path = self._drafts.create(self._kind, self._name.text(), source)
        except ConfigurationError as error:
            self._show_message(error_text(error).sentences)
            return
        self.hide()
        self.made.emit(self._kind, path)

    def _show_message(self, message: str) -> None:
        self._message.setText(message)
        self._message.setVisible(bool(message))
