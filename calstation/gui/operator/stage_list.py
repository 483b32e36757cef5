"""The stages of a run as a list: number, name, state, progress and time left."""

from PySide6.QtCore import QModelIndex, QPersistentModelIndex, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QPainter
from PySide6.QtWidgets import (
    QAbstractItemView,
    QFrame,
    QLabel,
    QListWidget,
    QListWidgetItem,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QWidget,
)

from calstation.config import RunSummary
from calstation.gui.shell import RunStatus, StageState, planned
from calstation.gui.text import duration_text, on_language_change, term
from calstation.gui.widgets import column, draw_state, label, state_colour, theme

_ROW = 7 * theme.GRID
_SHAPES = {
    "waiting": "none",
    "kept": "none",
    "active": "active",
    "solving": "active",
    "good": "good",
    "bad": "bad",
    "stopped": "stopped",
    "fault": "caution",
}
_KIND, _NAME, _STATE, _TIME, _FRACTION = (Qt.ItemDataRole.UserRole + i for i in range(5))


class _Row(QStyledItemDelegate):
    """Draws one stage."""

    def sizeHint(self, option: QStyleOptionViewItem, index: QModelIndex | QPersistentModelIndex) -> QSize:
        """All rows have the same height."""
        return QSize(24 * theme.GRID, _ROW)

    def paint(
        self,
        painter: QPainter,
        option: QStyleOptionViewItem,
        index: QModelIndex | QPersistentModelIndex,
    ) -> None:
        """Shape and name at the left, state and time at the right, a progress bar below while it runs."""
        c = theme.colours()
        box = QRectF(option.rect)
        kind, fraction = index.data(_KIND), index.data(_FRACTION)
        painter.save()
        if kind == "active":
            painter.fillRect(box, QColor(c.window))
        inner = box.adjusted(2 * theme.GRID, 0, -2 * theme.GRID, 0)
        draw_state(painter, kind, QRectF(inner.left(), box.center().y() - 9, 18, 18))
        painter.setPen(QColor(c.text))
        painter.setFont(theme.font(theme.SECTION, bold=kind == "active"))
        left = inner.adjusted(18 + theme.GRID * 1.5, 0, 0, 0)
        centre = Qt.AlignmentFlag.AlignVCenter
        painter.drawText(left, centre | Qt.AlignmentFlag.AlignLeft, index.data(_NAME))
        painter.setFont(theme.font(bold=kind == "active"))
        half = inner.height() / 2
        right = Qt.AlignmentFlag.AlignRight
        above = inner.adjusted(0, 6, 0, -half) if index.data(_TIME) else inner
        where = Qt.AlignmentFlag.AlignBottom if index.data(_TIME) else centre
        painter.drawText(above, right | where, index.data(_STATE))
        painter.setPen(QColor(c.muted))
        painter.setFont(theme.font())
        below = inner.adjusted(0, half, 0, -6) if index.data(_STATE) else inner
        where = Qt.AlignmentFlag.AlignTop if index.data(_STATE) else centre
        painter.drawText(below, right | where, index.data(_TIME))
        painter.setPen(QColor(c.line))
        painter.drawLine(box.bottomLeft(), box.bottomRight())
        if kind == "active":
            bar = QRectF(box.left(), box.bottom() - 3, box.width() * fraction, 3)
            painter.fillRect(bar, state_colour("active"))
        painter.restore()


