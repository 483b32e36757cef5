"""Which log: its path typed, looked for, or taken from the recent ones."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QSettings, QTimer, Signal
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QFileDialog, QHBoxLayout, QLabel, QLineEdit, QMenu, QPushButton, QWidget

from calstation.gui.text import on_language_change
from calstation.gui.widgets import theme

_KEPT = 8
_KEY = "offline/recent"
#: A path that has not changed for this long and leads to a file is opened, as one that is pasted or filled in is.
_SETTLED_MS = 400
_ENDINGS = (".h5", ".csv", ".csv.gz")


class SourceBar(QWidget):
    """`chosen(path)`: a log to open. `remember` puts one that could be opened among the recent ones.

    latest : gives the logs of the last runs, offered below the recent ones
    name : the widgets' object names begin with it; key : of the settings, where the recent ones are kept
    """

    chosen = Signal(object)

    def __init__(
        self,
        settings: QSettings,
        parent: QWidget | None = None,
        *,
        name: str = "log",
        key: str = _KEY,
        latest: Callable[[], list[Path]] = list,
    ) -> None:
        super().__init__(parent)
        self._settings, self._key, self._latest = settings, key, latest
        self._label = QLabel()
        self.log_edit = QLineEdit()
        self.log_edit.setObjectName(f"{name}_edit")
        self.log_edit.setAcceptDrops(False)  # a file dropped here belongs to the page
        self.log_edit.setClearButtonEnabled(False)
        self.log_edit.returnPressed.connect(self._entered)
        self._shown = ""
        self._settle = QTimer(self, singleShot=True, interval=_SETTLED_MS)
        self._settle.timeout.connect(self._settled)
        self.log_edit.textChanged.connect(self._settle.start)
        self._label.setBuddy(self.log_edit)
        self.open_button = QPushButton()
        self.open_button.setObjectName(f"{name}_open_button")
        self.open_button.clicked.connect(self.look)
        self.recent_button = QPushButton()
        self.recent_button.setObjectName(f"{name}_recent_button")
        self._menu = QMenu(self)
        self.recent_button.setMenu(self._menu)
        self._menu.aboutToShow.connect(self._fill)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(theme.GRID)
        row.addWidget(self._label)
        row.addWidget(self.log_edit, 1)
        row.addWidget(self.open_button)
        row.addWidget(self.recent_button)
        self._fill()
        on_language_change(self, self.retranslate)

    def show_path(self, path: Path) -> None:
        """Show the log at hand."""
        self._shown = str(path)
        self.log_edit.setText(self._shown)

    def remember(self, path: Path) -> None:
        """Put a log first among the recent ones."""
        kept = [path, *(p for p in self.recent() if p != path)][:_KEPT]
        self._settings.setValue(self._key, [str(p) for p in kept])
        self._fill()

    def recent(self) -> list[Path]:
        """Logs opened before, the latest first."""
        stored = self._settings.value(self._key) or []
        return [Path(p) for p in ([stored] if isinstance(stored, str) else stored)]

    def look(self) -> None:
        """Choose a file; the window goes on meanwhile."""
        dialog = QFileDialog(self, self.tr("Open a log"))
        dialog.setFileMode(QFileDialog.FileMode.ExistingFile)
        dialog.setNameFilters([self.tr("Logs (*.h5 *.csv *.csv.gz)"), self.tr("All files (*)")])
        recent = self.recent()
        folder = Path(self.log_edit.text()).parent if self.log_edit.text() else Path("runs")
        if not self.log_edit.text() and recent:
            folder = recent[0].parent
        dialog.setDirectory(str(folder if folder.is_dir() else Path()))
        dialog.fileSelected.connect(lambda name: self.chosen.emit(Path(name)))
        dialog.finished.connect(dialog.deleteLater)
        dialog.open()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self._label.setText(self.tr("Log"))
        self.log_edit.setPlaceholderText(self.tr("Path of a raw log (.h5) or of a CSV with its TOML beside it"))
        self.open_button.setText(self.tr("Open…"))
        self.recent_button.setText(self.tr("Recent"))
        self._say_recent()

    def showEvent(self, event: QShowEvent) -> None:
        """Runs may have been made since."""
        super().showEvent(event)
        self._fill()

    def _entered(self) -> None:
        text = self.log_edit.text().strip().strip('"')
        if text:
            self.chosen.emit(Path(text).expanduser())

    def _settled(self) -> None:
        text = self.log_edit.text()
        if text != self._shown and text.endswith(_ENDINGS) and Path(text).is_file():
            self._entered()

    def _fill(self) -> None:
        self._menu.clear()
        recent = self.recent()
        latest = [path for path in self._latest() if path not in recent]
        for path in recent:
            self._offer(path)
        if latest:
            self._menu.addSection(self.tr("Latest runs"))
        for path in latest:
            self._offer(path)
        self._say_recent()

    def _offer(self, path: Path) -> None:
        action = self._menu.addAction(f"{path.name}    {path.parent}")
        action.triggered.connect(lambda _=False: self.chosen.emit(path))

    def _say_recent(self) -> None:
        any_there = not self._menu.isEmpty()
        self.recent_button.setEnabled(any_there)
        self.recent_button.setToolTip("" if any_there else self.tr("No log has been opened here yet"))
