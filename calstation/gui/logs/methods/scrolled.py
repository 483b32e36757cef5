"""Lets a view be higher than a small screen."""

from PySide6.QtWidgets import QFrame, QScrollArea, QWidget


def scrolled(view: QWidget) -> QScrollArea:
    """The view in an area of its own, which shows a bar only where there is no room."""
    area = QScrollArea()
    area.setWidgetResizable(True)
    area.setFrameShape(QFrame.Shape.NoFrame)
    area.setProperty("kind", "clear")
    area.setWidget(view)
    return area
