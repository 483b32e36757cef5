"""Mouse actions on a plot by real events of its viewport."""

import pyqtgraph as pg
from PySide6.QtCore import QEvent, QPoint, QPointF, Qt
from PySide6.QtGui import QContextMenuEvent, QMouseEvent, QWheelEvent
from PySide6.QtWidgets import QApplication

Button, Modifier = Qt.MouseButton, Qt.KeyboardModifier


def pixel(view: pg.GraphicsView, box: pg.ViewBox, across: float, down: float) -> QPointF:
    """Return the point of a view at these fractions of the width and height of a box."""
    area = box.mapRectToScene(box.boundingRect())
    at = QPointF(area.left() + across * area.width(), area.top() + down * area.height())
    return QPointF(view.mapFromScene(at))


def turn_wheel(view: pg.GraphicsView, at: QPointF, modifier: Modifier = Modifier.NoModifier) -> None:
    """Turn the wheel forwards by two notches."""
    none = Button.NoButton, modifier, Qt.ScrollPhase.NoScrollPhase
    event = QWheelEvent(at, view.mapToGlobal(at), QPoint(), QPoint(0, 240), *none, False)
    QApplication.sendEvent(view.viewport(), event)
    QApplication.processEvents()


def move_mouse(view: pg.GraphicsView, at: QPointF) -> None:
    """Move the mouse with no button pressed."""
    _send(view, QEvent.Type.MouseMove, at, Button.NoButton, Button.NoButton)


def drag(view: pg.GraphicsView, start: QPointF, stop: QPointF, button: Button = Button.LeftButton) -> None:
    """Press a button, move the mouse and release it."""
    move_mouse(view, start)
    _send(view, QEvent.Type.MouseButtonPress, start, button, button)
    for at in ((start + stop) / 2, stop):
        _send(view, QEvent.Type.MouseMove, at, Button.NoButton, button)
    _send(view, QEvent.Type.MouseButtonRelease, stop, button, Button.NoButton)


def double_click(view: pg.GraphicsView, at: QPointF) -> None:
    """Click twice."""
    kinds = QEvent.Type.MouseButtonPress, QEvent.Type.MouseButtonRelease, QEvent.Type.MouseButtonDblClick
    for kind in (*kinds, QEvent.Type.MouseButtonRelease):
        held = Button.NoButton if kind == QEvent.Type.MouseButtonRelease else Button.LeftButton
        _send(view, kind, at, Button.LeftButton, held)


def open_menu(view: pg.GraphicsView) -> list[str]:
    """Open the menu with the right button and close it; return its entries."""
    at = view.rect().center()
    event = QContextMenuEvent(QContextMenuEvent.Reason.Mouse, at, view.mapToGlobal(at))
    QApplication.sendEvent(view.viewport(), event)
    view.menu.close()
    return [action.text() for action in view.menu.actions()]


def _send(view: pg.GraphicsView, kind: QEvent.Type, at: QPointF, button: Button, held: Button) -> None:
    event = QMouseEvent(kind, at, view.viewport().mapToGlobal(at), button, held, Modifier.NoModifier)
    QApplication.sendEvent(view.viewport(), event)
    QApplication.processEvents()
