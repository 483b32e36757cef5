"""Instructions for loading a unit in four steps, next to a picture of the unit or the table."""

from pathlib import Path

import numpy as np
from PySide6.QtCore import QRectF, QSizeF, Qt
from PySide6.QtGui import QColor, QPaintEvent, QPixmap
from PySide6.QtSvg import QSvgRenderer
from PySide6.QtWidgets import QFrame, QWidget

from calstation.gui.operator.live import PositionPicture, TablePicture
from calstation.gui.text import on_language_change, rendered
from calstation.gui.widgets import PlainLabel, column, grid, label, row, theme
from calstation.messages import Text
from calstation.runs import RunSummary

#: Number of the step that differs in a chamber, by situation.
_CHAMBER_STEPS = {"driven": 4, "virtual_driven": 3}
#: Number of the step about the serial number at a virtual bench.
_SERIAL_STEP = 2


class FixturePicture(QWidget):
    """A picture from an SVG, PNG or JPEG file, drawn as large as possible on a white background in both themes."""

    def __init__(self) -> None:
        super().__init__()
        self._path: Path | None = None
        self._drawing, self._photo = QSvgRenderer(), QPixmap()

    def show_file(self, path: Path | None) -> None:
        """Show a file; None hides the picture."""
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


class Loading(QFrame):
    """Loading instructions, displayed before a run."""

    def __init__(self) -> None:
        super().__init__()
        self.setProperty("kind", "panel")
        self._situation, self._in_chamber, self._serial, self._entered = "driven", False, "", ""
        self.picture, self.rails, self.fixture = TablePicture(), PositionPicture(), FixturePicture()
        for picture in (self.picture, self.rails, self.fixture):
            picture.setMinimumSize(30 * theme.GRID, 30 * theme.GRID)
        self._titles = [label(wrap=True) for _ in range(4)]
        self._texts = [label(kind="muted", wrap=True) for _ in range(4)]
        steps = grid(across=2 * theme.GRID, down=0, stretch=1)
        for step, (title, text) in enumerate(zip(self._titles, self._texts, strict=True)):
            number = PlainLabel(str(step + 1))
            number.setFont(theme.font(theme.SECTION, bold=True))
            title.setFont(theme.font(theme.SECTION))
            text.setContentsMargins(0, 0, 0, 2 * theme.GRID)
            steps.addWidget(number, 2 * step, 0, Qt.AlignmentFlag.AlignTop)
            steps.addWidget(title, 2 * step, 1)
            steps.addWidget(text, 2 * step + 1, 1)
        pictures = ((self.picture, 2), (self.rails, 2), (self.fixture, 2))
        drawings = row((column(None, steps, None), 3), *pictures, spacing=4 * theme.GRID)
        column(
            label("operator.load_unit", "section"),
            (drawings, 1),
            on=self,
            margins=(3 * theme.GRID, 2 * theme.GRID, 3 * theme.GRID, 2 * theme.GRID),
        )
        on_language_change(self, self._refresh)

    def set_next_run(self, run_summary: RunSummary | None) -> None:
        """Show how to load a unit for the next run."""
        self._situation = "driven"
        self._in_chamber = run_summary is not None and run_summary.over_temperature
        self._serial = "" if run_summary is None else run_summary.fixed_serial
        by_hand = run_summary is not None and run_summary.by_hand
        picture_file = None if run_summary is None else run_summary.picture
        self.fixture.show_file(picture_file)
        self.picture.setVisible(picture_file is None and not by_hand)
        self.rails.setVisible(picture_file is None and by_hand)
        if run_summary is not None:
            self.picture.set_axes(run_summary.outer_axis, run_summary.inner_axis)
            self.picture.set_joints(run_summary.joint_order, known=True)
            if not run_summary.joint_order:
                self.picture.set_angles(*np.deg2rad(run_summary.load_angle).tolist())
            self.rails.set_plan(run_summary)
            table = "manual" if by_hand else "driven"
            self._situation = f"virtual_{table}" if run_summary.virtual else table
        self._refresh()

    def show_serial(self, entered: str) -> None:
        """Show whether a serial number is in the field."""
        if entered != self._entered:
            self._entered = entered
            self._refresh()

    def _refresh(self) -> None:
        for number, (title, text) in enumerate(zip(self._titles, self._texts, strict=True), start=1):
            chamber = self._in_chamber and number == _CHAMBER_STEPS.get(self._situation)
            step = rendered(Text(f"loading.{self._situation}_{'chamber' if chamber else number}"))
            if self._situation.startswith("virtual") and number == _SERIAL_STEP:
                if self._serial:
                    entered = "fixed" if self._entered == self._serial else "enter_fixed"
                    step = rendered(Text.of(f"loading.virtual_{entered}_serial", serial=self._serial))
                elif not self._entered:
                    step = rendered(Text("loading.virtual_no_serial"))
            title.setText(step.text)
            text.setText(step.remedy)
