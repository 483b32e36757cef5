"""A pyqtgraph plot in the colours of the theme, which the user can zoom, and labels at the ends of lines."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyqtgraph as pg
from pyqtgraph.exporters import CSVExporter
from PySide6.QtCore import QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QColor, QContextMenuEvent, QFontMetrics, QGuiApplication, QImage, QPainter, QPaintEvent, QPen
from PySide6.QtSvg import QSvgGenerator
from PySide6.QtWidgets import QMenu, QSizePolicy, QWidget

from calstation.gui.text import say, with_minus
from calstation.gui.widgets import theme
from calstation.gui.widgets.badge import draw_state
from calstation.gui.widgets.file_dialog import ask_file, proposed_file
from calstation.physics import FloatArray


class ZoomBox(pg.ViewBox):  # type: ignore[misc]
    """A view box that the user can zoom, and that stores ranges set by the program while it is zoomed.

    The middle button pans. A double click ends the zoom, applies the stored ranges, and emits `sig_reset`.
    """

    sig_reset = Signal()

    def __init__(self) -> None:
        super().__init__(enableMenu=False)
        self.setMouseMode(pg.ViewBox.RectMode)
        self.zoomed = False
        #: Whether the user is zooming, and whether ranges are set even while the box is zoomed.
        self._zooming = self._passing = False
        self._auto: list[Any] = [True, True]
        self._ranges: list[Any] = [None, None]

    def _keep_ranges(self) -> None:
        """Store the ranges set by the program."""
        if not self.zoomed:
            self._auto, self._ranges = list(self.state["autoRange"]), self.viewRange()

    @contextmanager
    def _pass(self) -> Iterator[None]:
        """Allow ranges to be set even while the box is zoomed."""
        before, self._passing = self._passing, True
        try:
            yield
        finally:
            self._passing = before

    @contextmanager
    def _user(self) -> Iterator[None]:
        """Allow ranges to be set by the user."""
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
        """Follow a linked box even if this box is zoomed; a zoom of the linked box by the user also zooms this box."""
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
        self.sig_reset.emit()
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
    """The view box of a plot over time, in which the wheel zooms the time or, with Ctrl, the values.

    The wheel also zooms the values over the vertical axis. Because the program may set the time range at any time, only
    the range of the values is kept while the box is zoomed.
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


pg.setConfigOptions(antialias=False)

#: Minimum number of labels on a logarithmic axis, and maximum exponent of a value on an axis with equally spaced ticks.
_MIN_LABELS, _MAX_EXPONENT = 3, 300.0

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


#: Space for a number below a plot, px.
_LABEL_WIDTH = 5 * theme.GRID


class NumberAxis(pg.AxisItem):  # type: ignore[misc]
    """An axis with minus signs instead of hyphens, on which labels do not overlap even if the axis is short.

    Names of ticks below a plot are shortened in the middle.
    """

    _tickLevels: Any

    def tickSpacing(self, minVal: float, maxVal: float, size: float) -> list[tuple[float, float]]:
        """Return the spacings of labelled and smaller ticks, with space for the labels."""
        levels: list[tuple[float, float]] = super().tickSpacing(minVal, maxVal, size)
        space = theme.BODY if self.orientation == "left" else _LABEL_WIDTH
        if levels and levels[0][0] * size < space * abs(maxVal - minVal):
            return [(2.0 * levels[0][0], 0.0), levels[0]]
        return levels

    def tickStrings(self, values: Sequence[float], scale: float, spacing: float) -> list[str]:
        """Return the labels of ticks."""
        return [with_minus(text) for text in super().tickStrings(values, scale, spacing)]

    def setTicks(self, ticks: Any) -> None:
        """Set the ticks and, below a plot, space for the lines of their names."""
        lines = max((name.count("\n") + 1 for level in ticks or [] for _, name in level), default=1)
        if self.orientation == "bottom":
            self.setHeight(lines * self._metrics().lineSpacing() + theme.GRID if lines > 1 else None)
        super().setTicks(ticks)

    def _metrics(self) -> QFontMetrics:
        return QFontMetrics(self.style["tickFont"] or QGuiApplication.font())

    def generateDrawSpecs(self, p: QPainter) -> Any:
        """Return what is drawn; each line of a name is shortened to the distance between the ticks."""
        names = self._tickLevels
        if names and self.orientation == "bottom":
            self._tickLevels = [[(at, self._short(name)) for at, name in level] for level in names]
        try:
            return super().generateDrawSpecs(p)
        finally:
            self._tickLevels = names

    def _short(self, name: str) -> str:
        low, high = self.range
        positions = sorted(at for at, _ in self._tickLevels[0])
        distance = min((after - before for before, after in pairwise(positions)), default=high - low)
        space = int(distance * self.width() / ((high - low) or 1.0)) - theme.GRID // 2
        metrics, middle = self._metrics(), Qt.TextElideMode.ElideMiddle
        return "\n".join(metrics.elidedText(line, middle, space) for line in name.split("\n"))


