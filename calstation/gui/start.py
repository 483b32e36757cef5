"""Start of the window: a picture until it is loaded, and its enlargement on a large screen at a distance."""

import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from PySide6.QtCore import Qt, QTimer
from PySide6.QtWidgets import QApplication, QLabel, QMainWindow

from calstation.jobs import on_stop_signals

#: Environment variable with the factor by which Qt enlarges everything, which it reads when an application is created.
_FACTOR = "QT_SCALE_FACTOR"

#: Width and height of the screen from which the window grows, logical px, and its maximum growth.
_WIDTH, _HEIGHT, _MAX_GROWTH = 1366, 768, 2.5

#: Size of the picture that is shown while the window is loaded, and of its letters, px.
_PICTURE, _LETTERS = (480, 160), 40


def growth(screen: tuple[int, int]) -> float:
    """Return the factor by which the window grows with the available width and height of its screen, logical px."""
    width, height = screen
    factor = min(width / _WIDTH, height / _HEIGHT, _MAX_GROWTH)
    return max(int(100 * factor) / 100, 1.0)


@contextmanager
def enlarged(screen: tuple[int, int]) -> Iterator[None]:
    """Enlarge an application that is created in this context; other programs do not inherit the factor."""
    given = os.environ.get(_FACTOR)
    with suppress(ValueError):  # Qt ignores a text that is not a number, too
        os.environ[_FACTOR] = str(growth(screen) * float(given or 1.0))
    try:
        yield
    finally:
        os.environ.pop(_FACTOR, None)
        if given is not None:
            os.environ[_FACTOR] = given


def create_window(station: Path | None = None) -> QMainWindow:
    """Create the window for a program that drives it, and the QApplication if there is none.

    It is that of the last station by default. Its contents are imported now, which takes 2 s.
    """
    from calstation.gui.shell import create_window as create

    return create(station)


def main(screen: tuple[int, int]) -> int:
    """Open the window, and return the exit code after it has been closed.

    The window grows with the available width and height of the screen, logical px. Ctrl-C in the terminal or
    another signal stops a run safely, then closes the window.
    """
    with enlarged(screen):
        app = QApplication(sys.argv[:1])
    picture = opening_picture()
    picture.show()
    app.processEvents()
    from calstation.gui.shell import create_window  # takes 2 s, during which the picture is shown

    window = create_window()
    signal_timer = QTimer(window, interval=200)  # lets Python run its signal handlers
    signal_timer.timeout.connect(lambda: None)
    signal_timer.start()
    window.prepared.connect(freeze_objects)
    window.show()
    picture.close()
    with on_stop_signals(window.stop_and_close):
        return QApplication.exec()


def freeze_objects() -> None:
    """Exclude the objects of a complete window from garbage collection, which would block the window for 0.3 s."""
    gc.collect()
    gc.freeze()


def opening_picture() -> QLabel:
    """Return the picture that is shown in the middle of the screen until the window is loaded."""
    picture = QLabel("calstation", None, Qt.WindowType.SplashScreen, alignment=Qt.AlignmentFlag.AlignCenter)
    picture.setFixedSize(*_PICTURE)
    font = picture.font()
    font.setPixelSize(_LETTERS)
    picture.setFont(font)
    box = picture.rect()
    box.moveCenter(picture.screen().availableGeometry().center())
    picture.move(box.topLeft())
    return picture
