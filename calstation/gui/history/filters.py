"""The filters of the list of runs: text, outcome, product, station, operator and dates."""

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from PySide6.QtCore import QDate, QLocale, QSignalBlocker, Qt, QTimer, Signal
from PySide6.QtGui import QTextCharFormat
from PySide6.QtWidgets import QCalendarWidget, QDateEdit, QSizePolicy, QWidget

from calstation.gui.text import Words, bind, language, on_language_change, product_text, say, station_text
from calstation.gui.widgets import column, combo_box, fill_combo, label, line_edit, row, theme
from calstation.messages import Text, local_time
from calstation.records import RunChoices, RunFilter

#: Choices for the runs whose result file differs from the log, and for the runs whose files are missing.
_ALTERED, _MISSING = "altered", "missing"
#: Choices that also list altered runs: an altered FAIL remains a FAIL, but an altered PASS is in doubt.
_ALSO_ALTERED = ("", _MISSING, "failed")
#: Verdicts that can be selected; "" for all.
_VERDICTS = {
    "": "history.every_outcome",
    **{name: f"badge.{name}" for name in ("passed", "partial", "failed", "stopped", "fault", "incomplete", _ALTERED)},
    _MISSING: f"badge.{_MISSING}",
}
#: Numbers of past days that can be selected; None for all runs, 0 for the dates that are entered.
_PERIODS: dict[int | None, Words] = {
    None: "history.any_time",
    1: "history.today",
    **{days: Text.of("common.last_days", days=days) for days in (7, 30, 365)},
    0: "history.dates",
}
_DATE = "yyyy-MM-dd"