class CountAxis(NumberAxis):
    """An axis for counts, with ticks at whole numbers."""

    def tickSpacing(self, minVal: float, maxVal: float, size: float) -> list[tuple[float, float]]:
        """Return the spacings of labelled and smaller ticks."""
        levels = super().tickSpacing(minVal, maxVal, size)
        return [level for level in levels if level[0] >= 1.0] or [(1.0, 0.0)]


class LogAxis(pg.AxisItem):  # type: ignore[misc]
    """A logarithmic axis with labels such as 0.01, 1 and 100, and powers of ten for very large and small values.

    If its range contains fewer than three values of the form 1, 2 or 5 times a power of ten, its ticks are at equally
    spaced values.
    """

    _equal = False

    def logTickValues(
        self, low: float, high: float, size: float, standard: Sequence[tuple[float, Sequence[float]]]
    ) -> list[tuple[float | None, Sequence[float]]]:
        """Return the spacings and the exponents of the ticks."""
        labelled = [e for e in _labelled(low, high) if low <= e <= high]
        self._equal = len(labelled) < _MIN_LABELS and -_MAX_EXPONENT < low < high < _MAX_EXPONENT
        if not self._equal:
            ticks: list[tuple[float | None, Sequence[float]]] = super().logTickValues(low, high, size, standard)
            return ticks
        first, last = 10.0**low, 10.0**high
        widest = (last - first) / _MIN_LABELS
        step = 10.0 ** np.floor(np.log10(widest))
        step *= max(factor for factor in (1.0, 2.0, 5.0) if factor * step <= widest * (1.0 + 1e-9))
        values = step * np.arange(np.ceil(first / step), np.floor(last / step) + 1.0)
        return [(None, np.log10(values).tolist())]

    def logTickStrings(self, values: Sequence[float], scale: float, spacing: float) -> list[str]:
        """Return one label per tick."""
        return [f"{10.0**value:.6g}" if self._equal else _plain(value) for value in values]


def _labelled(low: float, high: float) -> FloatArray:
    """Return the exponents of 1, 2 and 5 times all powers of ten around a range."""
    decades = np.arange(np.floor(low), np.ceil(high) + 1.0)
    exponents: FloatArray = np.add.outer(decades, np.log10([1.0, 2.0, 5.0])).ravel()
    return exponents


def _plain(exponent: float) -> str:
    """Return the label of a tick, which is empty unless the mantissa is 1, 2 or 5."""
    power = int(np.floor(exponent + 1e-9))
    mantissa = round(float(10.0 ** (exponent - power)), 6)
    if mantissa not in (1.0, 2.0, 5.0):
        return ""
    if -4 <= power <= 5:
        return f"{mantissa * 10.0**power:.6g}"
    return ("" if mantissa == 1.0 else f"{mantissa:g}·") + f"10{str(power).translate(_SUPERSCRIPTS)}"


#: Ratio of the resolution of a saved image to that of the screen.
_PRINT_SCALE = 3


