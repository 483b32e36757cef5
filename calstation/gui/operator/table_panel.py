"""The table's picture with its two angles, and whether it moves."""

import numpy as np
from PySide6.QtCore import QEvent, Qt
from PySide6.QtWidgets import QFrame, QGridLayout, QLabel, QVBoxLayout, QWidget

from calstation.gui.operator.table_picture import TablePicture
from calstation.gui.widgets import theme
from calstation.gui.widgets.badge import StateBadge
from calstation.sequencer.events import TableMoved


class TablePanel(QFrame):
    """Shows `TableMoved` events."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setProperty("kind", "panel")
        self.picture = TablePicture()
        self.badge = StateBadge()
        self._moved: TableMoved | None = None
        self._names = [QLabel(), QLabel()]
        self.angle_labels = [QLabel(), QLabel()]
        self._rates = [QLabel(), QLabel()]
        grid = QGridLayout()
        grid.setHorizontalSpacing(theme.GRID)
        grid.setVerticalSpacing(0)
        right = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        for row in range(2):
            self._rates[row].setProperty("kind", "muted")
            self.angle_labels[row].setFont(theme.font(theme.SECTION, bold=True))
            for column, label in enumerate((self._names[row], self.angle_labels[row], self._rates[row])):
                grid.addWidget(label, row, column, right if column else Qt.AlignmentFlag.AlignLeft)
        grid.setColumnStretch(1, 1)
        grid.setColumnMinimumWidth(2, 9 * theme.GRID)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(2 * theme.GRID, theme.GRID, 2 * theme.GRID, theme.GRID)
        layout.setSpacing(theme.GRID // 2)
        layout.addWidget(self.badge)
        layout.addWidget(self.picture, 1)
        layout.addLayout(grid)
        self.retranslate()

    def set_axes(self, outer: tuple[float, float, float], inner: tuple[float, float, float]) -> None:
        """The axes as unit vectors in b at home."""
        self.picture.set_axes(outer, inner)

    def take(self, moved: TableMoved) -> None:
        """Show where the table is."""
        self._moved = moved
        self.picture.set_angles(moved.outer, moved.inner)
        for label, angle in zip(self.angle_labels, (moved.outer, moved.inner), strict=True):
            label.setText(f"{np.rad2deg(angle):z.3f}°".replace("-", "−"))
        for label, rate in zip(self._rates, (moved.outer_rate, moved.inner_rate), strict=True):
            label.setText(f"{np.rad2deg(rate):z.1f} °/s".replace("-", "−"))
        self._say()

    def forget(self) -> None:
        """Nobody knows where the table is."""
        self._moved = None
        self.picture.set_angles(0.0, 0.0, known=False)
        for label in (*self.angle_labels, *self._rates):
            label.setText("–")
        self._say()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self._names[0].setText(self.tr("outer"))
        self._names[1].setText(self.tr("inner"))
        self._say()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def _say(self) -> None:
        if self._moved is None:
            self.badge.show_state("none", self.tr("table not connected"))
        elif self._moved.moving:
            self.badge.show_state("active", self.tr("table moving"))
        else:
            self.badge.show_state("stopped", self.tr("table at rest"))
