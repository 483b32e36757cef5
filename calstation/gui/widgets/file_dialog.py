"""File dialogs that leave the rest of the window usable, so that STOP works while one is open.

The platform's dialogs and the questions of `QFileDialog` block the window; `FileDialog` asks these questions itself.
"""

import re
from collections.abc import Callable, Sequence
from pathlib import Path

from PySide6.QtGui import QAction
from PySide6.QtWidgets import QFileDialog, QGridLayout, QHeaderView, QTreeView, QWidget

from calstation.gui.text import say
from calstation.gui.widgets.notice import Choice, NoticeBar
from calstation.messages import Text

#: Columns of the list of files with their types and dates.
_TYPE_COLUMN, _DATE_COLUMN = 2, 3


class FileDialog(QFileDialog):
    """A dialog that calls `then` with the selected path, and closes another file dialog of the window."""

    def __init__(self, parent: QWidget, title: str, folder: Path, then: Callable[[Path], object]) -> None:
        for other in parent.window().findChildren(FileDialog):
            other.reject()
        super().__init__(parent, title, str(folder if folder.is_dir() else Path()))
        self.setOption(QFileDialog.Option.DontUseNativeDialog)
        self.setOption(QFileDialog.Option.DontConfirmOverwrite)
        delete_action = self.findChild(QAction, "qt_delete_action")
        if isinstance(delete_action, QAction):
            delete_action.setVisible(False)  # its question would block the window
        # texts that Qt does not translate, or not into Chinese
        self.setLabelText(QFileDialog.DialogLabel.LookIn, say("common.look_in"))
        self.setLabelText(QFileDialog.DialogLabel.FileType, say("common.file_type"))
        files = self.findChild(QTreeView, "treeView")
        if isinstance(files, QTreeView):
            files.setColumnHidden(_TYPE_COLUMN, True)
            files.header().setSectionResizeMode(_DATE_COLUMN, QHeaderView.ResizeMode.ResizeToContents)
        self._notice = NoticeBar("file_dialog_notice")
        layout = self.layout()
        if isinstance(layout, QGridLayout):
            layout.addWidget(self._notice, layout.rowCount(), 0, 1, -1)
        self.fileSelected.connect(lambda name: then(Path(name)))
        self.finished.connect(self.deleteLater)

    def accept(self) -> None:
        """Close the dialog if the selected path may be used; otherwise show why not, or ask whether to replace it."""
        target = Path(next(iter(self.selectedFiles()), ""))
        saving = self.acceptMode() is QFileDialog.AcceptMode.AcceptSave
        if saving and target.is_file():
            replace = Choice("replace_file_button", "common.replace", self._accept)
            keep = Choice("keep_file_button", "answer.cancel", self.setFocus, primary=True)
            self._notice.ask("caution", Text.of("common.file_exists", name=target.name), "", (keep, replace))
        elif not saving and not target.exists():
            self._notice.ask("caution", Text.of("common.file_missing", name=target.name), "")
        else:
            self._accept()

    def _accept(self) -> None:
        super().accept()


def set_subject(widget: QWidget, subject: str) -> None:
    """Set what a widget shows, such as a serial number, for the names of the files that are saved from it."""
    widget.setProperty("subject", subject)


def proposed_file(widget: QWidget, name: str) -> Path:
    """Return the name of a file saved from a widget: `name` after the subject of the widget or its nearest parent."""
    at: QWidget | None = widget
    while at is not None and not at.property("subject"):
        at = at.parentWidget()
    subject = "" if at is None else re.sub(r"[^\w.-]+", "_", str(at.property("subject")))
    return Path(f"{subject}_{name}" if subject else name)


def ask_file(
    parent: QWidget, title: str, proposed: Path, kinds: Sequence[str], write: Callable[[Path], object]
) -> None:
    """Ask for a file and call `write` with it; `kinds` are name filters such as ``CSV (*.csv)``, the default first."""
    dialog = FileDialog(parent, title, proposed.parent, write)
    dialog.setAcceptMode(QFileDialog.AcceptMode.AcceptSave)
    dialog.setFileMode(QFileDialog.FileMode.AnyFile)
    dialog.setNameFilters(list(kinds))
    dialog.selectFile(proposed.name)
    dialog.filterSelected.connect(lambda kind: dialog.setDefaultSuffix(_suffix(kind)))
    dialog.setDefaultSuffix(_suffix(kinds[0]))
    dialog.show()


def ask_open(parent: QWidget, title: str, folder: Path, kinds: Sequence[str], then: Callable[[Path], object]) -> None:
    """Ask for an existing file and call `then` with it; `kinds` are name filters."""
    dialog = FileDialog(parent, title, folder, then)
    dialog.setFileMode(QFileDialog.FileMode.ExistingFile)
    dialog.setNameFilters(list(kinds))
    dialog.show()


def ask_folder(parent: QWidget, title: str, folder: Path, then: Callable[[Path], object]) -> None:
    """Ask for an existing folder and call `then` with it."""
    dialog = FileDialog(parent, title, folder, then)
    dialog.setFileMode(QFileDialog.FileMode.Directory)
    dialog.setOption(QFileDialog.Option.ShowDirsOnly)
    dialog.show()


def _suffix(kind: str) -> str:
    """Return the suffix in the brackets of a name filter without its first dot."""
    return kind.rpartition("*.")[2].rstrip(")")