class PlotMenu(QMenu):
    """The menu that copies a plot as an image or saves it; `write_csv` writes the plotted data."""

    def __init__(self, plot: pg.GraphicsView, write_csv: Callable[[Path], object]) -> None:
        super().__init__(plot)
        self._plot, self._write_csv = plot, write_csv

    def open(self, event: QContextMenuEvent) -> None:
        """Open the menu at the position of the click."""
        self.clear()
        self.addAction(say("common.copy_picture"), lambda: QGuiApplication.clipboard().setPixmap(self._plot.grab()))
        self.addAction(say("common.save_as"), self._ask_file)
        self.popup(event.globalPos())
        event.accept()

    def _ask_file(self) -> None:
        kinds = ["PNG (*.png)", "SVG (*.svg)", "CSV (*.csv)"]
        ask_file(self._plot, say("common.save_plot"), proposed_file(self._plot, "plot.png"), kinds, self._save)

    def _save(self, target: Path) -> None:
        match target.suffix.lower():
            case ".svg":
                generator = QSvgGenerator()
                generator.setFileName(str(target))
                generator.setViewBox(self._plot.rect())
                painter = QPainter(generator)
                self._plot.render(painter)
                painter.end()
            case ".csv":
                self._write_csv(target)
            case _:
                self._print_image().save(str(target))

    def _print_image(self) -> QImage:
        """Return an image with a resolution for printing."""
        image = QImage(_PRINT_SCALE * self._plot.size(), QImage.Format.Format_RGB32)
        image.fill(self._plot.backgroundBrush().color())
        painter = QPainter(image)
        self._plot.render(painter)
        painter.end()
        return image


class ThemedPlot(pg.PlotWidget):  # type: ignore[misc]
    """A plot with two axes in the colours of the current theme, with a menu to copy and save it.

    The user can zoom it (see `ZoomBox`), unless `zoom` is False. `counts` is the side of an axis for counts.
    """

    def __init__(self, parent: QWidget | None = None, *, zoom: bool = True, counts: str = "") -> None:
        axes = {side: CountAxis(side) if side == counts else NumberAxis(side) for side in ("left", "bottom")}
        box = {"viewBox": ZoomBox()} if zoom else {}
        super().__init__(parent, enableMenu=False, axisItems=axes, **box)
        self.hideButtons()
        self.getPlotItem().setContentsMargins(0, theme.GRID, 0, 0)  # half a label extends above the left axis
        self.menu = PlotMenu(self, self.write_csv)
        for side in ("left", "bottom"):
            axis = self.getAxis(side)
            # drawing the lines of a third level of ticks would double the drawing time
            axis.setStyle(tickFont=theme.font(), maxTickLevel=1)
            axis.label.setFont(theme.font())
            axis.enableAutoSIPrefix(False)
        self.apply_theme()
        theme.themes.changed.connect(self.apply_theme)

    def contextMenuEvent(self, event: QContextMenuEvent) -> None:
        """Offer to copy or save the plot."""
        self.menu.open(event)

    def setLabel(self, side: str, text: str) -> None:
        """Set the label of an axis, and centre it, which pyqtgraph does only when the axis is resized."""
        self.getPlotItem().setLabel(side, text)
        self.getPlotItem().layout.activate()  # a label enlarges its axis
        self.getAxis(side).resizeEvent()

    def write_csv(self, target: Path) -> None:
        """Write the data of the plot to a file."""
        CSVExporter(self.getPlotItem()).export(str(target))

    def apply_theme(self) -> None:
        """Apply the colours of the current theme."""
        c = theme.colours()
        self.setBackground(QColor(c.panel))
        for side in ("left", "bottom"):
            self.getAxis(side).setPen(QColor(c.line))
            self.getAxis(side).setTextPen(QColor(c.text))


#: Height of the note at the top of a plot, px.
_NOTE_HEIGHT = 28


