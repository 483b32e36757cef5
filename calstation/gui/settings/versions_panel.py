"""The versions of one file: when, by whom, and which; compared with the text in hand, and taken back into it."""

from datetime import datetime

from PySide6.QtCore import QEvent, Signal
from PySide6.QtWidgets import (
    QHBoxLayout,
    QLabel,
    QListWidget,
    QListWidgetItem,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from calstation.config import version_store
from calstation.config.version_store import Version
from calstation.gui.settings.draft import Draft
from calstation.gui.widgets import theme


class VersionsPanel(QWidget):
    """`compared(version)` and `taken(version)` tell what the user wants of the chosen version."""

    compared = Signal(object)
    taken = Signal(object)

    def __init__(self) -> None:
        super().__init__()
        self._versions: tuple[Version, ...] = ()
        self._draft: Draft | None = None
        self._reason = ""
        self._title, self._empty = QLabel(), QLabel()
        self._title.setFont(theme.font(bold=True))
        self._empty.setProperty("kind", "muted")
        self._empty.setWordWrap(True)
        self.list = QListWidget()
        self.list.setObjectName("versions_list")
        self.list.setWordWrap(True)
        self.list.setSpacing(theme.GRID // 2)
        self.list.currentRowChanged.connect(lambda _: self._enable())
        self.list.itemActivated.connect(lambda _: self._compare())
        self.compare_button, self.take_button = QPushButton(), QPushButton()
        self.compare_button.setObjectName("compare_button")
        self.compare_button.clicked.connect(self._compare)
        self.take_button.setObjectName("take_back_button")
        self.take_button.clicked.connect(self._take)
        buttons = QHBoxLayout()
        buttons.addWidget(self.compare_button)
        buttons.addWidget(self.take_button)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(theme.GRID)
        column.addWidget(self._title)
        column.addWidget(self._empty)
        column.addWidget(self.list, 100)
        column.addStretch(1)
        column.addLayout(buttons)
        self.retranslate()

    @property
    def chosen(self) -> Version | None:
        """The version chosen in the list."""
        row = self.list.currentRow()
        return self._versions[row] if 0 <= row < len(self._versions) else None

    def show_versions(self, draft: Draft) -> None:
        """Show the versions of a draft's file."""
        self._draft = draft
        self._versions = version_store.kept(draft.kind, draft.name)
        row = self.list.currentRow()
        self.list.clear()
        digest = version_store.sha256(draft.saved)
        stored = next((v.number for v in self._versions if v.sha256 == digest), None)
        for version in self._versions:
            self.list.addItem(QListWidgetItem(self._line(version, version.number == stored)))
        self.list.setCurrentRow(min(row, len(self._versions) - 1))
        self.list.setVisible(bool(self._versions))
        self._empty.setVisible(not self._versions)
        for button in (self.compare_button, self.take_button):
            button.setVisible(bool(self._versions))
        self._enable()

    def lock(self, reason: str) -> None:
        """Forbid taking a version back, with the reason as tooltip; "" allows it."""
        self._reason = reason
        self._enable()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self._title.setText(self.tr("Versions"))
        self._empty.setText(
            self.tr("None yet. Every change saved here is kept with its time, author and hash.")
        )
        self.compare_button.setText(self.tr("Compare"))
        self.take_button.setText(self.tr("Take back"))
        if self._draft is not None:
            self.show_versions(self._draft)

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def _line(self, version: Version, present: bool) -> str:
        saved = datetime.fromisoformat(version.saved_utc).astimezone()
        author = version.author if version.author is not None else self.tr("found, not saved here")
        mark = self.tr("  ·  in force") if present else ""
        return f"{version.number}  ·  {saved:%Y-%m-%d %H:%M}{mark}\n{author}  ·  {version.sha256[:12]}"

    def _enable(self) -> None:
        chosen = self.chosen
        none = "" if chosen is not None else self.tr("Choose a version in the list.")
        self.compare_button.setEnabled(not none)
        self.compare_button.setToolTip(none)
        reason = self._reason or none
        self.take_button.setEnabled(not reason)
        self.take_button.setToolTip(
            reason or self.tr("Puts its text into the editor; saving makes it a new version.")
        )

    def _compare(self) -> None:
        if self.chosen is not None:
            self.compared.emit(self.chosen)

    def _take(self) -> None:
        if self.chosen is not None:
            self.taken.emit(self.chosen)
