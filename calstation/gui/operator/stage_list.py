"""The stages of a run as a list: number, name, state, progress and time left."""

from PySide6.QtCore import QModelIndex, QPersistentModelIndex, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QFont, QPainter
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

Index = QModelIndex | QPersistentModelIndex

_ROW = 7 * theme.GRID
#: Size of the shape of a state, and height of the progress bar, px.
_SHAPE, _BAR = 18, 3
_KINDS = {
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

    def sizeHint(self, option: QStyleOptionViewItem, index: Index) -> QSize:
        """All rows have the same height."""
        return QSize(24 * theme.GRID, _ROW)

    def paint(self, painter: QPainter, option: QStyleOptionViewItem, index: Index) -> None:
        """Shape and name at the left, state and time at the right, a progress bar below while it runs."""
        c, align = theme.colours(), Qt.AlignmentFlag
        box = QRectF(option.rect)
        kind, name, state, time = (index.data(role) for role in (_KIND, _NAME, _STATE, _TIME))
        active = kind == "active"
        inner = box.adjusted(2 * theme.GRID, 0, -2 * theme.GRID, 0)
        upper = inner.adjusted(0, 6, 0, -inner.height() / 2) if time else inner
        lower = inner.adjusted(0, inner.height() / 2, 0, -6) if state else inner

        def write(area: QRectF, side: Qt.AlignmentFlag, text: str, font: QFont, colour: str) -> None:
            painter.setFont(font)
            painter.setPen(QColor(colour))
            painter.drawText(area, side, text)

        painter.save()
        if active:
            painter.fillRect(box, QColor(c.window))
            bar = QRectF(box.left(), box.bottom() - _BAR, box.width() * index.data(_FRACTION), _BAR)
            painter.fillRect(bar, state_colour("active"))
        draw_state(painter, kind, QRectF(inner.left(), box.center().y() - _SHAPE / 2, _SHAPE, _SHAPE))
        text_box = inner.adjusted(_SHAPE + theme.GRID * 1.5, 0, 0, 0)
        write(text_box, align.AlignVCenter | align.AlignLeft, name, theme.font(theme.SECTION, bold=active), c.text)
        top = align.AlignBottom if time else align.AlignVCenter
        write(upper, align.AlignRight | top, state, theme.font(bold=active), c.text)
        bottom = align.AlignTop if state else align.AlignVCenter
        write(lower, align.AlignRight | bottom, time, theme.font(), c.muted)
        painter.setPen(QColor(c.line))
        painter.drawLine(box.bottomLeft(), box.bottomRight())
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
        column(title, (self.list, 1), self._left, self._note, on=self, spacing=0, margins=(1, 1, 1, theme.GRID))
        run.changed.connect(self.refresh)
        on_language_change(self, self.refresh)

    def plan(self, run_summary: RunSummary | None) -> None:
        """Show the next run while none is in progress."""
        self._planned = run_summary
        self.refresh()

    def refresh(self) -> None:
        """Show the run, or the next one."""
        planning = self._run.state == "idle"
        stages = self._run.stages
        if planning:
            stages = [] if self._planned is None else planned(self._planned)
        while self.list.count() > len(stages):
            self.list.takeItem(self.list.count() - 1)
        while self.list.count() < len(stages):
            item = QListWidgetItem(self.list)
            item.setFlags(Qt.ItemFlag.ItemIsEnabled)
        for number, stage in enumerate(stages):
            self._fill(self.list.item(number), f"{number + 1}  {term('stage', stage.name)}", stage, planning)
        self._show_left(stages, planning)

    def _fill(self, item: QListWidgetItem, name: str, stage: StageState, planning: bool) -> None:
        kind = _KINDS[stage.state]
        if kind == "active" and self._run.state in ("pausing", "paused"):
            kind = "paused"
        state, left = _state_text(stage), self._time_text(stage, planning)
        spoken = ", ".join(part for part in (name, state, left) if part)
        for role, value in (
            (_KIND, kind),
            (_NAME, name),
            (_STATE, state),
            (_TIME, left),
            (_FRACTION, stage.fraction),
            (Qt.ItemDataRole.AccessibleTextRole, spoken),
            (Qt.ItemDataRole.ToolTipRole, spoken),
        ):
            if item.data(role) != value:
                item.setData(role, value)

    def _time_text(self, stage: StageState, planning: bool) -> str:
        if stage.took is not None:
            return duration_text(stage.took)
        if stage.state not in ("waiting", "active"):
            return ""
        if not planning and not self._run.going:
            return self.tr("not run")
        pace = 1.0 if planning else self._run.pace
        return "" if pace is None else duration_text(self._run.left(stage) / pace)

    def _show_left(self, stages: list[StageState], planning: bool) -> None:
        left = note = ""
        if planning and stages:
            total = duration_text(sum(stage.duration for stage in stages))
            left = self.tr("{time} in all").format(time=total)
            if self._planned is not None and self._planned.virtual:
                note = self.tr("Times of a real table; the virtual bench is much faster.")
        elif (remaining := self._run.remaining) is not None:
            left = self.tr("{time} left").format(time=duration_text(remaining))
        for shown, text in ((self._left, left), (self._note, note)):
            shown.setText(text)
            shown.setVisible(bool(text))


def _state_text(stage: StageState) -> str:
    if stage.state == "active":
        return f"{100.0 * stage.fraction:.0f} %"
    return "" if stage.state == "waiting" else term("stage_state", stage.state)
