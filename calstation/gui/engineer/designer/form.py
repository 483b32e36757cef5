"""The form of a search for a schedule."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QLocale, Qt
from PySide6.QtWidgets import QAbstractSpinBox, QDoubleSpinBox, QFrame, QVBoxLayout, QWidget

from calstation import design
from calstation.config import ScheduleOptions
from calstation.gui.text import Words, bind, say
from calstation.gui.widgets import button, column, combo_box, enable, label, row, show_text, theme

if TYPE_CHECKING:
    from calstation.design import DesignRequest

#: Goals of a search.
SHORTEST, GIVEN_TIME, AS_PRESENT = "shortest", "given_time", "as_present"

_GOALS = {
    SHORTEST: "engineer.goal_shortest",
    GIVEN_TIME: "engineer.goal_smallest_sigma",
    AS_PRESENT: "engineer.goal_as_good",
}


class DesignForm(QFrame):
    """Goal, margin or duration, time for the search, and speeds; its button calls `begin`."""

    def __init__(self, begin: Callable[[], None]) -> None:
        super().__init__()
        self.setProperty("kind", "panel")
        self._goal = combo_box("design_goal_combo", _GOALS)
        self._goal.currentIndexChanged.connect(lambda _: self._show_goal())
        self._margin = _spin("design_margin_spin", 0.05, 1.0, 0.05, 2)
        self._minutes = _spin("design_minutes_spin", 0.5, 60.0, 0.5, 1)
        self._search = _spin("design_search_spin", 0.0, 3600.0, 10.0, 0, zero="engineer.usual")
        self._rate = _spin("design_rate_spin", 0.0, 1000.0, 1.0, 1, zero="engineer.automatic")
        self._acceleration = _spin("design_acceleration_spin", 0.0, 1000.0, 1.0, 1, zero="engineer.automatic")
        self._seed = _spin("design_seed_spin", 0.0, 9999.0, 1.0, 0)
        self._margin.setValue(0.8)
        self._minutes.setValue(5.0)
        self.button = button("design_button", "engineer.design", begin, kind="primary")
        self._more = button("design_more_button", "engineer.advanced")
        self._more.setCheckable(True)
        self._advanced = self._make_advanced()
        self._advanced.hide()
        self._more.toggled.connect(self._advanced.setVisible)
        self._reason = label(kind="muted", name="design_reason_label", wrap=True)
        self._margin_box = _captioned("engineer.margin", self._margin, "engineer.margin_tip")
        self._minutes_box = _captioned("engineer.duration_minutes", self._minutes, "engineer.duration_tip")
        search = _captioned("engineer.search_seconds", self._search, "engineer.search_tip")
        goal_box = column(label("engineer.goal", buddy=self._goal), self._goal, spacing=0)
        buttons = column(None, row(self._more, self.button))
        column(
            row((goal_box, 1), self._margin_box, self._minutes_box, search, buttons, spacing=2 * theme.GRID),
            self._advanced,
            self._reason,
            on=self,
            margins=(2 * theme.GRID, theme.GRID // 2, theme.GRID, theme.GRID),
        )
        self._show_goal()

    def _make_advanced(self) -> QWidget:
        made = QWidget()
        rate = _captioned("engineer.rate_field", self._rate, "engineer.rate_tip")
        acceleration = _captioned("engineer.acceleration_field", self._acceleration, "engineer.acceleration_tip")
        seed = _captioned("engineer.seed", self._seed, "engineer.seed_tip")
        row(rate, acceleration, seed, None, on=made, spacing=2 * theme.GRID)
        return made

    @property
    def goal(self) -> str:
        """The selected goal."""
        return str(self._goal.currentData())

    def offer(self, options: ScheduleOptions) -> None:
        """Limit the speeds to the table's limits."""
        self._rate.setMaximum(options.rate)
        self._acceleration.setMaximum(options.acceleration)

    def lock(self, why: str, *, shown: bool) -> None:
        """Disable the button for the given reason, which is also `shown` below the form; "" enables it."""
        enable(self.button, why, say("engineer.design_tip"))
        show_text(self._reason, why if shown else "")

    def request(self, station: Path | None, product: Path, stop: Path) -> "DesignRequest":
        """Return the request for a product on a station; a file `stop` ends the search."""
        goal = self.goal
        return design.DesignRequest(
            station=station,
            product=product,
            margin=1.0 if goal == AS_PRESENT else self._margin.value(),
            duration=60.0 * self._minutes.value() if goal == GIVEN_TIME else None,
            as_present=goal == AS_PRESENT,
            time_limit=self._search.value() or None,
            seed=round(self._seed.value()),
            rate_dps=self._rate.value() or None,
            acceleration_dps2=self._acceleration.value() or None,
            stop=stop,
        )

    def _show_goal(self) -> None:
        for box, goal in ((self._margin_box, SHORTEST), (self._minutes_box, GIVEN_TIME)):
            box.setVisible(self.goal == goal)


def _spin(name: str, low: float, high: float, step: float, decimals: int, *, zero: Words = "") -> QDoubleSpinBox:
    made = QDoubleSpinBox()
    made.setObjectName(name)
    made.setLocale(QLocale.c())
    made.setDecimals(decimals)
    made.setRange(low, high)
    made.setSingleStep(step)
    made.setButtonSymbols(QAbstractSpinBox.ButtonSymbols.NoButtons)
    made.setAlignment(Qt.AlignmentFlag.AlignRight)
    made.setMinimumWidth(11 * theme.GRID)
    if zero:
        bind(made.setSpecialValueText, zero)
    return made


def _captioned(caption: Words, spin: QDoubleSpinBox, tip: Words) -> QWidget:
    made = QWidget()
    box: QVBoxLayout = column(label(caption, buddy=spin), spin, on=made, spacing=0)
    box.setStretch(1, 0)
    bind(spin.setAccessibleName, caption)
    bind(spin.setToolTip, tip)
    return made
