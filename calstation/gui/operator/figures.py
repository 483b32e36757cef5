"""Table of the values of a result that are nearest to their limits."""

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QGridLayout, QLabel, QWidget

from calstation.gui.operator import advice
from calstation.gui.widgets import StateIcon, clear, label, theme
from calstation.physics import aligned
from calstation.results import Result

#: Most height of a row, px.
_ROW = 4 * theme.GRID


class FiguresTable(QWidget):
    """One row per parameter group and per check of the product, with the deciding number in bold."""

    def __init__(self, size: int = theme.BODY) -> None:
        super().__init__()
        self._size = size
        self._grid = QGridLayout(self)
        self._grid.setContentsMargins(0, 0, 0, 0)
        self._grid.setHorizontalSpacing(2 * theme.GRID)
        self._grid.setVerticalSpacing(theme.GRID // 4)

    def show_result(self, result: Result | None) -> None:
        """Show the figures of a result; none without one."""
        clear(self._grid)
        figures = [] if result is None else advice.figures(result)
        if not figures:
            return
        headings = (
            self.tr("nearest to its limit"),
            self.tr("value"),
            self.tr("sigma"),
            self.tr("limit"),
            self.tr("unit"),
        )
        for at, text in enumerate(headings, start=1):
            heading = label(kind="muted")
            heading.setText(text)
            self._place(heading, 0, at)
        values, sigmas = aligned([figure.value for figure in figures]), aligned([figure.sigma for figure in figures])
        for number, (figure, value, sigma) in enumerate(zip(figures, values, sigmas, strict=True), start=1):
            icon = StateIcon(self._size)
            icon.set_kind("bad" if not figure.passed else "caution" if figure.near else "good")
            self._grid.addWidget(icon, number, 0)
            deciding = 3 if figure.by_sigma else 2
            for at, text in enumerate((figure.name, value, sigma, figure.limit, figure.unit), start=1):
                cell = QLabel(text)
                cell.setFont(theme.font(self._size, bold=at == deciding))
                self._place(cell, number, at)
        self.setMaximumHeight(_ROW * (len(figures) + 1))

    def _place(self, cell: QLabel, row: int, column: int) -> None:
        side = Qt.AlignmentFlag.AlignRight if column in (2, 3, 4) else Qt.AlignmentFlag.AlignLeft
        self._grid.addWidget(cell, row, column, side | Qt.AlignmentFlag.AlignVCenter)
