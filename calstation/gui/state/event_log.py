"""The event log of a run: stages and why they ended, pauses, repeated steps, warnings and faults with their times."""

import time
from collections.abc import Sequence

from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QShowEvent

from calstation.gui.state.engine_link import EngineLink
from calstation.gui.text import duration_text, event_line, on_language_change
from calstation.gui.widgets import Cell, CellTable
from calstation.messages import local_time
from calstation.results import TimedEvent
from calstation.sequencer import LOSSY, Event

#: Time from an event to its display, ms, so that events in quick succession are displayed together.
_REFRESH_MS = 100
_CLOCK, _TIME, _SLOT, _EVENT = (
    Cell("event_log.clock", "clock", number=False, hint="utc"),
    Cell("common.time", "time"),
    Cell("history.slot", "slot", number=False),
    Cell("event_log.column_event", "event", number=False, state="state", hint="event"),
)


class EventLog(CellTable):
    """A table of the events of a run, the latest last, with the time since its first event."""

    def __init__(self, name: str) -> None:
        self._events: list[TimedEvent] = []
        self._started_at = 0.0
        self._timer = QTimer(singleShot=True, interval=_REFRESH_MS)
        self._timer.timeout.connect(self._refresh)
        super().__init__(name, "event_log.title", (_TIME, _EVENT), named=False)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)  # the keys of a scan must not go to the table
        on_language_change(self, self._refresh)

    def follow(self, link: EngineLink) -> None:
        """Show the events of the current run as they happen."""
        link.running_changed.connect(self._running_changed)
        link.event.connect(self._add)

    def show_events(self, events: Sequence[TimedEvent]) -> None:
        """Show these events."""
        self._events = list(events)
        self._refresh()

    def showEvent(self, event: QShowEvent) -> None:
        """Show the events that have happened while the table was hidden."""
        super().showEvent(event)
        self._refresh()

    def fit_columns(self) -> None:
        """Give the remaining width to the column of sentences."""
        self.resizeColumnsToContents()
        last = self.parameters.columnCount() - 1
        used = sum(self.columnWidth(i) for i in range(last))
        self.setColumnWidth(last, max(self.columnWidth(last), self.viewport().width() - used))

    def _running_changed(self, running: bool) -> None:
        if running:
            self._started_at = time.monotonic()
            self.show_events(())

    def _add(self, event: Event) -> None:
        if not isinstance(event, LOSSY):
            self._events.append(TimedEvent(time.monotonic() - self._started_at, event))
            if self.isVisible() and not self._timer.isActive():
                self._timer.start()

    def _refresh(self) -> None:
        bar = self.verticalScrollBar()
        at_end = bar.value() == bar.maximum()
        clock = (_CLOCK,) if any(each.utc for each in self._events) else ()
        slot = (_SLOT,) if any(each.event.slot for each in self._events) else ()
        rows = {}
        for number, each in enumerate(self._events):
            state, sentence = event_line(each.event, followed=number + 1 < len(self._events))
            if sentence:
                time_text = "–" if each.seconds is None else duration_text(each.seconds)
                utc = local_time(each.utc, zone=True) if each.utc else ""
                rows[str(number)] = {
                    "clock": utc[11:19],  # without the date, which is that of the run
                    "utc": utc,
                    "time": time_text,
                    "slot": each.event.slot,
                    "event": sentence,
                    "state": state,
                }
        self.show_cells(rows, columns=(*clock, _TIME, *slot, _EVENT))
        if at_end:
            self.scrollToBottom()
