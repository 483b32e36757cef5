"""The methods that need no rate table: tabs that select a method, and guidance on how to perform it."""

from functools import cache, partial
from pathlib import Path

from PySide6.QtCore import QByteArray, QPointF, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QFontMetricsF, QPainter, QPaintEvent, QPen
from PySide6.QtSvg import QSvgRenderer
from PySide6.QtWidgets import QScrollArea, QSizePolicy, QWidget

from calstation.gui.text import bind, on_language_change, term
from calstation.gui.widgets import ViewTabs, column, grid, label, row, scroll_area, spread, theme

MULTI_POSITION, GIMBAL, CROSS_CALIBRATION = "multi_position", "gimbal", "cross_calibration"
#: Stage names of the methods, in the order of the tabs.
STAGES = (MULTI_POSITION, GIMBAL, CROSS_CALIBRATION)

_FOLDER = Path(__file__).parent / "images"
#: Colour in the SVG files by the name of the theme colour that replaces it.
_SVG_COLOURS = {"text": "#14191d", "muted": "#55616a", "track": "#c3ccd2", "field": "#ffffff", "accent": "#1f5f8b"}
#: Half the width of an illustration in the unit of `_PARTS`.
_EXTENT = 1.3
#: Position of each labelled part, right and down from the centre.
_PARTS = {
    MULTI_POSITION: {"outer": (-0.914, -0.126), "inner": (-0.524, -0.533), "unit": (0.208, 0.183)},
    GIMBAL: {"z": (-0.687, -0.722), "x": (0.802, 0.053), "y": (-0.218, -0.278), "unit": (-0.248, 0.235)},
    CROSS_CALIBRATION: {"primary": (-0.787, 0.195), "secondary": (0.752, 0.182), "lever": (0.092, 0.043)},
}
#: Fraction of the width that the names on both sides occupy.
_NAMES_SHARE = 0.3


class MethodBar(ViewTabs):
    """Tabs for the stages of the log ("") and for the methods, which emit `method_selected(method)`."""

    method_selected = Signal(str)

    def __init__(self) -> None:
        super().__init__("method_tabs", "logs.stages_of_log", *(f"stage.{stage}" for stage in STAGES))
        tips = "logs.solve_stages_tip", *(f"method.{stage}_summary" for stage in STAGES)
        for index, tip in enumerate(tips):
            bind(partial(self.setTabToolTip, index), tip)
        self.currentChanged.connect(lambda _: self.method_selected.emit(self.method))

    @property
    def method(self) -> str:
        """The selected method, or "" for the stages."""
        return ("", *STAGES)[self.currentIndex()]

    def select(self, method: str) -> None:
        """Select a method as if its tab were clicked."""
        self.setCurrentIndex(("", *STAGES).index(method))


def guidance(stage: str) -> QScrollArea:
    """Create the view that explains how to perform a method, with steps, requirements, results and an illustration."""
    wide = 2 * theme.GRID
    steps, foot = (grid(across=wide, down=wide, stretch=1) for _ in range(2))
    for number in (1, 2, 3, 4):
        step = label(f"method.{stage}_step_{number}", wrap=True)
        step.setFont(theme.font(theme.BODY + 1))
        steps.addWidget(label(partial(str, number), "number"), number, 0, Qt.AlignmentFlag.AlignTop)
        steps.addWidget(step, number, 1)
    for line, key in enumerate(("needs", "finds")):
        foot.addWidget(label(f"method.{key}", "muted"), line, 0, Qt.AlignmentFlag.AlignTop)
        foot.addWidget(label(f"method.{stage}_{key}", wrap=True), line, 1)
    body = QWidget()
    left = column(steps, foot, None, spacing=3 * theme.GRID)
    margins = (theme.GRID, wide, theme.GRID, theme.GRID)
    row((left, 11), (MethodPicture(stage), 9), on=body, spacing=4 * theme.GRID, margins=margins)
    return scroll_area(body, texts=True)


class MethodPicture(QWidget):
    """The illustration of a method with the names of its parts."""

    def __init__(self, stage: str) -> None:
        super().__init__()
        self._stage = stage
        self.setMinimumSize(260, 200)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        on_language_change(self, self.update)

    def sizeHint(self) -> QSize:
        """Return a size with space for the names on both sides."""
        return QSize(380, 280)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the illustration and the names."""
        box = QRectF(self.rect())
        half = min(box.width() * (1.0 - _NAMES_SHARE), box.height()) / 2.0
        square = QRectF(box.center().x() - half, box.center().y() - half, 2.0 * half, 2.0 * half)
        painter = theme.painter(self)
        _renderer(self._stage, theme.current()).render(painter, square)
        self._write_names(painter, box, half)

    def _write_names(self, painter: QPainter, box: QRectF, half: float) -> None:
        """Write the names of the parts on both sides, with lines to the parts."""
        painter.setFont(theme.font())
        metrics = QFontMetricsF(painter.font())
        colours, centre = theme.colours(), box.center()
        at = {k: centre + QPointF(x, y) * (half / _EXTENT) for k, (x, y) in _PARTS[self._stage].items()}
        for right in (False, True):
            keys = sorted((k for k in at if (at[k].x() >= centre.x()) is right), key=lambda k: at[k].y())
            heights = spread([at[k].y() for k in keys], metrics.height(), box.top(), box.bottom())
            for key, y in zip(keys, heights, strict=True):
                name = term("method", f"part_{key}")
                width = metrics.horizontalAdvance(name)
                edge = centre.x() + (half if right else -half)
                edge = min(edge, box.right() - width - 6) if right else max(edge, box.left() + width + 6)
                painter.setPen(QPen(QColor(colours.muted), 1))
                painter.drawLine(at[key], QPointF(edge, y))
                painter.setPen(QColor(colours.text))
                left = edge + 4 if right else edge - 4 - width
                painter.drawText(QPointF(left, y + 0.35 * metrics.ascent()), name)


@cache
def _renderer(stage: str, theme_name: str) -> QSvgRenderer:
    text, colours = (_FOLDER / f"{stage}.svg").read_text(encoding="utf-8"), theme.colours()
    for name, drawn in _SVG_COLOURS.items():
        dark_field = name == "field" and theme_name != "light"
        text = text.replace(drawn, colours.track if dark_field else getattr(colours, name))
    return QSvgRenderer(QByteArray(text.encode()))
