"""What a log is in one line, and the buttons that zoom it."""

from PySide6.QtCore import QEvent, QRectF, Qt, Signal
from PySide6.QtGui import QPainter, QPaintEvent, QPixmap
from PySide6.QtWidgets import QHBoxLayout, QLabel, QPushButton, QSizePolicy, QWidget

from calstation.gui.logs.marks import draw_sign
from calstation.gui.text import duration_text
from calstation.gui.widgets import theme
from calstation.results.plots import LogIndex

_SIGN = 12


class LogHead(QWidget):
    """`zoomed(closer)`, `whole()`, `to_range()`: what the buttons ask of the plot."""

    zoomed = Signal(bool)
    whole = Signal()
    to_range = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._log_index: LogIndex | None = None
        self._facts = _Elided()
        self._signs = {kind: (QLabel(), QLabel()) for kind in ("gap", "spoilt", "damaged")}
        self._buttons = {
            name: QPushButton()
            for name in ("zoom_in_button", "zoom_out_button", "zoom_range_button", "zoom_all_button")
        }
        words = QHBoxLayout()
        words.setSpacing(theme.GRID)
        words.addWidget(self._facts, 1)
        for icon, text in self._signs.values():
            words.addWidget(icon)
            words.addWidget(text)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(theme.GRID)
        row.addLayout(words, 1)
        for name, button in self._buttons.items():
            button.setObjectName(name)
            row.addWidget(button)
        for name, sign in (("zoom_in_button", "+"), ("zoom_out_button", "−")):
            self._buttons[name].setText(sign)
            self._buttons[name].setFixedWidth(theme.BUTTON)
            self._buttons[name].setStyleSheet("padding: 0")
        self._buttons["zoom_in_button"].clicked.connect(lambda: self.zoomed.emit(True))
        self._buttons["zoom_out_button"].clicked.connect(lambda: self.zoomed.emit(False))
        self._buttons["zoom_range_button"].clicked.connect(self.to_range)
        self._buttons["zoom_all_button"].clicked.connect(self.whole)
        self.retranslate()

    def show_log(self, log_index: LogIndex) -> None:
        """Say what a log is."""
        self._log_index = log_index
        self.retranslate()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        for name, tip in (
            ("zoom_in_button", self.tr("Closer (+)")),
            ("zoom_out_button", self.tr("Further away (−)")),
            ("zoom_range_button", self.tr("Bring the chosen range into view")),
            ("zoom_all_button", self.tr("Bring the whole log into view (Home)")),
        ):
            self._buttons[name].setToolTip(tip)
            self._buttons[name].setAccessibleName(tip)
        self._buttons["zoom_range_button"].setText(self.tr("Range"))
        self._buttons["zoom_all_button"].setText(self.tr("All"))
        log = self._log_index
        if log is None:
            return
        facts = log.facts
        parts = [log.meta.imu.serial]
        parts.append(duration_text(facts.samples / log.rate))
        parts.append(self.tr("{0} samples, {1} Hz").format(f"{facts.samples:,}".replace(",", " "), f"{log.rate:g}"))
        if log.meta.product is not None:  # last, because what does not fit is cut
            parts.append(log.meta.product.name)
        self._facts.setText("  ·  ".join(parts))
        self._facts.setToolTip(self._facts.text())
        for kind, count, word in (
            ("gap", log.gaps.count, self.tr("gaps: {0}")),
            ("spoilt", log.spoilt_samples, self.tr("spoilt samples: {0}")),
            ("damaged", facts.damaged, self.tr("damaged rows: {0}")),
        ):
            icon, text = self._signs[kind]
            icon.setPixmap(_sign(kind))
            text.setText(word.format(count))
            for label in (icon, text):
                label.setVisible(count > 0)

    def changeEvent(self, event: QEvent) -> None:
        """Follow language and theme."""
        if event.type() in (QEvent.Type.LanguageChange, QEvent.Type.PaletteChange):
            self.retranslate()
        super().changeEvent(event)


class _Elided(QLabel):
    """A label that gives way, and says with dots that it did."""

    def __init__(self) -> None:
        super().__init__()
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw as much as there is room for."""
        text = self.fontMetrics().elidedText(self.text(), Qt.TextElideMode.ElideRight, self.width())
        QPainter(self).drawText(self.rect(), Qt.AlignmentFlag.AlignVCenter, text)


def _sign(kind: str) -> QPixmap:
    picture = QPixmap(2 * _SIGN, 2 * _SIGN)
    picture.setDevicePixelRatio(2)
    picture.fill(Qt.GlobalColor.transparent)
    painter = QPainter(picture)
    draw_sign(painter, kind, QRectF(0, 0, _SIGN, _SIGN))
    painter.end()
    return picture
