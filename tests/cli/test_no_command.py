"""`calstation` alone opens the window, or starts a run in the terminal if there is no screen."""

import subprocess
import sys

import pytest

from calstation.cli import app
from calstation.cli.app import run_app
from calstation.config import RunRequest

LINUX = sys.platform not in ("win32", "darwin")


@pytest.mark.skipif(not LINUX, reason="elsewhere there is always a screen")
def test_without_a_screen_a_run_starts_after_a_message(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"):
        monkeypatch.delenv(name, raising=False)
    ran = []

    def run(request: RunRequest, *arguments: object, **options: object) -> int:
        ran.append(request)
        return 1

    monkeypatch.setattr("calstation.cli.run.run_command", run)
    assert run_app([]) == 1
    assert [request.station for request in ran] == [None]
    output = capsys.readouterr().err.splitlines()
    assert len(output) == 1
    assert "No screen here" in output[0]


@pytest.mark.skipif(not LINUX, reason="elsewhere there is always a screen")
def test_unusable_screen_is_treated_as_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("QT_QPA_PLATFORM", "there-is-no-such-platform")
    assert app.screen_size() is None


def test_with_a_screen_the_window_opens(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("PySide6.QtWidgets", exc_type=ImportError)
    monkeypatch.setattr(app, "screen_size", lambda: (1366, 768))
    monkeypatch.setattr("calstation.gui.main", lambda screen: 0)
    assert run_app([]) == 0


@pytest.mark.long
def test_terminal_commands_do_not_import_qt() -> None:
    script = (
        "import sys; sys.modules['PySide6'] = None\n"
        "from calstation.cli.app import run_app\n"
        "import calstation.cli.run, calstation.cli.commands.study, calstation.runs.engine\n"
        "import calstation.runs.run\n"
        "sys.exit(run_app(['run', '--serial', 'x y']))\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 2, done.stderr
    assert "does not match the pattern" in done.stderr
