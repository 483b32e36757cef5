"""The first page of every run: how to load a unit, in four steps beside a picture of the table."""

from PySide6.QtCore import QEvent, Qt
from PySide6.QtWidgets import QFrame, QGridLayout, QHBoxLayout, QLabel, QVBoxLayout, QWidget

from calstation.config.summary import RunSummary
from calstation.gui.operator.position_panel import PositionPicture
from calstation.gui.operator.table_panel import TablePicture
from calstation.gui.widgets import theme


class Loading(QFrame):
    """Shown while nothing runs and no verdict stands."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setProperty("kind", "panel")
        self._run_summary: RunSummary | None = None
        self._title = QLabel()
        self._title.setProperty("kind", "section")
        self.picture = TablePicture()
        self.rails = PositionPicture()
        self.rails.setVisible(False)
        for picture in (self.picture, self.rails):
            picture.setMinimumSize(30 * theme.GRID, 30 * theme.GRID)
        self._numbers = [QLabel(str(i + 1)) for i in range(4)]
        self._names = [QLabel() for _ in range(4)]
        self._texts = [QLabel() for _ in range(4)]
        grid = QGridLayout()
        grid.setHorizontalSpacing(2 * theme.GRID)
        grid.setVerticalSpacing(0)
        for step in range(4):
            self._numbers[step].setFont(theme.font(theme.SECTION, bold=True))
            self._names[step].setFont(theme.font(theme.SECTION))
            self._texts[step].setProperty("kind", "muted")
            self._texts[step].setContentsMargins(0, 0, 0, 2 * theme.GRID)
            for label in (self._names[step], self._texts[step]):
                label.setWordWrap(True)
            grid.addWidget(self._numbers[step], 2 * step, 0, Qt.AlignmentFlag.AlignTop)
            grid.addWidget(self._names[step], 2 * step, 1)
            grid.addWidget(self._texts[step], 2 * step + 1, 1)
        grid.setColumnStretch(1, 1)
        words = QVBoxLayout()
        words.addStretch(1)
        words.addLayout(grid)
        words.addStretch(1)
        row = QHBoxLayout()
        row.setSpacing(4 * theme.GRID)
        row.addLayout(words, 3)
        row.addWidget(self.picture, 2)
        row.addWidget(self.rails, 2)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(3 * theme.GRID, 2 * theme.GRID, 3 * theme.GRID, 2 * theme.GRID)
        layout.addWidget(self._title)
        layout.addLayout(row, 1)
        self.retranslate()

    def plan(self, run_summary: RunSummary | None) -> None:
        """What the next run would be."""
        self._run_summary = run_summary
        if run_summary is not None:
            self.picture.set_axes(run_summary.outer_axis, run_summary.inner_axis)
            self.rails.set_plan(run_summary.outer_axis, run_summary.inner_axis, run_summary.positions)
            self.picture.setVisible(not run_summary.by_hand)
            self.rails.setVisible(run_summary.by_hand)
            load = [angle * 3.141592653589793 / 180.0 for angle in run_summary.load_angle]
            self.picture.set_angles(load[0], load[1])
        self.retranslate()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        virtual = self._run_summary is not None and self._run_summary.virtual
        carried = self._run_summary is not None and self._run_summary.by_hand
        self._title.setText(self.tr("Load the unit"))
        if carried and virtual:
            names = (
                self.tr("The unit is on its rails"),
                self.tr("A serial number is filled in"),
                self.tr("Press START"),
                self.tr("Watch"),
            )
            texts = (
                self.tr("This station is the virtual bench: unit, rails and hands are software."),
                self.tr("Any other number of the product's pattern is another unit."),
                self.tr("The bench's own hands turn the rails from position to position; you turn nothing."),
                self.tr("STOP works at any time, and so does the Esc key."),
            )
        elif carried:
            names = (
                self.tr("Fix the unit to the inner rail"),
                self.tr("Plug in its cable, both rails at 0°"),
                self.tr("Scan its serial number"),
                self.tr("Press START and let go"),
            )
            texts = (
                self.tr("x to the right, y to the front, z up, as in the picture; screws tight."),
                self.tr("It must reach through whole turns of both rails."),
                self.tr(
                    "The scanner's Enter checks the number and moves on to START; a click or Space starts."
                ),
                self.tr(
                    "The screen then asks for one position after another; STOP or Esc end it at any time."
                ),
            )
        elif virtual:
            names = (
                self.tr("The unit is in its fixture"),
                self.tr("A serial number is filled in"),
                self.tr("Press START"),
                self.tr("Watch"),
            )
            texts = (
                self.tr("This station is the virtual bench: table and unit are software, nothing moves."),
                self.tr("Any other number of the product's pattern is another unit."),
                self.tr("The whole calibration takes about a minute here."),
                self.tr("STOP works at any time, and so does the Esc key."),
            )
        else:
            names = (
                self.tr("Fix the unit in the fixture"),
                self.tr("Plug in its cable"),
                self.tr("Scan its serial number"),
                self.tr("Stand clear, then press START"),
            )
            texts = (
                self.tr("x to the right, y to the front, z up, as in the picture; screws tight."),
                self.tr("It must not catch when the table turns."),
                self.tr(
                    "The scanner's Enter checks the number and moves on to START; a click or Space starts."
                ),
                self.tr("STOP works at any time, and so does the Esc key."),
            )
        for label, text in zip((*self._names, *self._texts), (*names, *texts), strict=True):
            label.setText(text)

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)
