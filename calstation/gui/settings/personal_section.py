"""The settings of this computer, which do not affect results: language, theme, sounds, runs folder and PINs."""

from pathlib import Path

from PySide6.QtCore import QSignalBlocker
from PySide6.QtWidgets import QLineEdit, QWidget

from calstation.config import access, unlisted_engineer
from calstation.errors import ConfigurationError
from calstation.gui.settings.fields import Row, panel
from calstation.gui.state import AppContext
from calstation.gui.text import bind, language, on_language_change, say
from calstation.gui.widgets import (
    ChoiceBox,
    FlagBox,
    ask_folder,
    button,
    choices_of,
    column,
    enable,
    label,
    line_edit,
    plain_tip,
    row,
    theme,
)


class PersonalSection(QWidget):
    """The section for the settings of this computer, of which the PINs and the folder require the engineer role."""

    def __init__(self, app: AppContext) -> None:
        super().__init__()
        self._app = app
        self._language = ChoiceBox(lambda: list(language.LANGUAGES), "station_language_combo")
        self._language.typed.connect(lambda: app.set_language(self._language.value()))
        self._theme = ChoiceBox(choices_of("theme", "light", "dark"), "theme_combo")
        self._theme.typed.connect(lambda: app.set_theme(self._theme.value()))
        self._sounds = FlagBox()
        self._sounds.setObjectName("sounds_check")
        self._sounds.setChecked(bool(app.settings.value("sounds", True, type=bool)))
        self._sounds.typed.connect(lambda: app.settings.setValue("sounds", self._sounds.value()))
        bind(self._sounds, "settings.after_every_scan")
        self._runs = label(name="runs_folder_label", wrap=True, selectable=True)
        self._folder_button = button("runs_folder_button", "settings.choose_folder", self._choose_runs)
        left = column(
            label("settings.this_computer", "section"),
            Row(self._language, "language"),
            Row(self._theme, "theme"),
            Row(self._sounds, "sounds"),
            Row(self._runs, "runs_folder"),
            Row(label("setting.about_runs", "muted", wrap=True)),
            Row(self._folder_button),
            None,
        )
        row(left, (self._make_pin_panel(), 1), on=self, spacing=3 * theme.GRID)
        theme.themes.changed.connect(self.refresh)
        on_language_change(self, self.pin_message.clear)
        on_language_change(self, self.refresh)

    def _make_pin_panel(self) -> QWidget:
        self.pin_message = label(wrap=True)
        names = ("old_pin_edit", "new_pin_edit", "new_pin_again_edit")
        self._pins = self._old, self._new, self._again = (
            *(line_edit(name, lambda _: self.pin_message.clear()) for name in names),
        )
        for edit in self._pins:
            edit.setEchoMode(QLineEdit.EchoMode.Password)
            edit.returnPressed.connect(self._change_pin)
        self._pin_button = button("change_pin_button", pressed=self._change_pin)
        self._old_row = Row(self._old, "old_pin")
        self._pin_badge = line_edit("pin_badge_edit", lambda _: self.refresh(), hint="settings.pin_placeholder")
        return panel(
            label("settings.engineer_pin", "section"),
            label("setting.about_pin", "muted", wrap=True),
            Row(self._pin_badge, "pin_badge"),
            self._old_row,
            Row(self._new, "new_pin"),
            Row(self._again, "pin_again"),
            Row(self._pin_button),
            self.pin_message,
        )

    def lock(self, reason: str) -> None:
        """Disable the inputs that require the engineer role and show `reason` in tooltips; "" enables them."""
        for widget in (self._folder_button, self._pin_badge, *self._pins, self._pin_button):
            enable(widget, reason)
        self.refresh()

    def refresh(self) -> None:
        """Show the current settings."""
        with QSignalBlocker(self._language), QSignalBlocker(self._theme):
            self._language.show_value(language.current())
            self._theme.show_value(theme.current())
        self._runs.setText(str(self._app.runs_folder.absolute()))
        self._runs.setToolTip(plain_tip(self._runs.text()))
        known = access.has_pin(self._badge)
        self._old_row.setVisible(access.has_pin())
        self._old.setPlaceholderText("" if known else say("settings.site_pin"))
        self._pin_button.setText(say("settings.change_pin" if known else "settings.set_pin"))

    @property
    def _badge(self) -> str:
        """The badge whose PIN is edited, or "" for the PIN of the site."""
        return self._pin_badge.text().strip()

    def _choose_runs(self) -> None:
        def use(folder: Path) -> None:
            self._app.set_runs_folder(folder)
            self.refresh()

        ask_folder(self, say("setting.runs_folder"), self._app.runs_folder.absolute(), use)

    def _change_pin(self) -> None:
        if self._new.text() != self._again.text():
            self._show_pin_error(say("settings.pins_differ"), self._again)
            return
        if len(self._new.text()) < access.MIN_PIN_LENGTH:
            self._show_pin_error(say("settings.pin_too_short", least=access.MIN_PIN_LENGTH), self._new)
            return
        try:
            access.set_pin(self._old.text(), self._new.text(), self._badge, self._app.author)
        except ConfigurationError as error:
            self._show_pin_error(say(error.as_text), self._old)
            self._old.selectAll()
            return
        unlisted = unlisted_engineer(self._badge) if self._badge else None
        for edit in self._pins:
            edit.clear()
        self.refresh()
        self.pin_message.setText(" ".join([say("settings.pin_changed"), *([say(unlisted)] if unlisted else [])]))
        theme.set_kind(self.pin_message, "caution" if unlisted else "muted")

    def _show_pin_error(self, text: str, edit: QLineEdit) -> None:
        self.pin_message.setText(text)
        theme.set_kind(self.pin_message, "error")
        edit.setFocus()
