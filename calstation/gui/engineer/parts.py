"""What is calibrated: three big parts, or single stages in any order."""

from PySide6.QtCore import QEvent, QObject, Qt, Signal
from PySide6.QtWidgets import QCheckBox, QFrame, QHBoxLayout, QLabel, QToolButton, QVBoxLayout, QWidget

from calstation.gui.text.messages import term
from calstation.gui.widgets import theme

#: Stages of each part, by the part's object name's end.
PARTS = {
    "scale_factors": ("rate", "six_position"),
    "installation": ("excitation",),
    "biases": ("azimuth_flip",),
}


class Parts(QWidget):
    """Check boxes of parts and stages; `changed` when the choice or its order does, `looked_at` for a stage's row."""

    changed = Signal()
    looked_at = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._rows: list[_StageRow] = []
        self._current = ""
        self._title = QLabel()
        self._title.setProperty("kind", "section")
        self._parts = {name: QCheckBox() for name in PARTS}
        self._hint = QLabel()
        self._hint.setProperty("kind", "muted")
        self._list = QVBoxLayout()
        self._list.setSpacing(0)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addWidget(self._title)
        for name, check in self._parts.items():
            check.setObjectName(f"part_check_{name}")
            check.setMinimumHeight(theme.BUTTON - theme.GRID)
            check.setFont(theme.font(theme.SECTION))
            check.clicked.connect(lambda _=False, part=name: self._choose_part(part))
            column.addWidget(check)
        column.addSpacing(theme.GRID)
        column.addWidget(self._hint)
        column.addLayout(self._list)
        self.retranslate()

    @property
    def stages(self) -> tuple[str, ...]:
        """The stages chosen, in their order."""
        return tuple(row.stage for row in self._rows if row.check.isChecked())

    @property
    def order(self) -> tuple[str, ...]:
        """All stages offered, in the order shown."""
        return tuple(row.stage for row in self._rows)

    @property
    def current(self) -> str:
        """The stage looked at."""
        return self._current

    def offer(self, stages: tuple[str, ...], chosen: tuple[str, ...]) -> None:
        """Offer these stages, `chosen` ones checked."""
        for row in self._rows:
            row.setParent(None)
            row.deleteLater()
        self._rows = [_StageRow(stage, self) for stage in stages]
        for row in self._rows:
            row.check.setChecked(row.stage in chosen)
            row.check.toggled.connect(self._toggled)
            row.check.installEventFilter(self)
            row.moved.connect(self._move)
        self._arrange()
        for name, check in self._parts.items():
            check.setVisible(any(stage in stages for stage in PARTS[name]))
        self.look_at(self._current if self._current in stages else stages[0])
        self._toggled()

    def look_at(self, stage: str) -> None:
        """Make a stage's row the one looked at."""
        self._current = stage
        for row in self._rows:
            row.set_current(row.stage == stage)
        self.looked_at.emit(stage)

    def lock(self, why: str) -> None:
        """Nothing can be chosen for a reason, or everything with ""."""
        for check in (*self._parts.values(), *(row.check for row in self._rows)):
            check.setEnabled(not why)
            check.setToolTip(why)
        for row in self._rows:
            row.setEnabled(not why)

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self._title.setText(self.tr("What to calibrate"))
        self._parts["scale_factors"].setText(self.tr("Scale factors"))
        self._parts["installation"].setText(self.tr("Installation matrix and lever arms"))
        self._parts["biases"].setText(self.tr("Biases"))
        self._hint.setText(self.tr("or single stages, in this order:"))
        for row in self._rows:
            row.retranslate()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """The row that has the focus is the one looked at."""
        if event.type() == QEvent.Type.FocusIn:
            for row in self._rows:
                if row.check is watched and row.stage != self._current:
                    self.look_at(row.stage)
        return super().eventFilter(watched, event)

    def _choose_part(self, part: str) -> None:
        wanted = self._parts[part].checkState() != Qt.CheckState.Unchecked
        for row in self._rows:
            if row.stage in PARTS[part]:
                row.check.setChecked(wanted)
        self._toggled()

    def _toggled(self) -> None:
        chosen = self.stages
        for name, check in self._parts.items():
            offered = [stage for stage in PARTS[name] if stage in self.order]
            count = sum(stage in chosen for stage in offered)
            if count and count < len(offered):
                check.setCheckState(Qt.CheckState.PartiallyChecked)
            else:
                check.setTristate(False)
                check.setChecked(bool(count))
        for row in self._rows:
            row.number(chosen.index(row.stage) + 1 if row.stage in chosen else None)
        self.changed.emit()

    def _move(self, stage: str, way: int) -> None:
        place = self.order.index(stage)
        row = self._rows.pop(place)
        self._rows.insert(place + way, row)
        self._arrange()
        self.look_at(stage)
        self._toggled()

    def _arrange(self) -> None:
        for row in self._rows:
            self._list.removeWidget(row)
        for place, row in enumerate(self._rows):
            self._list.addWidget(row)
            row.can_move(place > 0, place < len(self._rows) - 1)
        previous: QWidget = self._parts["biases"]
        for row in self._rows:
            for widget in (row.check, row.up, row.down):
                QWidget.setTabOrder(previous, widget)
                previous = widget


class _StageRow(QFrame):
    """One stage: its place in the order, its check box, up and down."""

    moved = Signal(str, int)

    def __init__(self, stage: str, parent: QWidget) -> None:
        super().__init__(parent)
        self.stage = stage
        self._number = QLabel()
        self._number.setFixedWidth(2 * theme.GRID)
        self._number.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        self.check = QCheckBox()
        self.check.setObjectName(f"stage_check_{stage}")
        self.check.setMinimumHeight(theme.BUTTON - theme.GRID)
        self.up, self.down = QToolButton(), QToolButton()
        row = QHBoxLayout(self)
        row.setContentsMargins(theme.GRID, 0, 0, 0)
        row.setSpacing(theme.GRID // 2)
        row.addWidget(self._number)
        row.addWidget(self.check, 1)
        for button, arrow, way in (
            (self.up, Qt.ArrowType.UpArrow, -1),
            (self.down, Qt.ArrowType.DownArrow, 1),
        ):
            button.setArrowType(arrow)
            button.setAutoRaise(True)
            button.setFixedSize(theme.BUTTON - theme.GRID, theme.BUTTON - theme.GRID)
            button.clicked.connect(lambda _=False, by=way: self.moved.emit(self.stage, by))
            row.addWidget(button)
        self.up.setObjectName(f"stage_up_{stage}")
        self.down.setObjectName(f"stage_down_{stage}")
        self.retranslate()

    def number(self, place: int | None) -> None:
        """Its place among those chosen, None where it is not."""
        self._number.setText("" if place is None else str(place))

    def can_move(self, up: bool, down: bool) -> None:
        """Which ways are open."""
        self.up.setEnabled(up)
        self.down.setEnabled(down)

    def set_current(self, current: bool) -> None:
        """Whether its schedule is shown."""
        theme.set_kind(self, "current" if current else "")

    def retranslate(self) -> None:
        """Say it again in the language in force."""
        name = term("stage", self.stage)
        self.check.setText(name)
        self.up.setToolTip(self.tr("{0} one place earlier").format(name))
        self.down.setToolTip(self.tr("{0} one place later").format(name))
        self.up.setAccessibleName(self.up.toolTip())
        self.down.setAccessibleName(self.down.toolTip())
