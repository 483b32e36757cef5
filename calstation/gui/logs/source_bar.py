"""The bar that selects a log by a path, a dialog or a list of recent logs, and the exports of a log and its result."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QSettings, QTimer, Signal
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QMenu, QWidget

from calstation.gui.state import FileExport
from calstation.gui.text import on_language_change, say
from calstation.gui.widgets import ask_open, button, enable, label, line_edit, row
from calstation.records import CSV_SUFFIXES, FOREIGN_FORMATS, LOG_SUFFIXES, meta_path
from calstation.results import Result, export_log, export_result
from calstation.results.plots import LogIndex

_KEY = "offline/recent"
#: Maximum number of recent logs in the menu, and maximum number of logs of the latest runs.
MAX_RECENT = 8


def ask_log(parent: QWidget, title: str, folder: Path, then: Callable[[Path], object]) -> None:
    """Ask for a log, and call `then` with its path."""
    ask_open(parent, title, folder, [say("logs.logs_filter"), say("common.all_files")], then)


class SourceBar(QWidget):
    """A bar that emits `path_selected(path)`, or `recording_selected(path)` for a recording to import.

    `latest` returns the logs of the latest runs for the menu.
    """

    path_selected = Signal(object)
    recording_selected = Signal(object)

    def __init__(self, settings: QSettings, latest: Callable[[], list[Path]]) -> None:
        super().__init__()
        self._settings, self._latest = settings, latest
        self._open_path = ""
        self.log_edit = line_edit("log_edit", hint="logs.path_tip")
        self.log_edit.setAcceptDrops(False)  # the page handles dropped files
        self.log_edit.returnPressed.connect(self._open_typed)
        #: Timer after which a path that has not changed, such as a pasted path, is opened if the file exists.
        self._paste_timer = QTimer(self, singleShot=True, interval=400)
        self._paste_timer.timeout.connect(self._open_pasted)
        self.log_edit.textChanged.connect(self._paste_timer.start)
        caption = label("logs.log", buddy=self.log_edit)
        self.open_button = button("log_open_button", "logs.open", self.browse)
        self.import_button = button("log_import_button", "logs.import", self.browse_recordings, tip="logs.import_tip")
        self.recent_button = button("log_recent_button", "logs.recent")
        self._menu = QMenu(self)
        self.recent_button.setMenu(self._menu)
        self._menu.aboutToShow.connect(self._fill)
        row(caption, (self.log_edit, 1), self.open_button, self.import_button, self.recent_button, on=self)
        on_language_change(self, self._fill)

    def show_path(self, path: Path | None) -> None:
        """Show the path of the open log, if any."""
        self._open_path = "" if path is None else str(path)
        self.log_edit.setText(self._open_path)

    def remember(self, path: Path) -> None:
        """Add a log at the top of the recent logs."""
        recent = [path, *(p for p in self.recent() if p != path)][:MAX_RECENT]
        self._settings.setValue(_KEY, [str(p) for p in recent])
        self._fill()

    def recent(self) -> list[Path]:
        """Return the recently opened logs, the latest first."""
        stored = self._settings.value(_KEY) or []
        return [Path(p) for p in ([stored] if isinstance(stored, str) else stored)]

    def browse(self) -> None:
        """Open the file dialog in the folder of the current path or, without one, of the most recent log."""
        ask_log(self, say("logs.open_log"), self._folder, self.path_selected.emit)

    def browse_recordings(self) -> None:
        """Open the file dialog for a recording of another program in the same folder."""
        suffixes = dict.fromkeys(s for each in FOREIGN_FORMATS for s in each.suffixes)
        kinds = [f"{say('logs.recordings')} ({' '.join(f'*{s}' for s in (*CSV_SUFFIXES, *suffixes))})"]
        kinds.append(say("common.all_files"))
        ask_open(self, say("logs.import_recording"), self._folder, kinds, self.recording_selected.emit)

    @property
    def _folder(self) -> Path:
        typed = self.log_edit.text()
        return (Path(typed) if typed else next(iter(self.recent()), Path("runs/log"))).parent

    def showEvent(self, event: QShowEvent) -> None:
        """Update the menu, because there may be new runs."""
        super().showEvent(event)
        self._fill()

    def _open_typed(self) -> None:
        text = self.log_edit.text().strip().strip('"')
        if text:
            self.path_selected.emit(Path(text).expanduser())

    def _open_pasted(self) -> None:
        text = self.log_edit.text()
        if text != self._open_path and text.endswith(LOG_SUFFIXES) and Path(text).is_file():
            self._open_typed()

    def _fill(self) -> None:
        self._menu.clear()
        recent = self.recent()
        self._add_actions(recent)
        latest = [path for path in self._latest() if path not in recent]
        if latest:
            self._menu.addSection(say("logs.latest_runs"))
            self._add_actions(latest)
        enable(self.recent_button, say("logs.no_recent_logs") if self._menu.isEmpty() else "")

    def _add_actions(self, paths: list[Path]) -> None:
        for path in paths:
            action = self._menu.addAction(f"{path.name}    {path.parent}")
            action.triggered.connect(lambda _=False, path=path: self.path_selected.emit(path))


class Exports(FileExport):
    """Exports a log and its result."""

    def ask_log(self, log: LogIndex, first: int, last: int) -> None:
        """Ask for a file, and export the samples `first` to `last` of a log to it."""
        whole = (first, last) == (log.facts.first_seq, log.facts.last_seq)
        ending = "export" if whole else f"{first}-{last}"
        self.ask(
            say("logs.export_log" if whole else "logs.export_range"),
            log.path.with_name(f"{_stem(log.path)}-{ending}.csv"),
            ["CSV (*.csv)", say("logs.csv_compressed")],
            lambda target: (export_log, log.path, target, first, last),
            lambda target: [target, meta_path(target)],  # a CSV file cannot be read without the second one
        )

    def ask_result(self, log: Path, result: Result, stored: Result | None, ending: str = "offline") -> None:
        """Ask for a file, and export a result of a log to it.

        `stored` is the result of the run, and `ending` the end of the proposed file name.
        """
        self.ask(
            say("logs.export_result_title"),
            log.with_name(f"{_stem(log)}-{ending}.json"),
            ["JSON (*.json)", say("logs.csv_parameters")],
            lambda target: (export_result, result, stored, target),
        )


def _stem(path: Path) -> str:
    return next((path.name.removesuffix(end) for end in LOG_SUFFIXES if path.name.endswith(end)), path.name)
