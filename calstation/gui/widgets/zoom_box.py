"""View boxes that a user can zoom: by wheel, by a box with the left button, and back with a double click."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pyqtgraph as pg
from PySide6.QtCore import Qt, Signal


class ZoomBox(pg.ViewBox):  # type: ignore[misc]
    """A zoomable view box; while it is zoomed, ranges set by the program are stored until a double click ends the zoom.

    The middle button pans. `sig_whole` is emitted by the double click.
    """

    sig_whole = Signal()

    def __init__(self) -> None:
        super().__init__(enableMenu=False)
        self.setMouseMode(pg.ViewBox.RectMode)
        self.zoomed = False
        #: Whether the user is zooming, and whether ranges are set even while the box is zoomed.
        self._zooming = self._passing = False
        self._auto: list[Any] = [True, True]
        self._ranges: list[Any] = [None, None]

    def _keep_ranges(self) -> None:
        """Keep the ranges set by the program."""
        if not self.zoomed:
            self._auto, self._ranges = list(self.state["autoRange"]), self.viewRange()

    @contextmanager
    def _pass(self) -> Iterator[None]:
        """Set ranges even while the box is zoomed."""
        before, self._passing = self._passing, True
        try:
            yield
        finally:
            self._passing = before

    @contextmanager
    def _user(self) -> Iterator[None]:
        """Set ranges on behalf of the user."""
        self._keep_ranges()
        self._zooming = True
        try:
            with self._pass():
                yield
        finally:
            self._zooming = False

    def setRange(self, *args: Any, **options: Any) -> None:
        """Set the range; while the box is zoomed, only store it."""
        if self._passing or not self.zoomed:
            super().setRange(*args, **options)
            return
        for axis, name in enumerate(("xRange", "yRange")):
            if options.get(name) is not None:
                self._auto[axis], self._ranges[axis] = False, list(options[name])

    def enableAutoRange(self, axis: Any = None, enable: Any = True, x: Any = None, y: Any = None) -> None:
        """Enable automatic ranges, unless the box is zoomed."""
        if not self.zoomed:
            super().enableAutoRange(axis, enable, x, y)

    def linkedViewChanged(self, view: pg.ViewBox, axis: int) -> None:
        """Follow a linked box even if zoomed; if the user zooms the linked box, this one is zoomed as well."""
        if isinstance(view, ZoomBox) and view._zooming and not self.linksBlocked:
            self._keep_ranges()
            self.zoomed = True
        with self._pass():
            super().linkedViewChanged(view, axis)

    def wheelEvent(self, ev: Any, axis: int | None = None) -> None:
        """Zoom about the pointer."""
        with self._user():
            super().wheelEvent(ev, axis)
            self.zoomed = True

    def mouseDragEvent(self, ev: Any, axis: int | None = None) -> None:
        """Zoom to a box, or pan with the middle button."""
        pans = ev.button() == Qt.MouseButton.MiddleButton
        self.state["mouseMode"] = pg.ViewBox.PanMode if pans else pg.ViewBox.RectMode
        with self._user():
            super().mouseDragEvent(ev, axis)
            self.zoomed = self.zoomed or pans or ev.isFinish()

    def mouseDoubleClickEvent(self, ev: Any) -> None:
        """Show everything again."""
        self.reset()
        if (leader := self.linkedView(pg.ViewBox.XAxis)) is not None:
            leader.reset()
        self.sig_whole.emit()
        ev.accept()

    def reset(self) -> None:
        """End the zoom and apply the ranges set by the program."""
        if not self.zoomed:
            return
        self.zoomed = False
        for axis, (auto, limits) in enumerate(zip(self._auto, self._ranges, strict=True)):
            if auto:
                self.enableAutoRange(axis, auto)
            elif limits is not None and self.linkedView(axis) is None:
                self.setRange(**{("xRange", "yRange")[axis]: limits}, padding=0.0)


class TimeBox(ZoomBox):
    """The box of a plot over time: the wheel zooms the time, and with Ctrl or over the vertical axis the values.

    The program may set the time range at any time, so that only the value range is kept while the box is zoomed.
    """

    def setRange(self, *args: Any, **options: Any) -> None:
        """Set the range; while the values are zoomed, only store their range."""
        if options.get("xRange") is not None:
            pg.ViewBox.setRange(self, *args, **options)
        else:
            super().setRange(*args, **options)

    def linkedViewChanged(self, view: pg.ViewBox, axis: int) -> None:
        """Follow the time of a linked box."""
        pg.ViewBox.linkedViewChanged(self, view, axis)

    def wheelEvent(self, ev: Any, axis: int | None = None) -> None:
        """Zoom the time or the values about the pointer."""
        if axis is None:
            axis = 1 if ev.modifiers() & Qt.KeyboardModifier.ControlModifier else 0
        if axis == 0:
            pg.ViewBox.wheelEvent(self, ev, axis)
        else:
            super().wheelEvent(ev, axis)
