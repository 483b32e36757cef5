"""A dialog that asks for the file to write."""

from collections.abc import Callable, Sequence
from pathlib import Path

from PySide6.QtWidgets import QFileDialog, QWidget


def ask_file(
    parent: QWidget, title: str, proposed: Path, kinds: Sequence[str], write: Callable[[Path], object]
) -> None:
    """Ask for a file, then call `write`; `kinds` are name filters such as ``CSV (*.csv)``, the usual one first."""
    dialog = QFileDialog(parent, title, str(proposed.parent))
    dialog.setAcceptMode(QFileDialog.AcceptMode.AcceptSave)
    dialog.setFileMode(QFileDialog.FileMode.AnyFile)
    dialog.setNameFilters(list(kinds))
    dialog.selectFile(proposed.name)
    dialog.filterSelected.connect(lambda kind: dialog.setDefaultSuffix(_suffix(kind)))
    dialog.setDefaultSuffix(_suffix(kinds[0]))
    dialog.fileSelected.connect(lambda name: write(Path(name)))
    dialog.finished.connect(dialog.deleteLater)
    dialog.open()


def _suffix(kind: str) -> str:
    """Return the suffix in the brackets of a name filter, without its first dot."""
    return kind.rpartition("*.")[2].rstrip(")")
