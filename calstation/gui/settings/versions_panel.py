"""The versions of one file: number, time and author; to compare with the present text or to restore."""

from datetime import datetime

from PySide6.QtCore import Signal, SignalInstance
from PySide6.QtWidgets import QListWidget, QWidget

from calstation.config import Version, versions
from calstation.gui.settings.drafts import Draft
from calstation.gui.text import on_language_change, say
from calstation.gui.widgets import button, column, enable, label, row, theme


class VersionsPanel(QWidget):
    """Emits `compared(version)` and `restored(version)` for the version chosen."""

    compared = Signal(object)
    restored = Signal(object)

    def __init__(self) -> None:
        super().__init__()
        self._versions: tuple[Version, ...] = ()
        self._draft: Draft | None = None
        self._reason = ""
        title = label(lambda: self.tr("Versions"))
        title.setFont(theme.font(bold=True))
        self._empty = label(lambda: say("setting.no_versions"), "muted", wrap=True)
        self._list = QListWidget()
        self._list.setObjectName("versions_list")
        self._list.setWordWrap(True)
        self._list.setSpacing(theme.GRID // 2)
        self._list.currentRowChanged.connect(lambda _: self._enable())
        self._list.itemActivated.connect(lambda _: self._emit(self.compared))
        self._compare = button("compare_button", lambda: self.tr("Compare"), lambda: self._emit(self.compared))
        self._restore = button("take_back_button", lambda: self.tr("Restore"), lambda: self._emit(self.restored))
        column(title, self._empty, (self._list, 100), None, row(self._compare, self._restore), on=self)
        on_language_change(self, self._show)

    def show_versions(self, draft: Draft) -> None:
        """Show the versions of a draft's file."""
        self._draft = draft
        self._versions = versions.list_versions(draft.kind, draft.name)
        self._show()

    def lock(self, reason: str) -> None:
        """Disable restoring with the reason as tooltip; "" enables it."""
        self._reason = reason
        self._enable()

    @property
    def _chosen(self) -> Version | None:
        number = self._list.currentRow()
        return self._versions[number] if 0 <= number < len(self._versions) else None

    def _show(self) -> None:
        chosen = self._list.currentRow()
        self._list.clear()
        digest = versions.sha256(self._draft.saved) if self._draft is not None else ""
        stored = next((v.number for v in self._versions if v.sha256 == digest), None)
        self._list.addItems([self._line(version, version.number == stored) for version in self._versions])
        self._list.setCurrentRow(min(chosen, len(self._versions) - 1))
        self._empty.setVisible(not self._versions)
        for widget in (self._list, self._compare, self._restore):
            widget.setVisible(bool(self._versions))
        self._enable()

    def _line(self, version: Version, present: bool) -> str:
        saved = datetime.fromisoformat(version.saved_utc).astimezone()
        author = version.author if version.author is not None else self.tr("found, not saved here")
        mark = self.tr("  ·  current") if present else ""
        return f"{version.number}  ·  {saved:%Y-%m-%d %H:%M}{mark}\n{author}  ·  {version.sha256[:12]}"

    def _enable(self) -> None:
        none = "" if self._chosen is not None else self.tr("Choose a version in the list.")
        tip = self.tr("Puts its text into the editor; saving makes it a new version.")
        enable(self._compare, none)
        enable(self._restore, self._reason or none, tip)

    def _emit(self, signal: SignalInstance) -> None:
        if self._chosen is not None:
            signal.emit(self._chosen)