class PlotNote(pg.TextItem):  # type: ignore[misc]
    """A line of texts at the top of a plot, each in its own colour."""

    def __init__(self, view_box: pg.ViewBox) -> None:
        super().__init__(anchor=(0, 0))
        self.setFont(theme.font())
        self.setParentItem(view_box)
        self.setPos(4, 0)

    def say(self, parts: Sequence[tuple[str, str]]) -> None:
        """Show texts; `parts` are pairs of text and colour."""
        spans = (f'<span style="color:{colour}">{word}</span>' for word, colour in parts)
        self.setHtml("&nbsp;&nbsp; ".join(spans))


def fit_below_note(plot: pg.PlotItem, low: float, high: float, min_span: float) -> None:
    """Set the vertical range so that values from `low` to `high` are drawn below the note of the plot."""
    span = max(high - low, min_span)
    bottom, top = low - 0.06 * span, low + 1.06 * span
    height = max(float(plot.getViewBox().height()), 3.0 * _NOTE_HEIGHT)
    plot.setYRange(bottom, top + (top - bottom) * _NOTE_HEIGHT / (height - _NOTE_HEIGHT), padding=0)


#: Width of the leader lines from the end of a curve to its label, px.
_LEADER_WIDTH = 2 * theme.GRID


@dataclass(frozen=True)
class LineLabel:
    """A label at `y` px from the top, after the symbol of a state (`badge.KINDS`, "" for none)."""

    y: float
    text: str
    colour: QColor
    state: str = ""
    bold: bool = False


def spread(heights: Sequence[float], distance: float, top: float, bottom: float) -> list[float]:
    """Space heights at least a distance apart between two limits, or evenly if there is no space.

    Parameters
    ----------
    heights
        Ascending heights, px.
    distance
        Minimum distance, px.
    top, bottom
        Limits, px.
    """
    if len(heights) > 1:
        distance = min(distance, (bottom - top) / (len(heights) - 1))
    positions = []
    lowest = top
    for position in heights:
        lowest = max(lowest, position)
        positions.append(lowest)
        lowest += distance
    highest = bottom
    for i in reversed(range(len(positions))):
        positions[i] = min(positions[i], highest)
        highest = positions[i] - distance
    return positions


class LineLabels(QWidget):
    """Labels to the right of a plot, in a widget of the same height."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self._labels: list[LineLabel] = []
        self.setFixedWidth(width)
        self.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Expanding)

    def show_labels(self, labels: Sequence[LineLabel]) -> None:
        """Show these labels."""
        ordered = sorted(labels, key=lambda label: label.y)
        if ordered != self._labels:
            self._labels = ordered
            self.update()

    def _fitting(self, count: int) -> list[LineLabel]:
        """Return at most `count` labels in their order; those with the symbol of a state are left out first."""
        by_importance = sorted(self._labels, key=lambda label: (bool(label.state), not label.bold))
        return sorted(by_importance[:count], key=lambda label: label.y)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw as many labels and leader lines as fit without overlap."""
        painter = theme.painter(self)
        line = theme.BODY + 4.0
        half = line / 2
        labels = self._fitting(max(int(self.height() // line), 1))
        positions = spread([label.y for label in labels], line, half, self.height() - half)
        for label, y in zip(labels, positions, strict=True):
            painter.setPen(QPen(QColor(theme.colours().line), 1, Qt.PenStyle.DotLine))  # unlike the curves
            painter.drawLine(QPointF(0, label.y), QPointF(_LEADER_WIDTH - 6, y))
            left = float(_LEADER_WIDTH)
            if label.state:
                draw_state(painter, label.state, QRectF(left, y - 6, 12, 12))
                left += 18
            painter.setFont(theme.font(bold=label.bold))
            painter.setPen(label.colour)
            box = QRectF(left, y - half, self.width() - left, line)
            text = painter.fontMetrics().elidedText(label.text, Qt.TextElideMode.ElideRight, int(box.width()))
            painter.drawText(box, Qt.AlignmentFlag.AlignVCenter, text)
