"""The window on a screen with a window manager, where focus, dialogs and other windows matter."""

import ast
from pathlib import Path

import pytest

import calstation.gui
from tests.gui.desktop import run_on_desktop

#: Ways to open a dialog that blocks the window, and with it STOP.
_BLOCKING = {
    *("QColorDialog", "QDialog", "QErrorMessage", "QFileDialog", "QFontDialog", "QInputDialog", "QMessageBox"),
    *("QPrintDialog", "QProgressDialog", "QWizard", "setModal", "setWindowModality", "exec"),
}
#: Modules that may use some of them.
_EXCEPTIONS = {"widgets/file_dialog.py": {"QFileDialog"}, "start.py": {"exec"}}


@pytest.mark.long
def test_on_a_desktop() -> None:
    run_on_desktop("desktop_stop.py")


def test_no_dialog_blocks_the_window() -> None:
    folder = Path(calstation.gui.__file__).parent
    found = {}
    for module in sorted(folder.rglob("*.py")):
        nodes = ast.walk(ast.parse(module.read_text(encoding="utf-8")))
        names = {n.id if isinstance(n, ast.Name) else n.attr for n in nodes if isinstance(n, ast.Name | ast.Attribute)}
        if names & _BLOCKING:
            found[module.relative_to(folder).as_posix()] = names & _BLOCKING
    assert found == _EXCEPTIONS
