"""View of the cycle of a run: bars that show its phases to scale, and a legend with their durations and shares."""

from collections.abc import Sequence

from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from calstation.gui.text import Words, bind, duration_text, say, term
from calstation.gui.widgets import PlainLabel, clear, column, grid, label, row, theme
from calstation.results import Result

#: Height of a bar, and size of a colour in the legend, px.
_BAR, _SWATCH = 5 * theme.GRID, 2 * theme.GRID
#: Palette role and opacity of each phase that is not a stage.
_COLOURS = {
    "opening": ("muted", 255),
    "resuming": ("muted", 120),
    "preparation": ("caution", 255),
    "warm_up": ("caution", 120),
    "pause": ("track", 255),
    "solving": ("partial", 255),
    "transfer": ("good", 110),
    "proof": ("good", 255),
    "unloading": ("caution", 60),
    "files": ("text", 255),
    "stopping": ("bad", 255),
}
#: Opacity of the first stage, its decrease from stage to stage, and its minimum.
_FIRST, _DECREASE, _MIN_OPACITY = 255, 55, 60

#: Name of a phase and, if the phase is the motion of a stage, the name of the stage, otherwise "".
_Part = tuple[str, str]


class CycleBar(QWidget):
    """A horizontal bar of segments whose widths are proportional to their durations."""

    def __init__(self, name: str = "", words: Words = "") -> None:
        super().__init__()
        self.setObjectName(name)
        bind(self.setAccessibleName, words)
        self._segments: Sequence[tuple[float, QColor]] = ()
        self.setFixedHeight(_BAR)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)

    def show_segments(self, segments: Sequence[tuple[float, QColor]]) -> None:
        """Show segments from left to right, each with its duration, s, and its colour."""
        self._segments = segments
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the segments."""
        painter = QPainter(self)
        scale = self.width() / (sum(seconds for seconds, _ in self._segments) or 1.0)
        begin = 0.0
        for seconds, colour in self._segments:
            left, right = round(begin * scale), round((begin + seconds) * scale)
            painter.fillRect(left, 0, right - left, self.height(), colour)
            begin += seconds


class CycleView(QWidget):
    """The phases of a run from its start to the result: a bar of all phases, a bar without the stages, and a legend."""

    def __init__(self) -> None:
        super().__init__()
        self._result: Result | None = None
        self.total_label = label(kind="section", name="cycle_total_label")
        self._bar = CycleBar("cycle_bar", "engineer.phases_to_scale")
        self._others_bar = CycleBar("cycle_others_bar", "engineer.phases_except_stages")
        self._legend = grid(across=2 * theme.GRID, down=theme.GRID // 2)
        column(
            self.total_label,
            self._bar,
            theme.GRID,
            label("engineer.except_stages"),
            self._others_bar,
            theme.GRID,
            row(self._legend, None),
            None,
            on=self,
            margins=(0, theme.GRID, 0, 0),
        )
        theme.on_appearance_change(self, self._show)

    def show_result(self, result: Result) -> None:
        """Show the cycle of a result."""
        self._result = result
        self._show()

    def _show(self) -> None:
        if self._result is None:
            return
        segments = [
            ((part.phase, part.stage if part.phase == "stage" else ""), part.seconds) for part in self._result.cycle
        ]
        durations: dict[_Part, float] = {}
        for part, seconds in segments:
            durations[part] = durations.get(part, 0.0) + seconds
        stages = [part for part in durations if part[0] == "stage"]
        others = [part for part in durations if part[0] != "stage"]
        accent = theme.colours().accent
        opacities = (max(_FIRST - number * _DECREASE, _MIN_OPACITY) for number in range(len(stages)))
        colours = {part: theme.faint(accent, opacity) for part, opacity in zip(stages, opacities, strict=True)}
        colours |= {part: _colour(part[0]) for part in others}
        self._bar.show_segments([(seconds, colours[part]) for part, seconds in segments])
        self._others_bar.show_segments([(seconds, colours[part]) for part, seconds in segments if part in others])
        total = sum(durations.values())
        in_stages = sum(durations[part] for part in stages)
        self.total_label.setText(say("engineer.cycle_time", time=duration_text(total, tenths=True)))
        clear(self._legend)
        rows = [(term("stage", part[1]), durations[part], colours[part]) for part in stages]
        rows += [(term("cycle", part[0]), durations[part], colours[part]) for part in others]
        for name, seconds, colour in rows:
            self._add_row(name, seconds, total, colour)
        self._add_row(say("engineer.all_stages"), in_stages, total)
        self._add_row(say("engineer.everything_else"), total - in_stages, total)

    def _add_row(self, name: str, seconds: float, total: float, colour: QColor | None = None) -> None:
        """Add a row to the legend; a sum, which has no colour, is shown in bold."""
        number = self._legend.rowCount()
        if colour is not None:
            swatch = CycleBar()
            swatch.setFixedSize(_SWATCH, _SWATCH)
            swatch.show_segments([(1.0, colour)])
            self._legend.addWidget(swatch, number, 0)
        share = 100.0 * seconds / total if total > 0.0 else 0.0
        for index, text in enumerate((name, duration_text(seconds, tenths=True), f"{share:.1f} %"), 1):
            cell = PlainLabel(text)
            cell.setFont(theme.font(bold=colour is None))
            if index > 1:
                cell.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
            self._legend.addWidget(cell, number, index)


def _colour(phase: str) -> QColor:
    role, opacity = _COLOURS.get(phase, ("line", 255))
    return theme.faint(getattr(theme.colours(), role), opacity)
