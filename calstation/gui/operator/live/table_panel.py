"""Panel with a drawing of the table or gimbal, its joint angles and rates, and whether it moves."""

import numpy as np
from PySide6.QtCore import Qt, QTimer
from PySide6.QtWidgets import QFrame

from calstation.gui.operator.live.traces import CURRENT_MS
from calstation.gui.text import on_language_change, say, with_minus
from calstation.gui.widgets import (
    PANEL,
    VIEWER,
    Drawing,
    PlainLabel,
    StateBadge,
    basis,
    column,
    depth,
    grid,
    label,
    screen,
    theme,
)
from calstation.physics import ALIGNED, Orientation, axis_rotation
from calstation.sequencer import JointsMoved, TableMoved

#: Radii of the ring, its hole and the disc of a table.
_RING, _HOLE, _DISC = 1.0, 0.86, 0.8
#: Corners of the box of the unit along two directions in the plane of the disc and along its normal, shape (8, 3).
_CORNERS = np.array([[x, y, z] for x in (-0.3, 0.3) for y in (-0.3, 0.3) for z in (0.0, 0.26)])

#: Radius of the middle ring of a gimbal, width of its rings, and corners of the box of the unit, shape (8, 3).
_MIDDLE, _WIDTH = 0.82, 0.14
_UNIT = np.array([[x, y, z] for x in (-0.22, 0.22) for y in (-0.22, 0.22) for z in (-0.14, 0.14)])

Axis = tuple[float, float, float]


class TablePicture(Drawing):
    """Drawing of a table (ring and disc) or a gimbal (two rings) at its joint angles, with the axes of the unit."""

    def __init__(self) -> None:
        super().__init__(220)
        self._outer_axis: Axis = (1.0, 0.0, 0.0)
        self._inner_axis: Axis = (0.0, 0.0, 1.0)
        self._orientation: Orientation = ALIGNED
        self._angles: tuple[float, ...] = (0.0, 0.0)
        self._order = ""
        self._known = False  #: Whether the joint angles are known.

    def set_axes(self, outer: Axis, inner: Axis) -> None:
        """Set the table axes at home, unit vectors in the body frame of a unit that is aligned with the table."""
        self._outer_axis, self._inner_axis = outer, inner
        self.update()

    def set_orientation(self, orientation: Orientation) -> None:
        """Set the rotation from the axes of the unit, which are drawn, to the axes of the table."""
        self._orientation = orientation
        self.update()

    def set_angles(self, outer: float, inner: float, *, known: bool = True) -> None:
        """Set the joint angles, rad; the drawing is pale if they are not `known`."""
        if ((outer, inner), known) != (self._angles, self._known):
            self._angles, self._known = (outer, inner), known
            self.update()

    def set_joints(self, order: str, joints: tuple[float, ...] = (0.0, 0.0, 0.0), *, known: bool = False) -> None:
        """Set the order of gimbal joints, letters from base to body or "" for a table, and the angles x, y, z, rad."""
        self._order = order
        if order:
            self._angles, self._known = joints, known
            self.update()

    def draw(self) -> None:
        """Draw the table or the gimbal."""
        self._draw_gimbal() if self._order else self._draw_table()
        if not self._known:
            self.fade()

    def _draw_gimbal(self) -> None:
        """Draw the outer ring, the middle ring and the unit."""
        c = theme.colours()
        outer, middle, inner = ("xyz".index(name) for name in self._order)
        first, second, third = (axis_rotation(np.eye(3)[k], self._angles[k]) for k in (outer, middle, inner))
        unit = first @ second @ third
        for attitude, normal, radius in ((first, inner, _RING), (first @ second, outer, _MIDDLE)):
            self.plate(attitude[:, normal], radius, c.track, c.muted)
            self.plate(attitude[:, normal], radius - _WIDTH, c.panel, c.muted)
        self.box(_UNIT @ unit.T)
        self.axes(unit, (0.0, 0.0, 0.0), 0.62, [False] * 3)

    def _draw_table(self) -> None:
        """Draw the table from back to front."""
        c = theme.colours()
        ring = axis_rotation(self._outer_axis, self._angles[0])
        disc = ring @ axis_rotation(self._inner_axis, self._angles[1])
        inner = np.array(self._inner_axis)
        normal = ring @ inner
        corners = _CORNERS @ np.array([*basis(inner), inner]) @ disc.T
        facing = float(normal @ VIEWER) >= 0.0
        self._draw_posts(behind=True)
        if not facing:
            self.box(corners)
        self.plate(normal, _RING, c.track, c.muted)
        self.plate(normal, _HOLE, c.panel, c.muted)
        self.plate(normal, _DISC, c.window, c.muted)
        if facing:
            self.box(corners)
        self._draw_posts(behind=False)
        unit = disc @ np.array(self._orientation)
        across = normal @ unit if facing else -normal @ unit
        self.axes(unit, (0.0, 0.0, 0.0), 0.92, [bool(part < -0.3) for part in across])

    def _draw_posts(self, *, behind: bool) -> None:
        """Draw the posts at the ends of the outer axis, behind or in front of the table."""
        c = theme.colours()
        for axis in (np.array(self._outer_axis), -np.array(self._outer_axis)):
            if (depth(axis) > 0.0) is behind:
                end = screen(1.14 * axis)
                foot = screen(np.array([1.14 * axis[0], 1.14 * axis[1], -0.95]))  # the foot is on the floor
                self.line(foot, end, c.track, 0.10)
                self.line(end, screen(_RING * axis), c.muted, 0.07)


