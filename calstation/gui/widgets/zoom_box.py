"""A view box that a user can zoom: by wheel, by a box with the left button, and back with a double click."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pyqtgraph as pg
from PySide6.QtCore import Qt


class ZoomBox(pg.ViewBox):  # type: ignore[misc]
    """While it is zoomed, ranges set by the program are kept for the double click that ends it."""

    def __init__(self) -> None:
        super().__init__(enableMenu=False)
        self.setMouseMode(pg.ViewBox.RectMode)
        self.zoomed = False
        self._from_user = False
        self._auto: list[Any] = [True, True]
        self._ranges: list[Any] = [None, None]

    @contextmanager
    def _user(self) -> Iterator[None]:
        """Let ranges through that come from the user."""
        if not self.zoomed:
            self._auto, self._ranges = list(self.state["autoRange"]), self.viewRange()
        self._from_user = True
        try:
            yield
        finally:
            self._from_user = False

    def setRange(self, *args: Any, **options: Any) -> None:
        """Set the range; while the box is zoomed, only keep it."""
        if self._from_user or not self.zoomed:
            super().setRange(*args, **options)
            return
        for axis, name in enumerate(("xRange", "yRange")):
            if options.get(name) is not None:
                self._auto[axis], self._ranges[axis] = False, list(options[name])

    def enableAutoRange(self, axis: Any = None, enable: Any = True, x: Any = None, y: Any = None) -> None:
        """Enable automatic ranges; not while the box is zoomed."""
        if not self.zoomed:
            super().enableAutoRange(axis, enable, x, y)

    def linkedViewChanged(self, view: pg.ViewBox, axis: int) -> None:
        """Follow a linked box, whether or not this one is zoomed."""
        from_user, self._from_user = self._from_user, True
        super().linkedViewChanged(view, axis)
        self._from_user = from_user

    def wheelEvent(self, ev: Any, axis: int | None = None) -> None:
        """Zoom about the pointer."""
        with self._user():
            super().wheelEvent(ev, axis)
            self.zoomed = True

    def mouseDragEvent(self, ev: Any, axis: int | None = None) -> None:
        """Zoom to a box."""
        with self._user():
            super().mouseDragEvent(ev, axis)
            self.zoomed = self.zoomed or (ev.isFinish() and ev.button() == Qt.MouseButton.LeftButton)

    def mouseDoubleClickEvent(self, ev: Any) -> None:
        """Show everything again."""
        self.reset()
        if (leader := self.linkedView(pg.ViewBox.XAxis)) is not None:
            leader.reset()
        ev.accept()

    def reset(self) -> None:
        """End the zoom: the ranges are those that the program has set."""
        if not self.zoomed:
            return
        self.zoomed = False
        for axis, (auto, limits) in enumerate(zip(self._auto, self._ranges, strict=True)):
            if auto:
                self.enableAutoRange(axis, auto)
            elif limits is not None and self.linkedView(axis) is None:
                self.setRange(**{("xRange", "yRange")[axis]: limits}, padding=0.0)
