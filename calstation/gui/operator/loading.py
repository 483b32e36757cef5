"""How to load a unit, in four steps beside a drawing of the table; shown before a run."""

import numpy as np
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QFrame, QGridLayout, QLabel, QWidget

from calstation.config import RunSummary
from calstation.gui.operator.position_panel import PositionPicture
from calstation.gui.operator.table_panel import TablePicture
from calstation.gui.text import on_language_change
from calstation.gui.widgets import column, label, row, theme

_STEPS = 4


class Loading(QFrame):
    """Shown while nothing runs and there is no verdict."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setProperty("kind", "panel")
        self._run_summary: RunSummary | None = None
        self.picture = TablePicture()
        self.rails = PositionPicture()
        self.rails.setVisible(False)
        for picture in (self.picture, self.rails):
            picture.setMinimumSize(30 * theme.GRID, 30 * theme.GRID)
        self._names = [label(wrap=True) for _ in range(_STEPS)]
        self._texts = [label(kind="muted", wrap=True) for _ in range(_STEPS)]
        grid = QGridLayout()
        grid.setHorizontalSpacing(2 * theme.GRID)
        grid.setVerticalSpacing(0)
        for step, (name, text) in enumerate(zip(self._names, self._texts, strict=True)):
            number = QLabel(str(step + 1))
            number.setFont(theme.font(theme.SECTION, bold=True))
            name.setFont(theme.font(theme.SECTION))
            text.setContentsMargins(0, 0, 0, 2 * theme.GRID)
            grid.addWidget(number, 2 * step, 0, Qt.AlignmentFlag.AlignTop)
            grid.addWidget(name, 2 * step, 1)
            grid.addWidget(text, 2 * step + 1, 1)
        grid.setColumnStretch(1, 1)
        column(
            label(lambda: self.tr("Load the unit"), "section"),
            (
                row((column(None, grid, None), 3), (self.picture, 2), (self.rails, 2), spacing=4 * theme.GRID),
                1,
            ),
            on=self,
            margins=(3 * theme.GRID, 2 * theme.GRID, 3 * theme.GRID, 2 * theme.GRID),
        )
        on_language_change(self, self._refresh)

    def plan(self, run_summary: RunSummary | None) -> None:
        """Show how to load a unit for the next run."""
        self._run_summary = run_summary
        if run_summary is not None:
            self.picture.set_axes(run_summary.outer_axis, run_summary.inner_axis)
            self.picture.set_angles(*np.deg2rad(run_summary.load_angle).tolist())
            self.rails.set_plan(run_summary.outer_axis, run_summary.inner_axis, run_summary.positions)
            self.picture.setVisible(not run_summary.by_hand)
            self.rails.setVisible(run_summary.by_hand)
        self._refresh()

    def _refresh(self) -> None:
        for name, text, (name_words, text_words) in zip(self._names, self._texts, self._steps(), strict=True):
            name.setText(name_words)
            text.setText(text_words)

    def _steps(self) -> tuple[tuple[str, str], ...]:
        """Name and text of each step."""
        planned = self._run_summary
        virtual, by_hand = planned is not None and planned.virtual, planned is not None and planned.by_hand
        another = self.tr("Any other number of the product's pattern is another unit.")
        scan = self.tr("The scanner's Enter checks the number and moves on to START; a click or Space starts.")
        mounting = self.tr("x to the right, y to the front, z up, as in the picture; screws tight.")
        stop = self.tr("STOP works at any time, and so does the Esc key.")
        if by_hand and virtual:
            return (
                (
                    self.tr("The unit is on its rails"),
                    self.tr("This station is the virtual bench: unit, rails and operator are simulated."),
                ),
                (self.tr("A serial number is filled in"), another),
                (
                    self.tr("Press START"),
                    self.tr("The simulated operator turns the rails from position to position."),
                ),
                (self.tr("Watch"), stop),
            )
        if by_hand:
            return (
                (self.tr("Fix the unit to the inner rail"), mounting),
                (
                    self.tr("Plug in its cable, both rails at 0°"),
                    self.tr("It must reach through whole turns of both rails."),
                ),
                (self.tr("Scan its serial number"), scan),
                (
                    self.tr("Press START and let go"),
                    self.tr("The screen then asks for one position after another; STOP or Esc end it at any time."),
                ),
            )
        if virtual:
            return (
                (
                    self.tr("The unit is in its fixture"),
                    self.tr("This station is the virtual bench: table and unit are simulated, nothing moves."),
                ),
                (self.tr("A serial number is filled in"), another),
                (self.tr("Press START"), self.tr("The whole calibration takes about a minute here.")),
                (self.tr("Watch"), stop),
            )
        return (
            (self.tr("Fix the unit in the fixture"), mounting),
            (self.tr("Plug in its cable"), self.tr("It must not catch when the table turns.")),
            (self.tr("Scan its serial number"), scan),
            (self.tr("Stand clear, then press START"), stop),
        )
