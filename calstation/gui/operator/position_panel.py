"""Guides the operator through the positions of a manual rig: drawing, state, task and position count."""

import itertools

import numpy as np
from PySide6.QtCore import QPointF, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPolygonF, QResizeEvent
from PySide6.QtWidgets import QFrame, QSizePolicy, QWidget

from calstation.config import RunSummary
from calstation.gui.operator.projection import CIRCLE, basis, box, depth, flat, head, letter, pen
from calstation.gui.text import on_language_change
from calstation.gui.widgets import StateBadge, button, column, label, row, theme
from calstation.physics import FloatArray, axis_rotation, rotation_matrix
from calstation.sequencer import PositionGuided

_UP = np.array([0.0, 0.0, 1.0])
#: Half of the box along x, y, z; the globe's radius is 1.
_HALF = np.array([0.34, 0.46, 0.16])
_CORNERS = _HALF * np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
_AXIS = 0.74
#: Radius and width of the ring that fills while it rests.
_RING, _THICK = 1.3, 0.1
_EXTENT = 1.38
_DOT = 0.055
#: Opacity behind the unit.
_PALE = 0.35
#: Opacity of the next position behind the unit.
_FAR = 0.6
#: Cosine of the angle below which two positions are one dot.
_ALIKE = np.cos(np.deg2rad(20.0))


class PositionPicture(QWidget):
    """Draws the unit on a manual rig: its attitude to gravity, positions done and to do, and how long it has rested.

    Only the direction of gravity is measured. The heading is taken from the angles asked for and kept from there on, so
    that the drawing turns with the unit.
    """

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._outer, self._inner = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
        self._planned = np.empty((0, 3))
        self._attitude = np.eye(3)
        self._guided: PositionGuided | None = None
        self.setMinimumSize(160, 160)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        on_language_change(self, self.update)

    def sizeHint(self) -> QSize:
        """Square."""
        return QSize(360, 360)

    def set_plan(
        self,
        outer: tuple[float, float, float],
        inner: tuple[float, float, float],
        positions: tuple[tuple[float, float, float], ...],
    ) -> None:
        """Set the rig and its positions.

        Parameters
        ----------
        outer, inner : rail axes as unit vectors in b at home
        positions : direction of gravity in b at each position
        """
        self._outer, self._inner = outer, inner
        self._planned = _distinct(np.array(positions).reshape(-1, 3))
        self.forget()

    def forget(self) -> None:
        """Show the unit level, before anything is measured."""
        self._guided, self._attitude = None, np.eye(3)
        self.update()

    def take(self, guided: PositionGuided) -> None:
        """Show the attitude and the progress of a position."""
        arrived = len(guided.done) // 3 >= guided.index
        if guided.state == "enough":
            known = (guided.outer, guided.inner) if arrived else (guided.outer_before, guided.inner_before)
            self._attitude = self._asked(*known)
        self._attitude = _upright(self._attitude, np.array(guided.up))
        self._guided = guided
        self.update()

    def _asked(self, outer: float, inner: float) -> FloatArray:
        """Attitude b to level frame at rail angles, rad, shape (3, 3)."""
        return np.asarray(axis_rotation(self._outer, outer) @ axis_rotation(self._inner, inner))

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw from back to front."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        scale = min(self.width(), self.height()) / (2.0 * _EXTENT)
        painter.translate(self.width() / 2.0, self.height() / 2.0)
        painter.scale(scale, scale)
        self._ring(painter)
        self._globe(painter)
        self._dots(painter, behind=True)
        box(painter, _CORNERS @ self._attitude.T)
        self._axes(painter)
        self._dots(painter, behind=False)
        self._gravity(painter)
        painter.end()

    def _ring(self, painter: QPainter) -> None:
        """A ring that fills clockwise from the top while the unit rests."""
        c, now = theme.colours(), self._guided
        frame = QRectF(-_RING, -_RING, 2.0 * _RING, 2.0 * _RING)
        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.setPen(pen(c.line, _THICK))
        painter.drawEllipse(frame)
        if now is None or now.state not in ("still", "enough"):
            return
        share = 1.0 if now.state == "enough" else min(now.rest / now.wanted, 1.0)
        line = pen(c.good if now.state == "enough" else c.accent, _THICK)
        line.setCapStyle(Qt.PenCapStyle.FlatCap)
        painter.setPen(line)
        painter.drawArc(frame, 90 * 16, round(-share * 360 * 16))

    def _globe(self, painter: QPainter) -> None:
        """A sphere that turns with the unit: three circles across its axes, pale at the back."""
        c = theme.colours()
        painter.setPen(pen(c.line, 0.012))
        painter.drawEllipse(QPointF(0.0, 0.0), 1.0, 1.0)
        for normal in self._attitude.T:
            u, v = basis(normal)
            points = np.outer(np.cos(CIRCLE), u) + np.outer(np.sin(CIRCLE), v)
            for first, second in itertools.pairwise(points):
                far = depth(first + second) > 0.0
                painter.setOpacity(_PALE if far else 1.0)
                painter.drawLine(flat(first), flat(second))
        painter.setOpacity(1.0)

    def _dots(self, painter: QPainter, *, behind: bool) -> None:
        """Positions done as dots, those to do as rings, the next one as a large ring."""
        c, now = theme.colours(), self._guided
        done = np.array(now.done if now is not None else ()).reshape(-1, 3)
        wanted = None if now is None else self._asked(now.outer, now.inner).T @ _UP
        if now is not None and len(done) >= now.index:
            wanted = None
        painter.setOpacity(_PALE if behind else 1.0)
        for up in _distinct(done):
            at = self._attitude @ up
            if (depth(at) > 0.0) is behind:
                painter.setPen(pen(c.panel, 0.02))
                painter.setBrush(QColor(c.text))
                painter.drawEllipse(flat(at), _DOT, _DOT)
        painter.setBrush(Qt.BrushStyle.NoBrush)
        known = done if wanted is None else np.vstack([done, wanted])
        for up in self._planned:
            at = self._attitude @ up
            if (depth(at) > 0.0) is behind and not (len(known) and (known @ up).max() > _ALIKE):
                painter.setPen(pen(c.muted, 0.025))
                painter.drawEllipse(flat(at), _DOT, _DOT)
        if wanted is not None and (depth(at := self._attitude @ wanted) > 0.0) is behind:
            painter.setOpacity(_FAR if behind else 1.0)
            painter.setPen(pen(c.accent, 0.06))
            painter.drawEllipse(flat(at), 2.0 * _DOT, 2.0 * _DOT)
        painter.setOpacity(1.0)

    def _axes(self, painter: QPainter) -> None:
        for i, name in sorted(enumerate("xyz"), key=lambda pair: -depth(self._attitude[:, pair[0]])):
            direction = self._attitude[:, i]
            start, tip, colour = flat(_HALF[i] * direction), flat(_AXIS * direction), theme.AXIS_COLOURS[name]
            line = pen(colour, 0.045)
            if depth(direction) > 0.3:
                line.setStyle(Qt.PenStyle.DotLine)
            painter.setPen(line)
            painter.drawLine(start, tip)
            head(painter, tip, colour)
            letter(self, painter, name, flat((_AXIS + 0.14) * direction), colour)

    def _gravity(self, painter: QPainter) -> None:
        """The mark at the top, where the next position has to come, and an arrow down."""
        c = theme.colours()
        top = flat(1.02 * _UP)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(QColor(c.accent))
        painter.drawPolygon(
            QPolygonF([top, top + QPointF(-0.09, -0.16), top + QPointF(0.09, -0.16)]),
        )
        foot, tip = flat(-1.0 * _UP), flat(-1.26 * _UP)
        painter.setPen(pen(c.text, 0.035))
        painter.drawLine(foot, tip + QPointF(0.0, -0.06))
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(QColor(c.text))
        painter.drawPolygon(QPolygonF([tip, tip + QPointF(-0.06, -0.12), tip + QPointF(0.06, -0.12)]))
        word = self.tr("down")
        letter(self, painter, word, foot + QPointF(0.34, 0.1), c.text)


