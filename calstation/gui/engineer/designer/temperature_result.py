"""View of a design over temperature: the schedules with soaks and with a ramp, and the sigmas over the range."""

from collections.abc import Callable

from PySide6.QtWidgets import QWidget

from calstation.config import ScheduleOptions
from calstation.designer import TemperatureDesign
from calstation.gui.engineer.designer.form import ResultHead, export_design
from calstation.gui.text import duration_text, on_language_change, parameter_text, say, term
from calstation.gui.widgets import (
    Cell,
    CellTable,
    ViewTabs,
    button,
    column,
    enable,
    label,
    row,
    stack,
    theme,
)
from calstation.messages import plain_number
from calstation.physics import GROUPS, NAMES, display, group_indices

_NONE = "–"
_SCHEDULE_COLUMNS = (
    Cell("cli.design_schedules", "schedule", number=False, state="state"),
    Cell("engineer.chamber_time", "duration"),
    Cell("engineer.longest_soak", "soak"),
    Cell("engineer.cycles_of_moves", "cycles"),
    Cell("engineer.sigma_over_limit", "worst"),
    Cell("engineer.limited_by", "parameter", number=False),
)
_SIGMA_COLUMNS = (
    Cell("common.unit", "unit", number=False),
    Cell("engineer.sigma_limit", "limit"),
    Cell("cli.column_soaked", "soaked", state="soak_state"),
    Cell("cli.column_at", "soaked_at"),
    Cell("cli.column_ramped", "ramped", state="ramp_state"),
    Cell("cli.column_at", "ramped_at"),
)


class TemperatureDesignResult(QWidget):
    """Shows and exports a design over temperature; a button calls `save`."""

    def __init__(self, save: Callable[[], None]) -> None:
        super().__init__()
        self._design: tuple[TemperatureDesign, ScheduleOptions] | None = None
        self._head = ResultHead("temperature_design_headline")
        self._summary = label(kind="muted", name="temperature_design_about", wrap=True)
        self._schedules = CellTable(
            "temperature_design_schedules", "cli.design_schedules", _SCHEDULE_COLUMNS, named=False
        )
        self._sigmas = CellTable("temperature_design_sigmas", "cli.design_sigmas", _SIGMA_COLUMNS)
        tabs = ViewTabs("temperature_design_views", "cli.design_schedules", "cli.design_sigmas")
        views = stack(self._schedules, self._sigmas)
        tabs.currentChanged.connect(views.setCurrentIndex)
        self._save_button = button("save_temperature_design_as_button", "engineer.save_as_product", save)
        export_button = button("export_temperature_design_button", "engineer.export", self._export)
        #: The widgets in Tab order.
        self.tab_order = (tabs, export_button, self._save_button, self._schedules, self._sigmas)
        column(
            self._head,
            self._summary,
            row(tabs, None, export_button, self._save_button),
            (views, 1),
            on=self,
            spacing=theme.GRID // 2,
        )
        on_language_change(self, self._show_texts)

    def show_design(self, design: TemperatureDesign, options: ScheduleOptions) -> None:
        """Show a design and the options for which it was searched."""
        self._design = design, options
        self._show_texts()

    def lock(self, reason: str, outdated: str) -> None:
        """Disable saving for `reason`, and show why the design is out of date, `outdated`; both may be ""."""
        self._head.set_outdated(outdated)
        enable(self._save_button, reason, say("engineer.save_as_product_tip"))

    def _export(self) -> None:
        if self._design is not None:
            export_design(self, *self._design)

    def _show_texts(self) -> None:
        if self._design is None:
            return
        design, options = self._design
        self._head.show_design(("good", say("engineer.design_reached")), options, _headline(design))
        self._summary.setText("\n".join(_assumptions(design)))
        self._schedules.show_cells(_schedule_cells(design))
        self._sigmas.show_cells(_sigma_cells(design), ("limit", "soaked", "ramped"))


def _headline(design: TemperatureDesign) -> str:
    """Return the chosen schedule and its limiting parameter."""
    chosen = design.chosen
    values = {"minutes": design.duration / 60.0, "worst": design.worst, "parameter": chosen.limiting}
    if design.is_ramp:
        return say("design.ramp_found", rate=chosen.schedule["ramp_c_per_min"], **values)
    return say("design.soaks_found", count=chosen.temperatures, **values)


def _assumptions(design: TemperatureDesign) -> list[str]:
    """Return what the design assumes, and whether a shorter ramp exists."""
    thermal = design.thermal
    values = {"seconds": thermal.time_constant, "heating": thermal.self_heating, "rate": 60.0 * thermal.rate}
    orders = [f"{term('group', group)} {order}" for group, order in design.model.order.items()]
    sentences = [say("design.thermal", **values), say("design.orders", orders=orders)]
    if not design.is_ramp and design.ramp.course.duration < design.soak.course.duration:
        sentences.append(say("design.ramp_not_stated"))
    return sentences


def _schedule_cells(design: TemperatureDesign) -> dict[str, dict[str, str]]:
    """Return a row for each schedule."""
    cells = {}
    for name, each in design.rows:
        cells[name] = {"schedule": say(f"cli.design_{name}"), "state": "caution"}
        if each is None:
            cells[name] |= dict.fromkeys(("duration", "soak", "cycles", "worst", "parameter"), _NONE)
            continue
        cells[name] |= {
            "duration": duration_text(each.course.duration),
            "soak": duration_text(each.course.longest_soak),
            "cycles": str(each.cycles),
            "worst": f"{each.worst:.2f}",
            "parameter": parameter_text(each.limiting),
            "state": "good" if each.worst <= design.margin else "caution",
        }
    return cells


def _sigma_cells(design: TemperatureDesign) -> dict[str, dict[str, str]]:
    """Return a row for each group with a limit: its parameter with the largest ratio of sigma to limit."""
    cells = {}
    for group in GROUPS:
        i = max(group_indices(group), key=lambda k: float(design.chosen.ratios[k]))
        if design.chosen.ratios[i] > 0.0:
            size, unit = display(NAMES[i], 1.0)
            soak, ramp = design.soak, design.ramp
            cells[NAMES[i]] = {
                "unit": unit,
                "limit": plain_number(size * float(soak.limits[i]), ".3g"),
                "soaked": plain_number(size * float(soak.sigma[i]), ".3g"),
                "soaked_at": f"{soak.at[i]:.0f}",
                "soak_state": "good" if soak.ratios[i] <= 1.0 else "bad",
                "ramped": plain_number(size * float(ramp.sigma[i]), ".3g"),
                "ramped_at": f"{ramp.at[i]:.0f}",
                "ramp_state": "good" if ramp.ratios[i] <= 1.0 else "bad",
            }
    return cells
