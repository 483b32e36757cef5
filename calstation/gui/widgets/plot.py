"""A pyqtgraph plot in the window's colours, which follows its theme."""

import pyqtgraph as pg
from PySide6.QtCore import QEvent
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QWidget

from calstation.gui.widgets import theme

pg.setConfigOptions(antialias=False)


class ThemedPlot(pg.PlotWidget):  # type: ignore[misc]
    """An empty plot with two labelled axes."""

    _built = False

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent, enableMenu=False)
        self._built = True
        self.setMenuEnabled(False)
        self.hideButtons()
        for side in ("left", "bottom"):
            axis = self.getAxis(side)
            axis.setStyle(tickFont=theme.font())
            axis.label.setFont(theme.font())
            axis.enableAutoSIPrefix(False)
        self._dress()

    def changeEvent(self, event: QEvent) -> None:
        """Follow the theme."""
        if self._built and event.type() == QEvent.Type.PaletteChange:
            self._dress()
        super().changeEvent(event)

    def _dress(self) -> None:
        c = theme.colours()
        self.setBackground(QColor(c.panel))
        for side in ("left", "bottom"):
            self.getAxis(side).setPen(QColor(c.line))
            self.getAxis(side).setTextPen(QColor(c.text))