class Filters(QWidget):
    """The inputs of the filters, which emit `changed`; the widget `beside` is shown next to the dates."""

    changed = Signal()

    def __init__(self, beside: QWidget) -> None:
        super().__init__()
        self._choices = RunChoices()
        self.search_edit = line_edit("history_search_edit", hint="history.search_placeholder")
        self.search_edit.setClearButtonEnabled(True)
        self.search_edit.setMinimumWidth(14 * theme.GRID)
        caption = label("history.search", buddy=self.search_edit)
        offered: dict[str, Mapping[Any, Words]] = {"outcome": _VERDICTS, "time": _PERIODS}
        self._verdict, self._period, self._product, self._station, self._operator = (
            combo_box(f"history_{name}_combo", offered.get(name, {}), characters=10)
            for name in ("outcome", "time", "product", "station", "operator")
        )
        self._from, self._to = self._date_edit("from"), self._date_edit("to")
        for widget, words in (
            (self._verdict, "history.outcome"),
            (self._product, "common.product"),
            (self._station, "common.station"),
            (self._operator, "common.operator"),
            (self._period, "common.time"),
            (self._from, "history.from_date"),
            (self._to, "history.to_date"),
        ):
            bind(widget.setAccessibleName, words)
        self._value_combos = self._verdict, self._product, self._station, self._operator
        values = ((combo, 2) for combo in self._value_combos)
        column(
            row(caption, (self.search_edit, 3), *values),
            row(self._period, self._from, label("history.to"), self._to, (beside, 1)),
            on=self,
        )
        self._timer = QTimer(self, singleShot=True, interval=150)
        self._timer.timeout.connect(self.changed)
        self.search_edit.textChanged.connect(lambda _: self._timer.start())
        for combo in self._value_combos:
            combo.currentIndexChanged.connect(lambda _: self.changed.emit())
        self._period.currentIndexChanged.connect(self._period_chosen)
        self._from.dateChanged.connect(lambda _: self._date_chosen(self._from, self._to))
        self._to.dateChanged.connect(lambda _: self._date_chosen(self._to, self._from))
        on_language_change(self, self._fill_combos)

    @property
    def conditions(self) -> RunFilter:
        """The conditions that runs must satisfy; dates are in the time zone of this computer."""
        days, verdict = self._period.currentData(), self._verdict.currentData()
        first, last = self._from.date(), self._to.date()
        if days:
            first = QDate.currentDate().addDays(1 - days)
        return RunFilter(
            search=self.search_edit.text().strip(),
            verdict="" if verdict in (_ALTERED, _MISSING) else verdict,
            altered=verdict == _ALTERED if verdict not in _ALSO_ALTERED else None,
            missing=verdict == _MISSING if verdict else None,
            product=self._product.currentData() or "",
            station=self._station.currentData() or "",
            operator=self._operator.currentData() or "",
            since="" if days is None else _midnight(first),
            before=_midnight(last.addDays(1)) if days == 0 else "",
        )

    def clear(self) -> None:
        """Reset all filters."""
        with QSignalBlocker(self):
            self.search_edit.clear()
            for combo in (*self._value_combos, self._period):
                combo.setCurrentIndex(0)
        self.changed.emit()

    def show_choices(self, choices: RunChoices) -> None:
        """Offer these values, and keep the selection."""
        if choices != self._choices:
            self._choices = choices
            self._fill_combos()
        self._show_dates()

    def _date_edit(self, name: str) -> QDateEdit:
        edit = QDateEdit(QDate.currentDate())
        edit.setObjectName(f"history_{name}_edit")
        edit.setCalendarPopup(True)
        edit.setDisplayFormat(_DATE)
        edit.setKeyboardTracking(False)
        edit.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Fixed)
        calendar = edit.calendarWidget()
        calendar.setVerticalHeaderFormat(QCalendarWidget.VerticalHeaderFormat.NoVerticalHeader)
        calendar.setMinimumSize(36 * theme.GRID, 32 * theme.GRID)
        for day in (Qt.DayOfWeek.Saturday, Qt.DayOfWeek.Sunday):
            calendar.setWeekdayTextFormat(day, QTextCharFormat())  # weekends must not be red, the colour of failures
        return edit

    def _period_chosen(self) -> None:
        self._show_dates()
        self.changed.emit()

    def _date_chosen(self, changed: QDateEdit, other: QDateEdit) -> None:
        """Filter by the dates; if they are not in order, set the other date to the changed one."""
        if self._from.date() > self._to.date():
            with QSignalBlocker(other):
                other.setDate(changed.date())
        with QSignalBlocker(self._period):
            self._period.setCurrentIndex(list(_PERIODS).index(0))
        self._show_dates()
        self._timer.start()

    def _show_dates(self) -> None:
        """Show the dates of the selected period, muted unless they were entered."""
        days, today = self._period.currentData(), QDate.currentDate()
        for edit in (self._from, self._to):
            theme.set_kind(edit, "" if days == 0 else "muted")
        if days == 0:
            return
        earliest = QDate.fromString(local_time(self._choices.first_utc)[:10], _DATE)
        first = today.addDays(1 - days) if days else earliest
        for edit, day in ((self._from, first if first.isValid() else today), (self._to, today)):
            with QSignalBlocker(edit):
                edit.setDate(day)

    def _fill_combos(self) -> None:
        choices = self._choices
        products = ((product_text(name), name) for name in choices.products)
        fill_combo(self._product, [(say("history.every_product"), ""), *products])
        stations = ((station_text(name), name) for name in choices.stations)
        fill_combo(self._station, [(say("history.every_station"), ""), *stations])
        operators = ((name, name) for name in choices.operators)
        fill_combo(self._operator, [(say("history.every_operator"), ""), *operators])
        locale = QLocale(QLocale.Language.Chinese if language.current() == "zh_CN" else QLocale.Language.English)
        for edit in (self._from, self._to):
            edit.setLocale(locale)
            edit.calendarWidget().setLocale(locale)


def _midnight(day: QDate) -> str:
    """Return the UTC time at which a local day starts, in ISO 8601 without an offset."""
    begin = datetime(day.year(), day.month(), day.day()).astimezone(UTC)
    return begin.replace(tzinfo=None).isoformat()
