"""Which runs are shown: a search as typed, an outcome, a time."""

from datetime import UTC, datetime, timedelta

from PySide6.QtCore import QEvent, QTimer, Signal
from PySide6.QtWidgets import QComboBox, QHBoxLayout, QLabel, QLineEdit, QWidget

from calstation.gui.text.messages import term
from calstation.gui.widgets import theme

_OUTCOMES = (None, "passed", "failed", "stopped", "fault", "incomplete")
_DAYS = (None, 1, 7, 30, 365)
#: After the last key and before the search, ms.
_TYPING = 150


class Filters(QWidget):
    """`changed()`: other runs are wanted."""

    changed = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._label = QLabel()
        self.search_edit = QLineEdit()
        self.search_edit.setObjectName("history_search_edit")
        self.search_edit.setClearButtonEnabled(True)
        self._label.setBuddy(self.search_edit)
        self.outcome_combo, self.time_combo = QComboBox(), QComboBox()
        self.outcome_combo.setObjectName("history_outcome_combo")
        self.time_combo.setObjectName("history_time_combo")
        for outcome in _OUTCOMES:
            self.outcome_combo.addItem("", outcome)
        for days in _DAYS:
            self.time_combo.addItem("", days)
        self.count_label = QLabel()
        self.count_label.setProperty("kind", "muted")
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(theme.GRID)
        row.addWidget(self._label)
        row.addWidget(self.search_edit, 1)
        row.addWidget(self.outcome_combo)
        row.addWidget(self.time_combo)
        row.addWidget(self.count_label)
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.setInterval(_TYPING)
        self._timer.timeout.connect(self.changed)
        self.search_edit.textChanged.connect(lambda _: self._timer.start())
        self.outcome_combo.currentIndexChanged.connect(lambda _: self.changed.emit())
        self.time_combo.currentIndexChanged.connect(lambda _: self.changed.emit())
        self.retranslate()

    @property
    def search(self) -> str:
        """What is searched for."""
        return self.search_edit.text().strip()

    @property
    def outcome(self) -> str | None:
        """The outcome wanted, None for all."""
        outcome: str | None = self.outcome_combo.currentData()
        return outcome

    @property
    def since(self) -> str:
        """The earliest start wanted, ISO 8601 in UTC, empty for any."""
        days = self.time_combo.currentData()
        if days is None:
            return ""
        midnight = datetime.now().astimezone().replace(hour=0, minute=0, second=0, microsecond=0)
        return (midnight - timedelta(days=days - 1)).astimezone(UTC).isoformat()

    @property
    def narrow(self) -> bool:
        """Whether anything is left out."""
        return bool(self.search or self.outcome or self.since)

    def clear(self) -> None:
        """Leave nothing out."""
        self.search_edit.clear()
        self.outcome_combo.setCurrentIndex(0)
        self.time_combo.setCurrentIndex(0)

    def show_count(self, count: int, most: int) -> None:
        """Say how many runs there are."""
        self.count_label.setText(
            self.tr("the latest {0} runs").format(count)
            if count >= most
            else self.tr("runs: {0}").format(count)
        )

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self._label.setText(self.tr("Search"))
        self.search_edit.setPlaceholderText(self.tr("Serial number, date, product, operator"))
        for index, outcome in enumerate(_OUTCOMES):
            self.outcome_combo.setItemText(
                index, self.tr("Every outcome") if outcome is None else term("badge", outcome)
            )
        times = (
            self.tr("Any time"),
            self.tr("Today"),
            self.tr("Last 7 days"),
            self.tr("Last 30 days"),
            self.tr("Last 365 days"),
        )
        for index, text in enumerate(times):
            self.time_combo.setItemText(index, text)
        self.outcome_combo.setAccessibleName(self.tr("Outcome"))
        self.time_combo.setAccessibleName(self.tr("Time"))

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)
