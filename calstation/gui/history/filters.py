"""Which runs are listed: a search as typed, an outcome, a period."""

from datetime import UTC, datetime, timedelta

from PySide6.QtCore import QTimer, Signal
from PySide6.QtWidgets import QComboBox, QLineEdit, QWidget

from calstation.gui.text import bind, on_language_change, term
from calstation.gui.widgets import label, row

_OUTCOMES = (None, "passed", "failed", "stopped", "fault", "incomplete")
_DAYS = (None, 1, 7, 30, 365)


class Filters(QWidget):
    """Emits `changed` when other runs are wanted."""

    changed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.search_edit, self._outcome, self._time = QLineEdit(), QComboBox(), QComboBox()
        self.search_edit.setObjectName("history_search_edit")
        self.search_edit.setClearButtonEnabled(True)
        bind(self.search_edit.setPlaceholderText, lambda: self.tr("Serial number, date, product, operator"))
        caption = label(lambda: self.tr("Search"), buddy=self.search_edit)
        self._outcome.setObjectName("history_outcome_combo")
        self._time.setObjectName("history_time_combo")
        for outcome in _OUTCOMES:
            self._outcome.addItem("", outcome)
        for days in _DAYS:
            self._time.addItem("", days)
        bind(self._outcome.setAccessibleName, lambda: self.tr("Outcome"))
        bind(self._time.setAccessibleName, lambda: self.tr("Time"))
        self._count = label(kind="muted")
        row(caption, (self.search_edit, 1), self._outcome, self._time, self._count, on=self)
        self._timer = QTimer(self, singleShot=True, interval=150)
        self._timer.timeout.connect(self.changed)
        self.search_edit.textChanged.connect(lambda _: self._timer.start())
        for combo in (self._outcome, self._time):
            combo.currentIndexChanged.connect(lambda _: self.changed.emit())
        on_language_change(self, self._name_entries)

    @property
    def search(self) -> str:
        """The text searched for."""
        return self.search_edit.text().strip()

    @property
    def outcome(self) -> str | None:
        """The outcome wanted, None for all."""
        return _OUTCOMES[self._outcome.currentIndex()]

    @property
    def since(self) -> str:
        """The earliest start wanted, ISO 8601 in UTC, "" for any."""
        days = _DAYS[self._time.currentIndex()]
        if days is None:
            return ""
        midnight = datetime.now().astimezone().replace(hour=0, minute=0, second=0, microsecond=0)
        return (midnight - timedelta(days=days - 1)).astimezone(UTC).isoformat()

    @property
    def active(self) -> bool:
        """Whether runs may be left out."""
        return bool(self.search or self.outcome or self.since)

    def clear(self) -> None:
        """List all runs."""
        self.search_edit.clear()
        self._outcome.setCurrentIndex(0)
        self._time.setCurrentIndex(0)

    def show_count(self, count: int, most: int) -> None:
        """Show the number of runs listed; from `most` on there may be more."""
        text = self.tr("the latest {0} runs") if count >= most else self.tr("runs: {0}")
        self._count.setText(text.format(count))

    def _name_entries(self) -> None:
        for index, outcome in enumerate(_OUTCOMES):
            self._outcome.setItemText(index, term("badge", outcome) if outcome else self.tr("Every outcome"))
        for index, days in enumerate(_DAYS):
            text = self.tr("Last {0} days").format(days)
            if days is None or days == 1:
                text = self.tr("Any time") if days is None else self.tr("Today")
            self._time.setItemText(index, text)
