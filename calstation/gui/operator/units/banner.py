"""Banner with a verdict, its shape and the unit, in which the texts are fitted to the size of the banner."""

from functools import lru_cache

from PySide6.QtCore import QRectF, Qt
from PySide6.QtGui import QColor, QFontMetricsF, QPaintEvent, QResizeEvent
from PySide6.QtWidgets import QBoxLayout, QWidget

from calstation.gui.text import KINDS, term
from calstation.gui.widgets import draw_state, label, state_colour, theme

#: Margin at the right end, px, and minimum gap between the texts, as a multiple of the font size.
_RIGHT_MARGIN, _MIN_GAP = 3 * theme.GRID, 0.4
#: Maximum share of the width for the shape.
_SHAPE_SHARE = 0.25
#: Enlargement of the verdict above which the unit is placed below the verdict.
_MIN_ENLARGEMENT = 1.3


@lru_cache(maxsize=256)
def _width(text: str) -> float:
    """Return the width of a bold text as a multiple of the font size."""
    return QFontMetricsF(theme.font(theme.VERDICT, bold=True)).horizontalAdvance(text) / theme.VERDICT


class Banner(QWidget):
    """Banner with a verdict, its shape and the unit, on a background in the colour of the verdict.

    `height` is the minimum height, px. The object names of the labels are `name` with ``_label`` and ``_serial_label``.
    """

    def __init__(self, name: str, height: int) -> None:
        super().__init__()
        self._kind = "none"
        self.word, self.serial = label(name=f"{name}_label"), label(name=f"{name}_serial_label")
        self._texts = QBoxLayout(QBoxLayout.Direction.LeftToRight, self)
        self._texts.setSpacing(0)
        for stretch, widget in ((1, self.word), (0, self.serial)):
            self._texts.addWidget(widget, stretch)
            widget.setMinimumWidth(1)  # the text is fitted to the banner, not the banner to the text
        self.setMinimumHeight(height)

    def show_state(self, state: str, serial: str) -> None:
        """Show the text of a state and the unit, in the colours of the theme."""
        self._kind = KINDS.get(state, "none")
        for widget, text in ((self.word, term("badge", state)), (self.serial, serial)):
            widget.setText(text)
            style = f"color: {self._colours()[1]};"
            if widget.styleSheet() != style:  # setting the same style again would slowly polish the widget again
                widget.setStyleSheet(style)
        self._fit()
        self.update()

    def _colours(self) -> tuple[str, str]:
        """Return the colours of the background and of the texts."""
        c = theme.colours()
        return (c.alarm, c.on_alarm) if self._kind == "bad" else (state_colour(self._kind).name(), c.on_state)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Fit the texts to the banner."""
        super().resizeEvent(event)
        self._fit()

    def _shape_width(self) -> int:
        """Return the width of the column with the shape, px."""
        return min(self.height(), int(_SHAPE_SHARE * self.width()))

    def _fit(self) -> None:
        """Show the unit below the verdict if this makes the verdict much larger, otherwise both in one line."""
        room = self.width() - self._shape_width() - _RIGHT_MARGIN
        word, serial = (_width(widget.text()) for widget in (self.word, self.serial))
        size, alone = (
            min(0.55 * self.height(), room / (word + serial + _MIN_GAP)),
            min(0.4 * self.height(), room / max(word, serial, 1.0)),
        )
        below = alone > _MIN_ENLARGEMENT * size
        if below:
            size = alone
        self._texts.setDirection(QBoxLayout.Direction.TopToBottom if below else QBoxLayout.Direction.LeftToRight)
        self._texts.setStretch(1, int(below))  # each has half of the height
        self._texts.setContentsMargins(self._shape_width(), 0, _RIGHT_MARGIN, 0)
        self.word.setFont(theme.font(int(size), bold=True))
        self.serial.setFont(theme.font(int(min(size, room / max(serial, 1.0))), bold=True))
        self._texts.activate()  # the labels have the widths of their previous fonts until then

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the background and the shape."""
        painter = theme.painter(self)
        painter.setPen(Qt.PenStyle.NoPen)
        background, text = self._colours()
        painter.setBrush(QColor(background))
        painter.drawRoundedRect(QRectF(self.rect()), 4.0, 4.0)
        side = 0.6 * self._shape_width()
        left, top = (self._shape_width() - side) / 2.0, (self.height() - side) / 2.0
        draw_state(painter, self._kind, QRectF(left, top, side, side), QColor(text))