def _upright(attitude: FloatArray, up: FloatArray) -> FloatArray:
    """The attitude, shape (3, 3), turned the shortest way until `up`, shape (3,) in b, points up."""
    seen = attitude @ up
    axis = np.cross(seen, _UP)
    size = float(np.linalg.norm(axis))
    angle = float(np.arctan2(size, seen @ _UP))
    if size < 1e-9:
        axis, size = basis(_UP)[0], 1.0
    return np.asarray(rotation_matrix(axis / size * angle) @ attitude)


def _distinct(directions: FloatArray) -> FloatArray:
    """The first of every cluster of unit vectors, shape (n, 3), in order, shape (k, 3)."""
    found: list[FloatArray] = []
    for direction in directions:
        if not found or max(float(direction @ other) for other in found) < _ALIKE:
            found.append(direction)
    return np.array(found).reshape(-1, 3)


#: Text sizes, px, legible from two metres; a third larger on a wide panel.
_WORD, _SENTENCE = theme.VERDICT // 2, theme.VERDICT // 3
_WIDE = 170 * theme.GRID
_KINDS = {"waiting": "waiting", "moving": "active", "still": "paused", "enough": "good", "repeat": "caution"}
#: Least turn of a rail that is asked for, rad.
_LEAST_TURN = np.deg2rad(1.0)


