"""Schematic pictures of the methods: SVG files in the colours of the theme, with names of their parts."""

from functools import cache
from pathlib import Path

from PySide6.QtCore import QByteArray, QCoreApplication, QPointF, QRectF, QSize
from PySide6.QtGui import QColor, QFontMetricsF, QPainter, QPaintEvent, QPen
from PySide6.QtSvg import QSvgRenderer
from PySide6.QtWidgets import QSizePolicy, QWidget

from calstation.gui.logs.methods.kinds import CROSS_CALIBRATION, GIMBAL, MULTI_POSITION
from calstation.gui.widgets import spread, theme

_FOLDER = Path(__file__).parent / "images"
#: Colours of the files by the theme's names for them.
_DRAWN = {"text": "#14191d", "muted": "#55616a", "line": "#c3ccd2", "field": "#ffffff", "accent": "#1f5f8b"}
#: Half of a picture's width, in its own units.
_EXTENT = 1.3
#: Where each part is, in the same units from the centre, right and down.
_PARTS = {
    MULTI_POSITION: {"outer": (-0.914, -0.126), "inner": (-0.524, -0.533), "unit": (0.208, 0.183)},
    GIMBAL: {"z": (-0.687, -0.722), "x": (0.802, 0.053), "y": (-0.218, -0.278), "unit": (-0.248, 0.235)},
    CROSS_CALIBRATION: {"primary": (-0.787, 0.195), "secondary": (0.752, 0.182), "lever": (0.092, 0.043)},
}
#: Share of a labelled picture's width that is kept for names on either side.
_NAMES_ROOM = 0.3


class MethodPicture(QWidget):
    """The picture of a method with the names of its parts."""

    def __init__(self, stage: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._stage = stage
        self.setMinimumSize(260, 200)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)

    def sizeHint(self) -> QSize:
        """Wider than high, because of the names."""
        return QSize(380, 280)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw picture and names."""
        box = QRectF(self.rect())
        half = min(box.width() * (1.0 - _NAMES_ROOM), box.height()) / 2.0
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        _renderer(self._stage, theme.current()).render(painter, _square(box.center(), half))
        self._write_names(painter, box, half)

    def _write_names(self, painter: QPainter, box: QRectF, half: float) -> None:
        """Write the names at both sides, with thin lines to their parts."""
        painter.setFont(theme.font())
        metrics = QFontMetricsF(painter.font())
        colours, centre, names = theme.colours(), box.center(), _names()
        at = {k: centre + QPointF(x, y) * (half / _EXTENT) for k, (x, y) in _PARTS[self._stage].items()}
        for right in (False, True):
            keys = sorted((k for k in at if (at[k].x() >= centre.x()) is right), key=lambda k: at[k].y())
            heights = spread([at[k].y() for k in keys], metrics.height(), box.top(), box.bottom())
            for key, y in zip(keys, heights, strict=True):
                width = metrics.horizontalAdvance(names[key])
                edge = centre.x() + (half if right else -half)
                edge = min(edge, box.right() - width - 6) if right else max(edge, box.left() + width + 6)
                painter.setPen(QPen(QColor(colours.muted), 1))
                painter.drawLine(at[key], QPointF(edge, y))
                painter.setPen(QColor(colours.text))
                left = edge + 4 if right else edge - 4 - width
                painter.drawText(QPointF(left, y + 0.35 * metrics.ascent()), names[key])


def _square(centre: QPointF, half: float) -> QRectF:
    return QRectF(centre.x() - half, centre.y() - half, 2.0 * half, 2.0 * half)


@cache
def _renderer(stage: str, theme_name: str) -> QSvgRenderer:
    """The picture in the colours of a theme."""
    text, colours = (_FOLDER / f"{stage}.svg").read_text(encoding="utf-8"), theme.colours()
    for name, drawn in _DRAWN.items():
        dark_field = name == "field" and theme_name != "light"
        text = text.replace(drawn, colours.line if dark_field else getattr(colours, name))
    return QSvgRenderer(QByteArray(text.encode()))


def _names() -> dict[str, str]:
    return {
        "outer": QCoreApplication.translate("method_parts", "outer rail"),
        "inner": QCoreApplication.translate("method_parts", "inner rail"),
        "unit": QCoreApplication.translate("method_parts", "unit"),
        "z": QCoreApplication.translate("method_parts", "joint z"),
        "x": QCoreApplication.translate("method_parts", "joint x"),
        "y": QCoreApplication.translate("method_parts", "joint y"),
        "primary": QCoreApplication.translate("method_parts", "primary"),
        "secondary": QCoreApplication.translate("method_parts", "secondary"),
        "lever": QCoreApplication.translate("method_parts", "lever arm"),
    }
