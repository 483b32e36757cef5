"""Makes a recording on the virtual bench: the grade of its units, and the number that draws them."""

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QComboBox, QHBoxLayout, QLabel, QPushButton, QSpinBox, QWidget

from calstation.gui.text import on_language_change
from calstation.gui.widgets import theme

GRADES = ("mems", "tactical", "nav")
_MOST = 9999


class BenchBox(QWidget):
    """`wanted(grade, seed)`: a recording is to be made."""

    wanted = Signal(str, int)

    def __init__(self, stage: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._caption, self._seed_caption = QLabel(), QLabel()
        self.grade_combo = QComboBox()
        self.grade_combo.setObjectName(f"bench_grade_{stage}")
        self.grade_combo.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToContents)
        for grade in GRADES:
            self.grade_combo.addItem("", grade)
        self.seed_spin = QSpinBox()
        self.seed_spin.setObjectName(f"bench_seed_{stage}")
        self.seed_spin.setRange(1, _MOST)
        self.make_button = QPushButton()
        self.make_button.setObjectName(f"bench_make_{stage}")
        self.make_button.clicked.connect(
            lambda: self.wanted.emit(self.grade_combo.currentData(), self.seed_spin.value())
        )
        self._caption.setBuddy(self.grade_combo)
        self._seed_caption.setBuddy(self.seed_spin)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(theme.GRID)
        for widget in (self._caption, self.grade_combo, self._seed_caption, self.seed_spin, self.make_button):
            row.addWidget(widget)
        on_language_change(self, self.retranslate)

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self._caption.setText(self.tr("Virtual bench"))
        names = {
            "mems": self.tr("MEMS grade"),
            "tactical": self.tr("tactical grade"),
            "nav": self.tr("navigation grade"),
        }
        for index, grade in enumerate(GRADES):
            self.grade_combo.setItemText(index, names[grade])
        self._seed_caption.setText(self.tr("unit"))
        self.seed_spin.setToolTip(self.tr("Another number draws another unit and other motions"))
        self.make_button.setText(self.tr("Make one"))
        self.make_button.setToolTip(self.tr("Makes a recording without hardware, with its truth beside it"))