class PositionPanel(QFrame):
    """Shows `PositionGuided` events; `finish_wanted()` : the operator ends the stage early."""

    finish_wanted = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setProperty("kind", "panel")
        self._guided: PositionGuided | None = None
        self._finishing = self._over = False
        self.picture = PositionPicture()
        self.badge = StateBadge(_WORD)
        self.task_label, self.count_label = label(wrap=True), label()
        self._note = label(kind="muted", wrap=True)
        self.finish_button = button(
            "finish_positions_button", lambda: self.tr("Enough positions: finish"), self._finish
        )
        texts = QWidget()
        texts.setMinimumWidth(60 * theme.GRID)
        texts.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        left = Qt.AlignmentFlag.AlignLeft
        column(
            *(None, (self.badge, 0, left), self.task_label, self.count_label),
            *(None, self._note, (self.finish_button, 0, left)),
            on=texts,
            spacing=2 * theme.GRID,
        )
        row(
            (self.picture, 1),
            (texts, 1),
            on=self,
            spacing=3 * theme.GRID,
            margins=(2 * theme.GRID, theme.GRID, 2 * theme.GRID, 2 * theme.GRID),
        )
        self._enlarge(1.0)
        on_language_change(self, self._refresh)

    def plan(self, run_summary: RunSummary) -> None:
        """Prepare for a run: its rig and its positions."""
        self._guided, self._finishing, self._over = None, False, False
        self.picture.set_plan(run_summary.outer_axis, run_summary.inner_axis, run_summary.positions)
        self._refresh()

    def take(self, guided: PositionGuided) -> None:
        """Show the progress of a position."""
        self._guided, self._over = guided, False
        self.picture.take(guided)
        self._refresh()

    def finish_stage(self) -> None:
        """Show that all positions of the stage are done."""
        self._over = True
        self._refresh()

    def _refresh(self) -> None:
        now = self._guided
        if self._over:
            self.badge.show_state("good", self.tr("All positions done"))
            self.task_label.setText(self.tr("Leave the unit alone while the results are computed and checked."))
        elif now is None:
            self.badge.show_state("none", self.tr("Wait"))
            self.task_label.setText(self.tr("Leave the unit alone until the first position is asked for."))
        if self._over or now is None:
            self.count_label.setText("")
            self._note.setText("")
            self.finish_button.setVisible(False)
            return
        self.badge.show_state(_KINDS[now.state], self._state(now.state))
        self.task_label.setText(self._task(now))
        self.count_label.setText(self._count(now))
        self._show_finish(now)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Use larger text if there is room."""
        self._enlarge(4.0 / 3.0 if event.size().width() >= _WIDE else 1.0)
        super().resizeEvent(event)

    def _enlarge(self, times: float) -> None:
        self.badge.set_size(round(times * _WORD))
        self.task_label.setFont(theme.font(round(times * _SENTENCE), bold=True))
        self.count_label.setFont(theme.font(round(times * _SENTENCE)))

    def _state(self, state: str) -> str:
        return {
            "waiting": self.tr("Waiting"),
            "moving": self.tr("Moving"),
            "still": self.tr("Hold still"),
            "enough": self.tr("Enough: go on"),
            "repeat": self.tr("Too soon: repeat"),
        }[state]

    def _task(self, now: PositionGuided) -> str:
        """What to do now."""
        if now.state == "still":
            return self.tr("Hands off. {seconds:.0f} s left.").format(seconds=max(np.ceil(now.wanted - now.rest), 0.0))
        if now.state == "repeat":
            return self.tr("It was moved too soon. Let go, and leave it for {seconds:.0f} s.").format(
                seconds=now.wanted
            )
        outer, inner = f"{np.rad2deg(now.outer):.0f}°", f"{np.rad2deg(now.inner):.0f}°"
        turns = (
            abs(now.outer - now.outer_before) > _LEAST_TURN,
            abs(now.inner - now.inner_before) > _LEAST_TURN,
        )
        if turns == (True, True):
            words = self.tr("Turn the outer rail to about {outer} and the inner rail to about {inner}, then let go.")
        elif turns == (True, False):
            words = self.tr("Turn the outer rail to about {outer}, then let go.")
        elif turns == (False, True):
            words = self.tr("Turn the inner rail to about {inner}, then let go.")
        else:
            words = self.tr("Leave it with the outer rail at {outer} and the inner rail at {inner}, hands off.")
        return words.format(outer=outer, inner=inner).replace("-", "−")

    def _count(self, now: PositionGuided) -> str:
        words = self.tr("position {index} of {count}") if now.stage else self.tr("check {index} of {count}")
        return words.format(index=now.index, count=now.count)

    def _show_finish(self, now: PositionGuided) -> None:
        """Whether the stage may end here, or why not."""
        if not now.stage:
            self._note.setText(self.tr("The registers are written; these two rests verify them."))
        elif self._finishing:
            self._note.setText(self.tr("Finishing: the positions done are being solved."))
        elif now.suffices:
            self._note.setText(self.tr("The positions done are sufficient; more improve the accuracy."))
        else:
            self._note.setText(
                self.tr("Rings on the globe are still to do; turn the large one to the mark at the top.")
            )
        self.finish_button.setVisible(bool(now.stage))
        self.finish_button.setEnabled(now.suffices and not self._finishing)
        self.finish_button.setToolTip(
            "" if now.suffices else self.tr("Not yet: the positions done are not sufficient.")
        )

    def _finish(self) -> None:
        self._finishing = True
        self.finish_wanted.emit()
        self._refresh()
