"""A number box for sample counts, which outgrow 32 bits."""

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QAbstractSpinBox, QDoubleSpinBox, QWidget

#: Up to here a double, and so this box, holds every whole number.
LARGEST = 2**53


class CountSpin(QDoubleSpinBox):
    """Whole numbers up to 2^53; says a new value when it is entered, not at every key."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setDecimals(0)
        self.setRange(0, LARGEST)
        self.setKeyboardTracking(False)
        self.setButtonSymbols(QAbstractSpinBox.ButtonSymbols.NoButtons)
        self.setAlignment(Qt.AlignmentFlag.AlignRight)
        self.setStepType(QAbstractSpinBox.StepType.AdaptiveDecimalStepType)

    def value(self) -> int:
        """The count."""
        return round(super().value())
