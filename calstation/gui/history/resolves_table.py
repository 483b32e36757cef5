"""Table of the recorded offline solutions of a run's log."""

from collections.abc import Sequence

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QAbstractItemView, QTableWidget, QTableWidgetItem, QWidget

from calstation.errors import CalstationError
from calstation.gui.text import bind, on_language_change, say, term
from calstation.gui.widgets import column, label, show_text, theme
from calstation.messages import local_time
from calstation.records import ResolveRecord

#: Height of a row, px, and number of rows visible without scrolling.
_ROW, _VISIBLE = 3 * theme.GRID + 4, 4


class ResolvesTable(QWidget):
    """Lists when, by whom and how a log was solved again, the latest first; hidden if there are no solutions."""

    def __init__(self) -> None:
        super().__init__()
        self._records: Sequence[ResolveRecord] = ()
        self._error: CalstationError | None = None
        caption = label("history.solved_again", "muted")
        self._problem = label(kind="caution", wrap=True)
        self.table = QTableWidget(0, 6)
        self.table.setObjectName("resolves_table")
        self.table.setFont(theme.font())
        self.table.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.table.setSelectionMode(QAbstractItemView.SelectionMode.NoSelection)
        self.table.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.table.setShowGrid(False)
        self.table.setWordWrap(False)
        self.table.verticalHeader().hide()
        self.table.verticalHeader().setDefaultSectionSize(_ROW)
        self.table.horizontalHeader().setHighlightSections(False)
        self.table.horizontalHeader().setDefaultAlignment(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter)
        bind(self.table.setAccessibleName, "history.offline_solutions")
        column(caption, self._problem, self.table, on=self, spacing=theme.GRID // 2)
        on_language_change(self, self._show)

    def show_records(self, records: Sequence[ResolveRecord], error: CalstationError | None) -> None:
        """Show the records of a log, the oldest first, or the error if they cannot be read."""
        self._records, self._error = records[::-1], error
        self._show()

    def _show(self) -> None:
        headings = (
            "common.time",
            "history.user",
            "history.largest_difference",
            "common.stages",
            "history.samples",
            "history.software",
        )
        table = self.table
        table.setHorizontalHeaderLabels([say(code) for code in headings])
        table.setRowCount(len(self._records))
        for number, record in enumerate(self._records):
            for k, text in enumerate(self._texts(record)):
                cell = QTableWidgetItem(text)
                cell.setToolTip(self._hint(record))
                table.setItem(number, k, cell)
        table.resizeColumnsToContents()
        rows = min(len(self._records), _VISIBLE)
        bars = table.horizontalHeader().sizeHint().height() + table.horizontalScrollBar().sizeHint().height()
        table.setFixedHeight(_ROW * rows + bars + 2)
        table.setVisible(bool(self._records))
        show_text(self._problem, "" if self._error is None else say(self._error.as_text))
        self.setVisible(bool(self._records) or self._error is not None)

    def _texts(self, record: ResolveRecord) -> tuple[str, ...]:
        stages = say("common.comma").join(term("stage", stage) for stage in record.stages)
        samples = f"{record.first_seq}–{record.last_seq}"
        return local_time(record.utc), record.by or "", self._difference(record), stages, samples, record.software

    def _difference(self, record: ResolveRecord) -> str:
        found = record.difference
        if found is None:
            return say("history.no_run_result")
        if found.identical:
            return say("history.identical")
        if not found.parameter:
            return say("history.no_common_parameter")
        size = "∞" if found.sigmas is None else f"{found.sigmas:.2f}"
        text = say("history.difference", sigmas=size, parameter=found.parameter)
        return say("history.trial", states=record.states_added, difference=text) if record.states_added else text

    def _hint(self, record: ResolveRecord) -> str:
        lines = [local_time(record.utc, zone=True)]
        if record.states_added:
            lines.append(say("history.states_added", states=", ".join(record.states_added)))
        lines.append(say("history.configuration", digest=record.configuration_sha256 or ""))
        return "\n".join(lines)
