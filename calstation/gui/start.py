"""Start of the program: a splash screen while the window loads, and larger widgets on a large screen."""

import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from PySide6.QtCore import Qt, QTimer
from PySide6.QtWidgets import QApplication, QLabel, QMainWindow

from calstation.jobs import on_stop_signals

#: Environment variable with the factor by which Qt enlarges everything; Qt reads it when a QApplication is created.
_FACTOR = "QT_SCALE_FACTOR"

#: Width and height of a screen above which the window is enlarged, logical px, and the maximum factor.
_WIDTH, _HEIGHT, _MAX_FACTOR = 1366, 768, 2.5

#: Size of the splash screen and of its letters, px.
_SPLASH_SIZE, _LETTER_SIZE = (480, 160), 40


def enlargement(screen: tuple[int, int]) -> float:
    """Return the factor that enlarges the window for the available width and height of a screen, logical px."""
    width, height = screen
    factor = min(width / _WIDTH, height / _HEIGHT, _MAX_FACTOR)
    return max(int(100 * factor) / 100, 1.0)


@contextmanager
def enlarged(screen: tuple[int, int]) -> Iterator[None]:
    """Enlarge a QApplication that is created in this context; other programs do not inherit the factor."""
    given = os.environ.get(_FACTOR)
    with suppress(ValueError):  # Qt also ignores a text that is not a number
        os.environ[_FACTOR] = str(enlargement(screen) * float(given or 1.0))
    try:
        yield
    finally:
        os.environ.pop(_FACTOR, None)
        if given is not None:
            os.environ[_FACTOR] = given


def create_window(station: Path | None = None) -> QMainWindow:
    """Create the window for a program that controls it, and the QApplication if there is none.

    By default, the window shows the station that was used last. The import of its contents takes 2 s.
    """
    from calstation.gui.shell import create_window as create

    return create(station)


def main(screen: tuple[int, int]) -> int:
    """Open the window, and return the exit code after it has been closed.

    The available width and height of the `screen`, logical px, determine the size of the widgets. Ctrl-C in the
    terminal or another stop signal stops a run safely, then closes the window.
    """
    with enlarged(screen):
        app = QApplication(sys.argv[:1])
    splash = splash_screen()
    splash.show()
    app.processEvents()
    from calstation.gui.shell import create_window  # takes 2 s, during which the splash screen is shown

    window = create_window()
    signal_timer = QTimer(window, interval=200)  # lets Python run its signal handlers
    signal_timer.timeout.connect(lambda: None)
    signal_timer.start()
    window.prepared.connect(freeze_objects)
    window.show()
    splash.close()
    with on_stop_signals(window.stop_and_close):
        return QApplication.exec()


def freeze_objects() -> None:
    """Exclude the objects of a complete window from garbage collection, which would block the window for 0.3 s."""
    gc.collect()
    gc.freeze()


def splash_screen() -> QLabel:
    """Return the splash screen, which is shown in the middle of the screen until the window is loaded."""
    splash = QLabel("calstation", None, Qt.WindowType.SplashScreen, alignment=Qt.AlignmentFlag.AlignCenter)
    splash.setFixedSize(*_SPLASH_SIZE)
    font = splash.font()
    font.setPixelSize(_LETTER_SIZE)
    splash.setFont(font)
    box = splash.rect()
    box.moveCenter(splash.screen().availableGeometry().center())
    splash.move(box.topLeft())
    return splash