class TablePanel(QFrame):
    """Shows `TableMoved` events of a table, or `JointsMoved` events of a gimbal."""

    def __init__(self) -> None:
        super().__init__()
        self.setProperty("kind", "panel")
        self.picture, self.badge = TablePicture(), StateBadge()
        self._moved: TableMoved | JointsMoved | None = None
        #: Timer that is active while the last reading is current.
        self._current = QTimer(self, singleShot=True, interval=CURRENT_MS)
        self._current.timeout.connect(self._show_state)
        self._order = ""
        self._names = [label(), label(), label()]
        self.angle_labels = [PlainLabel(), PlainLabel(), PlainLabel()]
        self._rates = [label(kind="muted"), label(kind="muted"), label(kind="muted")]
        figures = grid(down=0, stretch=1)
        right = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        for row, (name, angle, rate) in enumerate(zip(self._names, self.angle_labels, self._rates, strict=True)):
            angle.setFont(theme.font(theme.SECTION, bold=True))
            for at, part in enumerate((name, angle, rate)):
                figures.addWidget(part, row, at)
            for number in (angle, rate):  # the label fills its cell, so that no number is cut off
                number.setAlignment(right)
        figures.setColumnMinimumWidth(2, 9 * theme.GRID)
        column(self.badge, (self.picture, 1), figures, on=self, spacing=theme.GRID // 2, margins=PANEL)
        on_language_change(self, self._show_state)

    def set_order(self, order: str) -> None:
        """Show a gimbal with this order of joints, letters from base to body, or a table for ""."""
        self._order = order
        self.picture.set_joints(order)
        self._show_state()

    def show_motion(self, moved: TableMoved | JointsMoved) -> None:
        """Show the joint angles and rates of an event."""
        self._moved = moved
        self._current.start()
        if isinstance(moved, JointsMoved):
            self.picture.set_joints(self._order, moved.joints, known=True)
            angles, rates = moved.joints, moved.rates
        else:
            self.picture.set_angles(moved.outer, moved.inner)
            angles, rates = (moved.outer, moved.inner), (moved.outer_rate, moved.inner_rate)
        for widget, angle in zip(self.angle_labels, angles, strict=False):
            widget.setText(with_minus(f"{np.rad2deg(angle):z.3f}°"))
        for widget, rate in zip(self._rates, rates, strict=False):
            widget.setText(with_minus(f"{np.rad2deg(rate):z.1f} °/s"))
        self._show_state()

    def clear(self) -> None:
        """Clear the readings, and show that the angles are unknown."""
        self._moved = None
        if self._order:
            self.picture.set_joints(self._order)
        else:
            self.picture.set_angles(0.0, 0.0, known=False)
        for widget in (*self.angle_labels, *self._rates):
            widget.setText("–")
        self._show_state()

    def _show_state(self) -> None:
        names = ("x", "y", "z") if self._order else (say("joint.outer"), say("joint.inner"), "")
        for name, text in zip(self._names, names, strict=True):
            name.setText(text)
        for third in (self._names[2], self.angle_labels[2], self._rates[2]):
            third.setVisible(bool(self._order))
        rig = "gimbal" if self._order else "table"
        if self._moved is None:
            self.badge.show_state("none", say(f"operator.{rig}_not_connected"))
        elif self._moved.moving and not self._current.isActive():
            self.badge.show_state("none", say(f"operator.{rig}_not_read"))
        elif self._moved.moving:
            self.badge.show_state("active", say(f"operator.{rig}_moving"))
        else:
            self.badge.show_state("stopped", say(f"operator.{rig}_at_rest"))
