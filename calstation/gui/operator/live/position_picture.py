"""Drawing of the unit on a manual rig, its attitude, the positions, and the progress of a rest."""

import itertools

import numpy as np
from PySide6.QtCore import QPointF

from calstation.gui.text import on_language_change, say
from calstation.gui.widgets import Drawing, basis, circle, depth, screen, theme
from calstation.physics import FloatArray, axis_rotation, rotation_matrix
from calstation.runs import RunSummary
from calstation.sequencer import PositionGuided

_UP = np.array([0.0, 0.0, 1.0])
#: Half the size of the box of the unit along x, y and z; the radius of the sphere is 1.
_HALF_SIZE = np.array([0.34, 0.46, 0.16])
_CORNERS = _HALF_SIZE * np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
#: Radius and width of the ring that fills while the unit is at rest, and radius of the dot of a position.
_RING, _WIDTH = 1.3, 0.1
_DOT = 0.055
#: Opacity of elements behind the unit, and of the next position behind the unit.
_PALE, _PALE_NEXT = 0.35, 0.6
#: Cosine of the angle within which two positions are drawn as one dot.
_COS_SAME = np.cos(np.deg2rad(20.0))


class PositionPicture(Drawing):
    """Draws `PositionGuided` events.

    Only the up direction is measured; the heading is computed from the rail angles of the latest position.
    """

    def __init__(self) -> None:
        super().__init__(360)
        self._outer, self._inner = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
        self._planned = np.empty((0, 3))
        self._attitude = np.eye(3)
        self._guided: PositionGuided | None = None
        on_language_change(self, self.update)

    def set_plan(self, run_summary: RunSummary) -> None:
        """Show a level unit on the rig of a run until the first measurement."""
        self._outer, self._inner = run_summary.outer_axis, run_summary.inner_axis
        self._planned = _distinct(np.array(run_summary.positions).reshape(-1, 3))
        self._guided, self._attitude = None, np.eye(3)
        self.update()

    def show_position(self, guided: PositionGuided) -> None:
        """Show the attitude and the progress of a position."""
        arrived = len(guided.done) // 3 >= guided.index
        if guided.state == "enough":
            angles = (guided.outer, guided.inner) if arrived else (guided.outer_before, guided.inner_before)
            self._attitude = self._attitude_at(*angles)
        self._attitude = _upright(self._attitude, np.array(guided.up))
        self._guided = guided
        self.update()

    def up_at(self, outer: float, inner: float) -> FloatArray:
        """Return the up direction in the body frame b, shape (3,), at rail angles, rad."""
        return np.asarray(self._attitude_at(outer, inner)[2])

    def _attitude_at(self, outer: float, inner: float) -> FloatArray:
        """Return the attitude matrix from the body frame b to the level frame, shape (3, 3), at rail angles, rad."""
        return np.asarray(axis_rotation(self._outer, outer) @ axis_rotation(self._inner, inner))

    def draw(self) -> None:
        """Draw the elements from back to front."""
        self._draw_ring()
        self._draw_sphere()
        self._draw_positions(behind=True)
        self.box(_CORNERS @ self._attitude.T)
        hidden = [depth(axis) > 0.3 for axis in self._attitude.T]
        self.axes(self._attitude, _HALF_SIZE.tolist(), 0.74, hidden)
        self._draw_positions(behind=False)
        self._draw_gravity()

    def _draw_ring(self) -> None:
        """Draw the ring, which fills clockwise while the unit is at rest."""
        c, now = theme.colours(), self._guided
        self.disc(QPointF(), _RING, c.track, _WIDTH)
        if now is not None and now.state == "enough":
            self.arc(_RING, 1.0, c.good, _WIDTH)
        elif now is not None and now.state == "still":
            self.arc(_RING, min(now.rest / now.wanted, 1.0), c.accent, _WIDTH)

    def _draw_sphere(self) -> None:
        """Draw a sphere that rotates with the unit: three circles normal to its axes, pale at the back."""
        colour = theme.colours().line
        self.disc(QPointF(), 1.0, colour, 0.012)
        for normal in self._attitude.T:
            for first, second in itertools.pairwise(circle(normal)):
                self.set_opacity(_PALE if depth(first + second) > 0.0 else 1.0)
                self.line(screen(first), screen(second), colour, 0.012)
        self.set_opacity(1.0)

    def _draw_positions(self, *, behind: bool) -> None:
        """Draw the positions behind or in front of the unit: dots if completed, otherwise rings, the next one large."""
        c, now = theme.colours(), self._guided
        done = np.array(now.done if now is not None else ()).reshape(-1, 3)
        following = np.empty((0, 3))
        if now is not None and len(done) < now.index:
            following = self._attitude_at(now.outer, now.inner)[2:]
        others = np.vstack([done, following])
        remaining = [up for up in self._planned if not (len(others) and (others @ up).max() > _COS_SAME)]
        for positions, radius, colour, width, fill, pale in (
            (_distinct(done), _DOT, c.panel, 0.02, c.text, _PALE),
            (remaining, _DOT, c.muted, 0.025, "", _PALE),
            (following, 2.0 * _DOT, c.accent, 0.06, "", _PALE_NEXT),
        ):
            self.set_opacity(pale if behind else 1.0)
            for up in positions:
                at = self._attitude @ up
                if (depth(at) > 0.0) is behind:
                    self.disc(screen(at), radius, colour, width, fill)
        self.set_opacity(1.0)

    def _draw_gravity(self) -> None:
        """Draw the mark at the top, to which the next position must be moved, and an arrow that points down."""
        c = theme.colours()
        top, foot, tip = screen(1.02 * _UP), screen(-1.0 * _UP), screen(-1.26 * _UP)
        self.area([top, top + QPointF(-0.09, -0.16), top + QPointF(0.09, -0.16)], c.accent)
        self.line(foot, tip + QPointF(0.0, -0.06), c.text, 0.035)
        self.area([tip, tip + QPointF(-0.06, -0.12), tip + QPointF(0.06, -0.12)], c.text)
        self.letter(say("operator.down"), foot + QPointF(0.34, 0.1), c.text)


def _upright(attitude: FloatArray, up: FloatArray) -> FloatArray:
    """Return the attitude, shape (3, 3), after the smallest rotation that turns `up`, shape (3,) in b, upwards."""
    present = attitude @ up
    axis = np.cross(present, _UP)
    size = float(np.linalg.norm(axis))
    angle = float(np.arctan2(size, present @ _UP))
    if size < 1e-9:
        axis, size = basis(_UP)[0], 1.0
    return np.asarray(rotation_matrix(axis / size * angle) @ attitude)


def _distinct(directions: FloatArray) -> FloatArray:
    """Return the first direction of each cluster, shape (k, 3), from unit vectors `directions`, shape (n, 3)."""
    distinct: list[FloatArray] = []
    for direction in directions:
        if all(float(direction @ other) < _COS_SAME for other in distinct):
            distinct.append(direction)
    return np.array(distinct).reshape(-1, 3)
