"""Panel that asks one or two engineers for badge and PIN before an action, and for its reason."""

from collections.abc import Callable

from PySide6.QtCore import Signal
from PySide6.QtGui import QHideEvent, QShowEvent
from PySide6.QtWidgets import QFrame, QLabel, QLineEdit

from calstation.config import ConfirmationRequired, Person
from calstation.gui.text import Words, bind, on_language_change, say
from calstation.gui.widgets import button, column, enable, grid, label, row, theme

# Function called with the reason, the acting person, and the confirming person, None if none is required.
Then = Callable[[str, Person, Person | None], None]


class PeoplePanel(QFrame):
    """Hidden until `ask`; the caller hides it after the action, or leaves it open for another attempt."""

    asking = Signal(bool)  #: Emitted when the panel opens and closes.

    def __init__(self, name: str) -> None:
        super().__init__()
        self.setObjectName(f"{name}_panel")
        self.setProperty("kind", "panel")
        self._words: Words = ""
        self._then: Then = lambda reason, first, second: None
        self._badges = False
        self._title = label(kind="section", wrap=True)
        self._fields = grid(across=2 * theme.GRID, down=theme.GRID // 2, stretch=1)
        self._captions: list[QLabel] = []
        self._edits: list[QLineEdit] = []
        for key in ("reason", "badge", "pin", "second_badge", "second_pin"):
            edit, caption = QLineEdit(), label()
            edit.setObjectName(f"{name}_{key}_edit")
            edit.textChanged.connect(lambda _: self._refresh())
            edit.returnPressed.connect(self._confirm)
            if key.endswith("pin"):
                edit.setEchoMode(QLineEdit.EchoMode.Password)
            caption.setBuddy(edit)
            self._fields.addWidget(caption, len(self._edits), 0)
            self._fields.addWidget(edit, len(self._edits), 1)
            self._captions.append(caption)
            self._edits.append(edit)
        self._confirm_button = button(f"{name}_confirm_button", "window.confirm", self._confirm)
        cancel = button(f"{name}_cancel_button", "common.cancel", self.hide)
        column(
            self._title,
            self._fields,
            row(None, cancel, self._confirm_button),
            on=self,
            margins=(2 * theme.GRID, theme.GRID, 2 * theme.GRID, theme.GRID),
        )
        bind(self.setAccessibleName, "window.confirmation")
        on_language_change(self, self._show_texts)
        self.hide()

    def ask(
        self, words: Words, required: ConfirmationRequired, then: Then, *, by: str = "", reason: bool = True
    ) -> None:
        """Ask for the badges, PINs and reason of an action titled `words`; `by` is the expected acting person."""
        self._words, self._then, self._badges = words, then, required.badge
        shown = (reason, True, required.pin, required.second, required.second)
        for caption, edit, visible in zip(self._captions, self._edits, shown, strict=True):
            edit.clear()
            caption.setVisible(visible)
            edit.setVisible(visible)
        self._edits[1].setText(by)
        self._show_texts()
        self._refresh()
        self.show()
        next(edit for edit in self._edits if not edit.isHidden() and not edit.text()).setFocus()

    def retry(self) -> None:
        """Clear the PINs after a refused attempt."""
        for edit in (self._edits[2], self._edits[4]):
            edit.clear()
        self._edits[2].setFocus()

    def showEvent(self, event: QShowEvent) -> None:
        """Report that the panel is open."""
        super().showEvent(event)
        self.asking.emit(True)

    def hideEvent(self, event: QHideEvent) -> None:
        """Report that the panel is closed."""
        super().hideEvent(event)
        self.asking.emit(False)

    def _missing(self) -> bool:
        return any(not edit.isHidden() and not edit.text().strip() for edit in self._edits)

    def _confirm(self) -> None:
        if not self._missing():
            reason, badge, pin, second_badge, second_pin = (edit.text() for edit in self._edits)
            second = None if self._edits[3].isHidden() else Person(second_badge.strip(), second_pin)
            self._then(reason.strip(), Person(badge.strip(), pin), second)

    def _refresh(self) -> None:
        enable(self._confirm_button, say("window.fill_in") if self._missing() else "")

    def _show_texts(self) -> None:
        name = "window.your_badge" if self._badges else "window.confirming_name"
        codes = "window.reason", name, "window.your_pin", "window.second_badge", "window.second_pin"
        for caption, text in zip(self._captions, map(say, codes), strict=True):
            caption.setText(text)
        self._title.setText(say(self._words))
        self._refresh()
