"""Plots of a design: worst ratio of sigma to limit over duration, joint angles over time, directions of gravity."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QSlider, QWidget

from calstation.designer import Design
from calstation.gui.engineer.preview import MotionPlot
from calstation.gui.text import bind, say
from calstation.gui.widgets import (
    VIEWER,
    Band,
    LogAxis,
    PlotNote,
    ThemedPlot,
    apart,
    circle,
    column,
    dashed,
    label,
    row,
    screen,
    theme,
    time_unit,
)
from calstation.physics import BoolArray, FloatArray, TableGeometry, axis_rotation
from calstation.results import Preview

#: Maximum rotation of a joint between two points of the drawn path, rad.
_STEP = np.deg2rad(4.0)
#: Maximum displayed ratio relative to the smallest ratio; the ratios after the first moves are far larger.
_MAX_RATIO = 30.0
#: Top of the plot relative to the largest displayed ratio, which leaves space for the note.
_HEADROOM = 1.2
#: Smallest distance between the names of two axes, in units of the radius of the sphere.
_LETTER = 0.2
#: Rotation of the sphere per press of an arrow key, degrees.
_ROTATION_STEP = 10


class FrontPlot(ThemedPlot):
    """Plot of the smallest achievable worst ratio of sigma to limit over duration, with the selected design."""

    def __init__(self) -> None:
        super().__init__()
        self.getPlotItem().setAxisItems({"left": LogAxis("left")})
        self.setLogMode(y=True)
        self.getAxis("left").setStyle(tickFont=theme.font())
        self.getAxis("left").setWidth(9 * theme.GRID)
        self.getAxis("left").enableAutoSIPrefix(False)
        self.getAxis("left").label.setFont(theme.font())
        self.getViewBox().setDefaultPadding(0.08)
        self.showGrid(x=True, y=True, alpha=0.15)
        self._note = PlotNote(self.getViewBox())
        self._note.setAnchor((1, 0))  # the curve descends from the left
        self.getViewBox().sigResized.connect(lambda box: self._note.setPos(box.width() - 4, 0))
        self._design: Design | None = None
        self.apply_theme()
        theme.on_appearance_change(self, self._draw)

    def show_design(self, design: Design) -> None:
        """Show a design and the other candidates of its search."""
        self._design = design
        self._draw()

    def _draw(self) -> None:
        self.setLabel("left", say("engineer.axis_sigma_over_limit"))
        design = self._design
        if design is None:
            return
        c = theme.colours()
        self.getPlotItem().clear()
        better = [p for p in design.front if p[0] < design.duration or p[1] < design.worst]
        front = np.array(sorted([*better, (design.duration, design.worst)]))
        size = time_unit(float(front[-1, 0]))
        front[:, 0] /= size
        self.setLabel("bottom", say("engineer.axis_duration_s" if size == 1.0 else "engineer.axis_duration_min"))
        dots = {"symbol": "o", "symbolSize": 5, "symbolBrush": c.accent, "symbolPen": None}
        line = pg.PlotDataItem(*front.T, pen=theme.pen(c.accent, 1), name="found", **dots)
        diamond = {"symbol": "d", "symbolSize": 16, "symbolBrush": c.good, "symbolPen": c.panel}
        mark = pg.PlotDataItem([design.duration / size], [design.worst], pen=None, name="chosen", **diamond)
        low, high = float(front[:, 1].min()), float(front[:, 1].max())
        nearest = min((ratio for _, ratio in better), default=low)  # always displayed
        top = _HEADROOM * max(design.margin, min(high, _MAX_RATIO * low), nearest)
        self.setYRange(np.log10(0.8 * low), np.log10(top), padding=0.0)
        self.addItem(line)
        self.addItem(pg.InfiniteLine(np.log10(design.margin), 0, pen=dashed(c.bad)))
        self.addItem(mark)
        margin = say("engineer.margin_line", margin=design.margin)
        note = [(say("engineer.chosen_design"), c.good), (margin, c.bad)]
        found = "engineer.found_in_search" if better else "engineer.nothing_else_found"
        self._note.say([(say(found), c.accent if better else c.text), *note])


@dataclass(frozen=True)
class DesignPath:
    """The motion of a design in the form that the plots require."""

    design: Design
    preview: Preview
    geometry: TableGeometry

    @property
    def path(self) -> tuple[FloatArray, FloatArray]:
        """Times, s, shape (n,), and directions of gravity in the body frame along the path, shape (n, 3)."""
        p = self.preview
        turns = np.maximum(np.abs(np.diff(p.outer)), np.abs(np.diff(p.inner)))
        knots = np.arange(len(p.time), dtype=np.float64)
        between = [np.linspace(k, k + 1.0, 1 + int(n / _STEP), endpoint=False) for k, n in enumerate(turns)]
        fine = np.concatenate([*between, knots[-1:]])
        time, outer, inner = (np.interp(fine, knots, values) for values in (p.time, p.outer, p.inner))
        return time, self.down(outer, inner)

    @property
    def rests(self) -> FloatArray:
        """Directions of gravity in the body frame at the rests, shape (moves, 3)."""
        angles = np.deg2rad([move[:2] for move in self.design.moves])
        return self.down(angles[:, 0], angles[:, 1])

    def down(self, outer: FloatArray, inner: FloatArray) -> FloatArray:
        """Return the directions of gravity in the body frame, shape (n, 3), at joint angles, rad, shape (n,)."""
        return np.array([-self.geometry.body_to_home(a, b)[2] for a, b in zip(outer, inner, strict=True)])


class PathPlot(MotionPlot):
    """Plots of the angles of both joints over time, with the planned part and the reserve."""

    def __init__(self) -> None:
        super().__init__()
        self._planned = 0.0

    def show_path(self, path: DesignPath) -> None:
        """Show the motion of a design."""
        self._planned = path.design.duration
        self.show_data(path.preview)

    def bands(self, preview: Preview) -> list[Band]:
        """Return the start and end of the planned part and of the reserve, if there is one."""
        size = time_unit(preview.duration)
        planned, end = self._planned / size, preview.duration / size
        bands = [(say("engineer.planned"), 0.0, planned)]
        return [*bands, (say("engineer.reserve"), planned, end)] if end > planned * 1.001 else bands


class Sphere(ThemedPlot):
    """Plot of the direction of gravity in the body frame as a path on a sphere, with numbered rests."""

    def __init__(self) -> None:
        super().__init__()
        self._path: DesignPath | None = None
        self._points: list[tuple[FloatArray, FloatArray]] = []
        self._angle = 0.0
        for side in ("left", "bottom"):
            self.hideAxis(side)
        self.setAspectLocked(True)
        self.getViewBox().invertY()
        self._note = PlotNote(self.getViewBox())
        theme.on_appearance_change(self, self._draw)

    def show_path(self, path: DesignPath) -> None:
        """Show the motion of a design."""
        self._path = path
        time, down = path.path
        planned = time <= path.design.duration + 1e-6
        self._points = [(time[planned], down[planned]), (time[~planned], down[~planned])]
        self._draw()

    def rotate_to(self, degrees: int) -> None:
        """Rotate the sphere about its vertical axis to an angle, degrees."""
        self._angle = float(np.deg2rad(degrees))
        self._draw()

    def write_csv(self, target: Path) -> None:
        """Write the times and directions of gravity in the body frame to a CSV file."""
        with target.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(["time_s", "down_x", "down_y", "down_z", "part"])
            for part, (time, down) in zip(("planned", "reserve"), self._points, strict=False):
                writer.writerows([t, *d, part] for t, d in zip(time.tolist(), down.tolist(), strict=True))

    def _draw(self) -> None:
        path = self._path
        if path is None:
            return
        c = theme.colours()
        self.getPlotItem().clear()
        self._line(circle(VIEWER) @ self._view, c.line, faint=False)
        letters = apart(self._on_screen(1.14 * np.eye(3)), _LETTER)
        for axis, name in enumerate("xyz"):
            ends = np.outer((-1.0, 1.0), np.eye(3)[axis])
            self._line(circle(np.eye(3)[axis]), c.line, width=1)
            self._line(ends, theme.AXIS_COLOURS[name], width=1)
            text = pg.TextItem(name, color=theme.axis_text(name), anchor=(0.5, 0.5))
            text.setFont(theme.font(theme.SECTION, bold=True))
            text.setPos(*letters[axis])
            self.addItem(text)
        planned, reserve = (down for _, down in self._points)
        self._line(reserve, c.muted, width=2, style=Qt.PenStyle.DashLine)
        self._line(planned, c.accent, width=2)
        self._draw_rests(path)
        note = [(say("engineer.planned_line"), c.accent)]
        if len(self._points[1][0]):
            note.append((say("engineer.reserve_line"), c.muted))
        self._note.say(note)
        self.setRange(xRange=(-1.2, 1.2), yRange=(-1.2, 1.2), padding=0.0)

    def _draw_rests(self, path: DesignPath) -> None:
        """Draw a dot at each attitude of the planned rests, labelled with the numbers of the rests."""
        c = theme.colours()
        rests: dict[tuple[float, ...], list[int]] = {}
        for number, down in enumerate(path.rests[: path.design.planned], start=1):
            rests.setdefault(tuple(np.round(down, 3).tolist()), []).append(number)
        for direction, numbers in rests.items():
            down = np.array([direction])
            front = bool(self._in_front(down)[0])
            at = self._on_screen(down)[0]
            dot = pg.ScatterPlotItem([at[0]], [at[1]], size=9 if front else 6, pen=theme.pen(c.panel))
            dot.setBrush(theme.faint(c.text, 255 if front else 110))
            self.addItem(dot)
            caption = ", ".join(map(str, numbers[:3])) + (" …" if len(numbers) > 3 else "")
            inwards = 1.1 if at[0] > 0.0 else -0.1, 0.0 if at[1] < 0.0 else 1.0  # the names of the axes are outside
            text = pg.TextItem(caption, color=c.text if front else c.muted, anchor=inwards)
            text.setFont(theme.font(12))
            text.setPos(*at)
            self.addItem(text, ignoreBounds=True)

    def _line(
        self,
        points: FloatArray,
        colour: str,
        *,
        width: float = 1.0,
        style: Qt.PenStyle = Qt.PenStyle.SolidLine,
        faint: bool = True,
    ) -> None:
        """Draw a line through points in the body frame, shape (n, 3); if `faint`, its part at the back is faint."""
        if len(points) < 2:
            return
        at, front = self._on_screen(points), self._in_front(points)
        sides = ((front, 255), (~front, 90)) if faint else ((np.ones(len(points), dtype=bool), 255),)
        for side, alpha in sides:
            joined = np.append(side[:-1] | side[1:] if alpha == 255 else side[:-1] & side[1:], False)
            pen = theme.pen(theme.faint(colour, alpha), width, style)
            self.addItem(pg.PlotCurveItem(at[:, 0], at[:, 1], connect=joined.astype(np.int32), pen=pen, antialias=True))

    @property
    def _view(self) -> FloatArray:
        """Rotation matrix from the body frame to the drawing, shape (3, 3)."""
        return np.asarray(axis_rotation((0.0, 0.0, 1.0), self._angle))

    def _in_front(self, points: FloatArray) -> BoolArray:
        """Return whether each point is on the side that faces the viewer, shape (n,)."""
        return np.asarray(points @ self._view.T @ VIEWER >= 0.0)

    def _on_screen(self, points: FloatArray) -> FloatArray:
        """Project points, shape (n, 3), onto the screen, shape (n, 2)."""
        return np.array([screen(point).toTuple() for point in points @ self._view.T])


class SphereView(QWidget):
    """The sphere and a slider that rotates it."""

    def __init__(self) -> None:
        super().__init__()
        self.sphere = Sphere()
        self.slider = QSlider(Qt.Orientation.Horizontal)
        self.slider.setObjectName("design_turn_slider")
        self.slider.setRange(-180, 180)
        self.slider.setSingleStep(_ROTATION_STEP)
        self.slider.setPageStep(3 * _ROTATION_STEP)
        self.slider.valueChanged.connect(self.sphere.rotate_to)
        bind(self.slider.setAccessibleName, "engineer.turn_sphere")
        title = label("engineer.gravity_direction", "muted", wrap=True)
        caption = label("engineer.turn", buddy=self.slider)
        column(title, (self.sphere, 1), row(caption, (self.slider, 1)), on=self, spacing=theme.GRID // 2)