class StageList(QFrame):
    """The list, and the time left for all of it below."""

    def __init__(self, run: RunStatus, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setProperty("kind", "panel")
        self._run = run
        self._planned: RunSummary | None = None
        title = label(lambda: self.tr("Stages"), "section")
        title.setContentsMargins(2 * theme.GRID, theme.GRID, 2 * theme.GRID, theme.GRID)
        self.list = QListWidget()
        self.list.setObjectName("stage_list")
        self.list.setItemDelegate(_Row(self.list))
        self.list.setFrameShape(QFrame.Shape.NoFrame)
        self.list.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.list.setSelectionMode(QAbstractItemView.SelectionMode.NoSelection)
        self.list.setVerticalScrollMode(QAbstractItemView.ScrollMode.ScrollPerPixel)
        self._left = QLabel()
        self._left.setFont(theme.font(theme.SECTION))
        self._left.setContentsMargins(2 * theme.GRID, theme.GRID, 2 * theme.GRID, 0)
        self._note = label(kind="muted", wrap=True)
        self._note.setContentsMargins(2 * theme.GRID, 0, 2 * theme.GRID, 0)
        items = (title, (self.list, 1), self._left, self._note)
        column(*items, on=self, spacing=0, margins=(1, 1, 1, theme.GRID))
        run.changed.connect(self.refresh)
        on_language_change(self, self.refresh)

    def plan(self, run_summary: RunSummary | None) -> None:
        """Show the next run while none is in progress."""
        self._planned = run_summary
        self.refresh()

    def refresh(self) -> None:
        """Show the run, or the next one."""
        planning = self._run.state == "idle"
        stages = ([] if self._planned is None else planned(self._planned)) if planning else self._run.stages
        while self.list.count() > len(stages):
            self.list.takeItem(self.list.count() - 1)
        for number, stage in enumerate(stages):
            item = self.list.item(number) if number < self.list.count() else None
            if item is None:
                item = QListWidgetItem()
                item.setFlags(Qt.ItemFlag.ItemIsEnabled)
                self.list.addItem(item)
            self._fill(item, number, stage, planning)
        self._show_left(stages, planning)

    def _fill(self, item: QListWidgetItem, number: int, stage: StageState, planning: bool) -> None:
        kind = _SHAPES[stage.state]
        if kind == "active" and self._run.state in ("pausing", "paused"):
            kind = "paused"
        name = f"{number + 1}  {term('stage', stage.name)}"
        state, left = self._state(stage), self._time(stage, planning)
        for role, value in ((_KIND, kind), (_NAME, name), (_STATE, state), (_TIME, left)):
            if item.data(role) != value:
                item.setData(role, value)
        item.setData(_FRACTION, stage.fraction)
        spoken = ", ".join(part for part in (name, state, left) if part)
        item.setData(Qt.ItemDataRole.AccessibleTextRole, spoken)
        item.setToolTip(spoken)

    def _state(self, stage: StageState) -> str:
        if stage.state == "active":
            return f"{100.0 * stage.fraction:.0f} %"
        return {
            "waiting": "",
            "kept": self.tr("not written"),
            "solving": self.tr("solving"),
            "good": self.tr("ok"),
            "bad": self.tr("not ok"),
            "stopped": self.tr("stopped"),
            "fault": self.tr("fault"),
        }[stage.state]

    def _time(self, stage: StageState, planning: bool) -> str:
        if stage.took is not None:
            return duration_text(stage.took)
        if stage.state not in ("waiting", "active"):
            return ""
        if not planning and not self._run.going:
            return self.tr("not run")
        pace = 1.0 if planning else self._run.pace
        if pace is None:
            return ""
        return duration_text(self._run.left(stage) / pace)

    def _show_left(self, stages: list[StageState], planning: bool) -> None:
        run_summary = self._planned if planning else self._run.run_summary
        virtual = run_summary is not None and run_summary.virtual
        if planning and stages:
            total = duration_text(sum(stage.duration for stage in stages))
            self._left.setText(self.tr("{time} in all").format(time=total))
        elif (remaining := self._run.remaining) is not None:
            self._left.setText(self.tr("{time} left").format(time=duration_text(remaining)))
        else:
            self._left.setText("")
        self._note.setText(
            self.tr("Times of a real table; the virtual bench is much faster.")
            if planning and virtual and stages
            else ""
        )
        self._left.setVisible(bool(self._left.text()))
        self._note.setVisible(bool(self._note.text()))
