"""Forms and text of product, IMU, table and station files, with their problems and earlier versions."""

import difflib
import tomllib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path

from PySide6.QtCore import QSignalBlocker, Signal
from PySide6.QtGui import QFontDatabase, QShowEvent, QTextCharFormat, QTextCursor, QTextFormat
from PySide6.QtWidgets import QComboBox, QListWidget, QPlainTextEdit, QTabWidget, QTextEdit, QWidget

from calstation.config import FORMS, Version, editing, library, versions
from calstation.errors import ConfigurationError
from calstation.gui.settings.drafts import Draft, Drafts
from calstation.gui.settings.form_view import FormView
from calstation.gui.settings.standards_form import StandardsForm
from calstation.gui.state import AppContext
from calstation.gui.text import bind, on_language_change, say
from calstation.gui.widgets import (
    ChoiceBox,
    NameBar,
    box,
    button,
    column,
    enable,
    label,
    plain_tip,
    row,
    show_text,
    theme,
)
from calstation.messages import local_time
from calstation.parsing import parse_toml
from calstation.schema import Problem, value_at

#: Maximum number of problems that are visible without scrolling.
_MAX_PROBLEMS = 3


class TextView(QPlainTextEdit):
    """A view or an editor of a text without line wrapping."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.setObjectName(name)
        font = QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont)
        font.setFamilies([*font.families(), theme.FAMILY])
        font.setPixelSize(theme.BODY)
        self.setFont(font)
        self.setLineWrapMode(QPlainTextEdit.LineWrapMode.NoWrap)
        self.setTabChangesFocus(True)

    def shade(self, lines: Iterable[tuple[int, str]]) -> None:
        """Shade only these lines, numbered from 1, each in its colour."""
        selections = []
        for number, colour in lines:
            form = QTextCharFormat()
            form.setBackground(theme.faint(colour, 45))
            form.setProperty(QTextFormat.Property.FullWidthSelection, True)
            selection = QTextEdit.ExtraSelection()
            selection.format = form
            selection.cursor = self._start_of(number)
            selections.append(selection)
        self.setExtraSelections(selections)

    def go_to(self, line: int) -> None:
        """Move the cursor to a line, numbered from 1."""
        self.setTextCursor(self._start_of(line))
        self.centerCursor()
        self.setFocus()

    def _start_of(self, line: int) -> QTextCursor:
        return QTextCursor(self.document().findBlockByNumber(line - 1))


class NewFileBar(NameBar):
    """A bar that is shown by `ask`, creates a file as a copy of another, and emits `created(kind, path)`."""

    created = Signal(str, object)

    def __init__(self, drafts: Drafts) -> None:
        self._drafts = drafts
        self._kind = "stations"
        self._title = label()
        self._title.setFont(theme.font(bold=True))
        self._source = ChoiceBox(lambda: [(name, name) for name in library.names(self._kind)], "new_source_combo")
        self._source.setMinimumWidth(26 * theme.GRID)
        names = ("new_name_edit", "make_file_button", "")
        super().__init__(names, self._title, "settings.create", label("settings.copied_from"), self._source)

    def ask(self, kind: str, source: str) -> None:
        """Ask for the name of a new file of a kind; `source` is the proposed file to copy."""
        self._kind = kind
        self._source.fill()
        self._source.show_value(source)
        self.ask_name()

    def check(self) -> None:
        """Show the kind of the file, and why its name cannot be used."""
        self._title.setText(say(f"setting.new_{self._kind}"))
        super().check()

    def problem(self, name: str) -> str:
        """Return why a name cannot be used, or "" if it can."""
        if name in library.names(self._kind):
            return say("settings.name_taken")
        return "" if editing.is_name(name) else say("settings.name_rule")

    def accept(self, name: str) -> None:
        """Create the file."""
        try:
            path = self._drafts.create(self._kind, name, library.find(self._kind, self._source.value()))
        except ConfigurationError as error:
            show_text(self.message, say(error.as_text))
            return
        self.hide()
        self.created.emit(self._kind, path)


class ProfilesSection(QWidget):
    """The section in which one file at a time is edited and its versions are listed."""

    def __init__(self, app: AppContext, drafts: Drafts) -> None:
        super().__init__()
        self._app, self._drafts = app, drafts
        self._draft: Draft | None = None
        self._versions: tuple[Version, ...] = ()
        self._compared: Version | None = None
        self._locked = ""
        self._make_choice()
        self.editor, self.diff = TextView("toml_edit"), TextView("diff_view")
        self.editor.textChanged.connect(self._typed)
        self.diff.setReadOnly(True)
        self._problems = QListWidget()
        self._listed: list[Problem] = []  #: The problems of the draft or, if it has none, its warnings.
        self._problems.setObjectName("problems_list")
        self._problems.setWordWrap(True)
        for signal in (self._problems.itemClicked, self._problems.itemActivated):
            signal.connect(lambda _: self._go_to_problem())
        self.forms = [StandardsForm(form) if form.name == "check_standards" else FormView(form) for form in FORMS]
        self.views = QTabWidget()
        self.views.setObjectName("profile_views")
        self.views.setDocumentMode(True)
        self.views.tabBar().setProperty("kind", "views")
        self.views.tabBar().setDrawBase(False)
        titles = (*(form.title for form in self.forms), "settings.text", "common.compare")
        for view, title in zip((*self.forms, self.editor, self.diff), titles, strict=True):
            bind(partial(self.views.setTabText, self.views.addTab(view, "")), title)
        self.views.currentChanged.connect(lambda _: self.refresh())
        self._versions_panel = self._make_versions()
        column(
            row(self.kind_box, self.file_box, self._new_button, (self._about, 1)),
            self._new,
            (row((column((self.views, 1), self._problems), 1), self._versions_panel, spacing=3 * theme.GRID), 1),
            on=self,
        )
        drafts.changed.connect(self.refresh)
        drafts.saved.connect(lambda _: self._fill())
        app.product_changed.connect(self._fill)
        theme.themes.changed.connect(self.refresh)
        on_language_change(self, self.refresh)
        self._fill()

    def _make_choice(self) -> None:
        kinds = ("products", "imus", "tables", "chambers", "stations")
        self.kind_box = ChoiceBox(lambda: [(k, say(f"settings.kind_{k}")) for k in kinds], "file_kind_combo")
        self.kind_box.show_value("products")
        self.kind_box.setMinimumWidth(18 * theme.GRID)
        self.kind_box.typed.connect(self._fill)
        bind(self.kind_box.setAccessibleName, "settings.file_kind")
        self.file_box = QComboBox()
        self.file_box.setObjectName("file_combo")
        self.file_box.setMinimumWidth(30 * theme.GRID)
        self.file_box.activated.connect(lambda _: self._open())
        bind(self.file_box.setAccessibleName, "settings.file")
        self._new = NewFileBar(self._drafts)
        self._new.created.connect(self._show_created)
        self._new_button = button(
            "new_file_button",
            "settings.new_from_copy",
            lambda: self._new.ask(self.kind_box.value(), self.file_box.currentText()),
        )
        self._about = label(kind="muted", wrap=True)

    def _make_versions(self) -> QWidget:
        """Create the list of versions, which can be compared with the current text or restored."""
        title = label("settings.versions")
        title.setFont(theme.font(bold=True))
        self._no_versions = label("setting.no_versions", "muted", wrap=True)
        self._outside = label(kind="caution", wrap=True, name="changed_outside_label")
        self._list = QListWidget()
        self._list.setObjectName("versions_list")
        self._list.setWordWrap(True)
        self._list.setSpacing(theme.GRID // 2)
        self._list.currentRowChanged.connect(lambda _: self._enable())
        self._list.itemActivated.connect(lambda _: self._compare())
        self._compare_button = button("compare_button", "common.compare", self._compare)
        self._restore_button = button("take_back_button", "settings.restore", self._restore)
        buttons = row(self._compare_button, self._restore_button)
        panel = box(title, self._no_versions, self._outside, (self._list, 100), None, buttons)
        panel.setFixedWidth(36 * theme.GRID)
        return panel

    def lock(self, reason: str) -> None:
        """Disable changes and show `reason` in tooltips; "" enables them."""
        self._locked = reason
        self.editor.setReadOnly(bool(reason))
        self.editor.setToolTip(plain_tip(reason))
        enable(self._new_button, reason)
        for form in self.forms:
            form.lock(reason)
        if reason:
            self._new.hide()
        self._enable()

    def open(self, kind: str, name: str) -> None:
        """Show a file."""
        self.kind_box.show_value(kind)
        self._fill()
        self.file_box.setCurrentText(name)
        self._open()

    def refresh(self) -> None:
        """Show the current draft."""
        draft = self._draft
        if draft is None:
            return
        if draft.name != self.file_box.currentText():  # another table file has been opened
            self._open()
            return
        if self.editor.toPlainText() != draft.text:
            with QSignalBlocker(self.editor):
                self.editor.setPlainText(draft.text)
        self.editor.shade((problem.line, theme.colours().bad) for problem in draft.problems)
        view = self.views.currentWidget()
        if isinstance(view, FormView):
            view.show_draft(draft)
        self._problems.clear()
        self._listed = draft.problems or draft.warnings
        self._problems.addItems([self._problem_line(problem) for problem in self._listed])
        self._problems.setVisible(bool(self._listed))
        heights = [self._problems.sizeHintForRow(row) for row in range(min(len(self._listed), _MAX_PROBLEMS))]
        self._problems.setFixedHeight(sum(heights) + 2 * self._problems.frameWidth())
        shipped = any(entry.path == draft.path and entry.shipped for entry in editing.list_files(draft.kind))
        self._about.setText(say("setting.file_shipped" if shipped else "setting.file_own"))
        self._about.setToolTip(plain_tip(str(draft.path)))
        self._versions_panel.setVisible(not isinstance(view, FormView))
        self._show_versions(draft)
        self._show_difference()

    def _problem_line(self, problem: Problem) -> str:
        """Return a sentence on a problem with its location in the current form or, if it is not there, in the text."""
        view = self.views.currentWidget()
        text = view.describe(problem) if isinstance(view, FormView) else ""
        return text or say("settings.line", number=problem.line, problem=say(problem.as_text))

    def showEvent(self, event: QShowEvent) -> None:
        """List the files and versions again, because they may have been changed outside the section."""
        super().showEvent(event)
        self._fill()

    def _fill(self) -> None:
        """List the files of the selected kind, and keep the current file if it is among them."""
        kind = self.kind_box.value()
        current = self.file_box.currentText()
        self.file_box.clear()
        names = library.names(kind)
        self.file_box.addItems(names)
        product = self._app.product_path
        if current not in names and kind == "products" and product is not None:
            current = product.stem
        self.file_box.setCurrentText(current if current in names else (names or [""])[0])
        self._open()

    def _open(self) -> None:
        name = self.file_box.currentText()
        if not name:
            return
        kind = self.kind_box.value()
        draft = self._drafts.open_draft(kind, library.find(kind, name))
        if draft is not self._draft:
            self._draft, self._compared = draft, None
            self._show_tabs(kind)
        self._versions = versions.list_versions(kind, name)
        self.refresh()

    def _show_tabs(self, kind: str) -> None:
        """Show the tabs for a kind of file; if the current form does not belong to it, show the first that does."""
        with QSignalBlocker(self.views):
            forms = [form for form in self.forms if form.form.kind == kind]
            current = self.views.currentWidget()
            for form in self.forms:
                self.views.setTabVisible(self.views.indexOf(form), form in forms)
            if isinstance(current, FormView) and current not in forms:
                self.views.setCurrentWidget(forms[0] if forms else self.editor)

    def _typed(self) -> None:
        if self._draft is not None and self.editor.toPlainText() != self._draft.text:
            self._draft.rewrite(self.editor.toPlainText())

    def _go_to_problem(self) -> None:
        number = self._problems.currentRow()
        if not 0 <= number < len(self._listed):
            return
        view, problem = self.views.currentWidget(), self._listed[number]
        if not (isinstance(view, FormView) and view.go_to(problem)):
            self.views.setCurrentWidget(self.editor)
            self.editor.go_to(problem.line)

    def _compare(self) -> None:
        self._compared = self._selected_version
        self._show_difference()
        self.views.setCurrentWidget(self.diff)

    def _restore(self) -> None:
        """Copy the selected version into the editor, and show its differences from the stored text."""
        if self._draft is None or self._selected_version is None:
            return
        self.views.setCurrentWidget(self.diff)
        if (text := self._text_of(self._draft, self._selected_version)) is not None:
            self._compared = None
            self._draft.rewrite(text)

    @property
    def _selected_version(self) -> Version | None:
        number = self._list.currentRow()
        return self._versions[number] if 0 <= number < len(self._versions) else None

    def _show_versions(self, draft: Draft) -> None:
        current, digest = self._list.currentRow(), versions.sha256(draft.saved)
        stored = next((v.number for v in self._versions if v.sha256 == digest), None)
        self._list.clear()
        for version in self._versions:
            author = version.author if version.author is not None else say("settings.found_file")
            mark = say("settings.current_version") if version.number == stored else ""
            first = f"{version.number}  ·  {local_time(version.saved_utc)}{mark}"
            lines = (first, f"{author}  ·  {version.sha256[:12]}", version.reason)
            self._list.addItem("\n".join(filter(None, lines)))
        self._list.setCurrentRow(min(current, len(self._versions) - 1))
        self._no_versions.setVisible(not self._versions)
        show_text(self._outside, self._change_outside(draft))
        for widget in (self._list, self._compare_button, self._restore_button):
            widget.setVisible(bool(self._versions))
        self._enable()

    def _enable(self) -> None:
        """Update the actions on the selected version; tooltips explain why an action is disabled."""
        why_not = "" if self._selected_version is not None else say("settings.choose_version")
        enable(self._compare_button, why_not)
        enable(self._restore_button, self._locked or why_not, say("settings.restore_tip"))

    def _show_difference(self) -> None:
        draft = self._draft
        if draft is None:
            return
        text: str | None = draft.saved
        name = say("settings.saved_text")
        if self._compared is not None:
            text, name = self._text_of(draft, self._compared), say("settings.version", number=self._compared.number)
        if text is None:
            return
        old, new = text.splitlines(), draft.text.splitlines()
        lines = list(difflib.unified_diff(old, new, name, say("settings.present_text"), lineterm="", n=4))
        same = [say("settings.same_text", name=name), self._change_outside(draft) if self._compared is None else ""]
        numbers = [*self._differences(draft, text), ""] if lines else []
        self.diff.setPlainText("\n".join(filter(None, same) if not lines else [*numbers, *lines]))
        colours = {"+": theme.colours().good, "-": theme.colours().bad}
        first = len(numbers) + 1
        self.diff.shade((i, colours[line[0]]) for i, line in enumerate(lines, first) if line[:1] in colours)

    def _differences(self, draft: Draft, text: str) -> Iterator[str]:
        """Yield the values that differ from an older text, in the display units of the forms; the text is in SI."""
        with suppress(tomllib.TOMLDecodeError):
            old = partial(value_at, parse_toml(text))
            for form in self.forms:
                if form.form.kind == draft.kind:
                    yield from form.model.differences(old, draft.value)

    def _change_outside(self, draft: Draft) -> str:
        """Return a sentence if the saved text of a file is not that of its latest version, otherwise ""."""
        latest = next(iter(self._versions), None)
        changed = latest is not None and latest.sha256 != versions.sha256(draft.saved)
        return say("settings.changed_outside", number=latest.number) if latest is not None and changed else ""

    def _text_of(self, draft: Draft, version: Version) -> str | None:
        """Return the text of a version; if it cannot be read, show the error and return None."""
        try:
            return versions.text(draft.kind, draft.name, version.number)
        except ConfigurationError as error:
            self.diff.setPlainText(say(error.as_text))
            self.diff.shade(())
            return None

    def _show_created(self, kind: str, path: Path) -> None:
        self.open(kind, path.stem)
        self.views.setCurrentWidget(next((form for form in self.forms if form.form.kind == kind), self.editor))
