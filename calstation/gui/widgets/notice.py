"""An inline bar that shows a notice or asks a question instead of a dialog."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QShowEvent
from PySide6.QtWidgets import QFrame, QPushButton

from calstation.errors import CalstationError
from calstation.gui.text import Words, on_language_change, say
from calstation.gui.widgets import theme
from calstation.gui.widgets.badge import StateIcon, state_colour
from calstation.gui.widgets.jobs import JobWatch
from calstation.gui.widgets.layout import button, clear, column, label, row, show_text


@dataclass(frozen=True)
class Choice:
    """An answer to a question: object name and text of its button, its action, and whether the button gets the focus.

    A `safe` answer confirms nothing; its button gets the focus whenever the page of the question is shown again.
    """

    name: str
    words: Words
    act: Callable[[], None]
    primary: bool = False
    safe: bool = False


class NoticeBar(QFrame):
    """A bar for one notice or question, which replaces the previous one; hidden if there is nothing to show."""

    changed = Signal()  #: Emitted after a notice or question has been shown or dismissed.

    def __init__(self, name: str = "") -> None:
        super().__init__()
        self.setObjectName(name)
        self.setProperty("kind", "panel")
        self._kind = "none"
        self._title: Words = ""
        self._text: Words = ""
        self._choices: Sequence[Choice] = ()
        self._opening = False  #: Whether the bar is being shown by `ask`, not by a change of the page.
        self._choice_buttons: dict[str, QPushButton] = {}
        self._icon = StateIcon(28)
        self.title_label, self.text_label = label(kind="section", wrap=True), label(wrap=True)
        self._buttons = row()
        row(
            (self._icon, 0, Qt.AlignmentFlag.AlignVCenter),
            (column(self.title_label, self.text_label, spacing=theme.GRID // 2), 1),
            self._buttons,
            on=self,
            spacing=2 * theme.GRID,
            margins=(3 * theme.GRID, theme.GRID, 2 * theme.GRID, theme.GRID),
        )
        self.hide()
        on_language_change(self, self.refresh)

    @property
    def asking(self) -> bool:
        """Whether a question is open."""
        return bool(self._choices) and not self.isHidden()

    @property
    def good(self) -> bool:
        """Whether the bar shows that something has succeeded."""
        return self._kind == "good" and not self.isHidden()

    def ask(self, kind: str, title: Words, text: Words, choices: Sequence[Choice] = ()) -> None:
        """Show a notice with a badge shape of `badge.KINDS` and choices from left to right; an empty text is hidden."""
        self.dismiss()
        self._kind, self._title, self._text, self._choices = kind, title, text, choices
        self._icon.set_kind(kind)
        for choice in choices:
            kind = "primary" if choice.primary else ""
            widget = button(choice.name, choice.words, lambda _, choice=choice: self._choose(choice), kind=kind)
            self._choice_buttons[choice.name] = widget
            self._buttons.addWidget(widget)
        self.refresh()
        self._opening = True
        self.show()
        self._opening = False
        for choice in choices:
            if choice.primary:
                self.button(choice.name).setFocus()
        self.changed.emit()

    def inform(self, kind: str, title: Words, text: Words, then: Callable[[], None]) -> None:
        """Show a notice with a Close button; `then` is called after the notice is closed."""
        self.ask(kind, title, text, (Choice(f"{self.objectName()}_close", "common.close", then),))

    def report(self, title: Words, error: CalstationError, then: Callable[[], None]) -> None:
        """Show an error with a Close button; `then` is called after the notice is closed."""
        self.inform("bad", title, error.as_text, then)

    def report_failures(self, watch: JobWatch, title: Words, then: Callable[[], None]) -> None:
        """Report every error of the jobs of a watch."""
        watch.failed.connect(lambda error: self.report(title, error, then))

    def offers(self, name: str) -> bool:
        """Return whether a choice, given by the object name of its button, is offered now."""
        return name in self._choice_buttons

    def button(self, name: str) -> QPushButton:
        """Return the button of a choice by its object name."""
        return self._choice_buttons[name]

    def dismiss(self) -> None:
        """Hide the bar."""
        self.hide()
        self._choices = ()
        self._choice_buttons.clear()
        clear(self._buttons)
        self.changed.emit()

    def refresh(self) -> None:
        """Update the texts of the title, the text and the buttons."""
        show_text(self.title_label, say(self._title))
        show_text(self.text_label, say(self._text))
        for choice in self._choices:
            self.button(choice.name).setText(say(choice.words))

    def showEvent(self, event: QShowEvent) -> None:
        """Focus the safe answer or, if there is none, no button when the page of an open question is shown."""
        super().showEvent(event)
        if self._choices and not (self._opening or event.spontaneous()):
            safe = next((self.button(choice.name) for choice in self._choices if choice.safe), None)
            (safe or self).setFocus()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw a band in the colour of the state along the left side."""
        super().paintEvent(event)
        painter = QPainter(self)
        painter.fillRect(1, 1, theme.GRID, self.height() - 2, QColor(state_colour(self._kind)))

    def _choose(self, choice: Choice) -> None:
        self.dismiss()
        choice.act()
