"""Picture of a product in its fixture."""

from pathlib import Path

from PySide6.QtCore import QRectF, QSizeF, Qt
from PySide6.QtGui import QColor, QPaintEvent, QPixmap
from PySide6.QtSvg import QSvgRenderer
from PySide6.QtWidgets import QWidget

from calstation.gui.widgets import theme


class FixturePicture(QWidget):
    """Shows an SVG, PNG or JPEG file as large as possible, on a white background in both themes."""

    def __init__(self) -> None:
        super().__init__()
        self._path: Path | None = None
        self._drawing, self._photo = QSvgRenderer(), QPixmap()

    def show_file(self, path: Path | None) -> None:
        """Show a file, or hide the picture if there is none."""
        self._path = path
        if path is not None and path.suffix == ".svg":
            self._drawing.load(str(path))
        else:
            self._photo.load("" if path is None else str(path))
        self.setVisible(path is not None)
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the picture in the middle."""
        if self._path is None:
            return
        vector = self._path.suffix == ".svg"
        size = QSizeF(self._drawing.defaultSize() if vector else self._photo.size())
        size.scale(QSizeF(self.size()), Qt.AspectRatioMode.KeepAspectRatio)
        box = QRectF(0.0, 0.0, size.width(), size.height())
        box.moveCenter(QRectF(self.rect()).center())
        painter = theme.painter(self)
        painter.setRenderHint(painter.RenderHint.SmoothPixmapTransform)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(QColor("#ffffff"))
        painter.drawRoundedRect(box, 4.0, 4.0)
        if vector:
            self._drawing.render(painter, box)
        else:
            painter.drawPixmap(box, self._photo, QRectF(self._photo.rect()))
