"""The result of a search for a schedule: duration and limiting parameter, plots, parameters and robustness."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from PySide6.QtCore import QModelIndex, QPersistentModelIndex
from PySide6.QtGui import QColor, QPainter
from PySide6.QtWidgets import QStyledItemDelegate, QStyleOptionViewItem, QWidget

from calstation.config import ScheduleOptions
from calstation.design import Design
from calstation.gui.engineer.designer.plots import FrontPlot, Path3D, PathPlot, SphereBox
from calstation.gui.text import bind, duration_text, on_language_change, parameter_text, product_text, say, term
from calstation.gui.widgets import (
    ROW,
    CellTable,
    Column,
    EmptyState,
    JobRow,
    JobWatch,
    StateBadge,
    ViewTabs,
    box,
    button,
    column,
    enable,
    label,
    panel,
    row,
    scroll_area,
    split,
    stack,
    theme,
)
from calstation.physics import DEGREE, INDEX, NAMES, display, display_by_unit
from calstation.results import Preview

_NONE = "–"

Index = QModelIndex | QPersistentModelIndex


class RatioBar(QStyledItemDelegate):
    """Draws the ratio of a row of a table as a bar; the full width is 1, or the largest ratio if above 1."""

    def __init__(self, table: CellTable) -> None:
        super().__init__(table)
        self._table = table

    def paint(self, painter: QPainter, option: QStyleOptionViewItem, index: Index) -> None:
        """Draw the bar."""
        ratios = [float(cells["ratio"]) for cells in self._table.cells.values()]
        box = option.rect.adjusted(theme.GRID, theme.GRID, -theme.GRID, -theme.GRID)
        ratio = ratios[index.row()]
        box.setWidth(max(1, round(box.width() * ratio / max(1.0, *ratios))))
        painter.fillRect(box, QColor(theme.colours().accent if ratio <= 1.0 else theme.colours().bad))


class DesignResult(QWidget):
    """Shows a design; `path_job` polls the job that computes its path, and buttons call `save`, `copy`, `export`."""

    def __init__(
        self, path_job: JobWatch, save: Callable[[], None], copy: Callable[[], None], export: Callable[[], None]
    ) -> None:
        super().__init__()
        self._shown: tuple[Design, ScheduleOptions] | None = None
        self._badge = StateBadge()
        self._headline = label(kind="section", name="design_headline", wrap=True)
        self._about = label(kind="muted", name="design_about", wrap=True)
        self._front, self._path, self._sphere = FrontPlot(), PathPlot(), SphereBox()
        self._parameters = table = CellTable("design_parameters")
        table.parameters.set_columns(
            (
                table.column("common.unit", "unit", number=False),
                table.column("engineer.sigma_planned", "sigma"),
                table.column("engineer.sigma_limit", "limit"),
                _with_state(table, table.column("engineer.sigma_over_limit", "ratio")),
                Column(str, lambda _: "", number=False),
            )
        )
        table.setItemDelegateForColumn(table.model().columnCount() - 1, RatioBar(table))
        self._variations = table = CellTable("design_variations")
        table.verticalHeader().hide()
        table.parameters.set_columns(
            (
                _with_state(table, table.column("engineer.condition", "condition", number=False)),
                table.column("engineer.reached_after", "reached"),
                table.column("engineer.largest_sigma_then", "worst"),
            )
        )
        self._hidden = table = CellTable("design_hidden")
        table.verticalHeader().hide()
        table.parameters.set_columns(
            (
                table.column("engineer.effect", "effect", number=False),
                table.column("engineer.hidden_up_to", "size"),
                table.column("common.unit", "unit", number=False),
                table.column("engineer.effect_moves_most", "moved", number=False),
                table.column("engineer.effect_by", "move"),
            )
        )
        self._notes = label(name="design_sees", wrap=True)
        self._tabs = ViewTabs(
            "design_views",
            *("engineer.duration", "engineer.path", "common.parameters", "engineer.robustness"),
            "engineer.hidden_effects",
        )
        robustness = box(self._variations, self._notes, None)
        self._computing = EmptyState(JobRow(path_job), title="engineer.computing_path")
        path = self._drawn = stack(self._computing, split((self._path, 3), (self._sphere, 2)))
        self._views = stack(
            panel((self._front, 1)), path, self._parameters, scroll_area(robustness, wide=False), self._hidden
        )
        self._tabs.currentChanged.connect(self._views.setCurrentIndex)
        self._save_button = button("save_as_button", "engineer.save_as_product", save)
        copy_button = button("copy_schedule_button", "engineer.copy_schedule", copy)
        export_button = button("export_design_button", "engineer.export", export)
        tables = self._parameters, self._variations, self._hidden
        titles = "common.parameters", "engineer.robustness", "engineer.hidden_effects"
        for table, title in zip(tables, titles, strict=True):
            bind(table.setAccessibleName, title)
        #: The widgets in Tab order.
        self.tab_order = (self._tabs, copy_button, export_button, self._save_button, self._sphere.slider, *tables)
        column(
            row(self._badge, (self._headline, 1), spacing=2 * theme.GRID),
            self._about,
            row(self._tabs, None, copy_button, export_button, self._save_button),
            (self._views, 1),
            on=self,
            spacing=theme.GRID // 2,
        )
        on_language_change(self, self._show_texts)

    def show_design(self, design: Design, options: ScheduleOptions) -> None:
        """Show a design for the product and table of these options."""
        self._shown = design, options
        self._front.show_design(design)
        self._drawn.setCurrentIndex(0)
        self._show_texts()

    def show_path(self, preview: Preview) -> None:
        """Show the motion of the design."""
        if self._shown is None:
            return
        path = Path3D(self._shown[0], preview, self._shown[1].geometry)
        self._path.show_path(path)
        self._sphere.sphere.show_path(path)
        self._drawn.setCurrentIndex(1)

    def lock(self, why: str) -> None:
        """Disable saving for the given reason; "" enables it."""
        enable(self._save_button, why, say("engineer.save_as_product_tip"))

    def _show_texts(self) -> None:
        if self._shown is None:
            return
        design, options = self._shown
        self._badge.show_state(*_verdict(design))
        self._headline.setText(_headline(design))
        self._about.setText(_about(design, options))
        self._notes.setText("\n".join(_notes(design)))
        self._parameters.show_cells(_parameter_cells(design), ("sigma", "limit", "ratio"))
        self._variations.show_cells(_variation_cells(design))
        header = self._variations.horizontalHeader().sizeHint().height()
        self._variations.setFixedHeight(header + ROW * len(self._variations.cells) + theme.GRID // 2)
        self._hidden.show_cells(_hidden_cells(design), ("size", "move"))


def _with_state(table: CellTable, column: Column) -> Column:
    """Return a column that also shows the symbol of each row's state."""
    return replace(column, state=lambda name: table.cells[name]["state"])


def _verdict(design: Design) -> tuple[str, str]:
    """Return the shape and the text of the badge."""
    if design.worst > 1.0:
        return "caution", say("engineer.design_missed")
    if not design.searched:
        return "caution", say("engineer.design_not_searched")
    if design.present is not None and design.duration >= design.present:
        return "caution", say("engineer.design_not_shorter")
    return "good", say("engineer.design_reached")


def _headline(design: Design) -> str:
    values = {"duration": duration_text(design.duration), "longest": duration_text(design.longest)}
    reserve = design.longest > design.duration
    first = say(f"engineer.design_{'with' if reserve else 'without'}_reserve", **values)
    if design.present is not None:
        times = design.present / design.duration
        first += " " + say("engineer.design_present", present=duration_text(design.present), times=times)
    limiting = say("engineer.design_limiting", parameter=design.limiting, worst=design.worst)
    return f"{first}\n{limiting}"


def _about(design: Design, options: ScheduleOptions) -> str:
    return say(
        "engineer.design_made",
        product=product_text(options.name),
        station=options.station,
        planned=design.planned,
        reserve=len(design.moves) - design.planned,
        rate=design.rate_dps,
        acceleration=design.acceleration_dps2,
        seconds=duration_text(design.seconds),
    )


def _parameter_cells(design: Design) -> dict[str, dict[str, str]]:
    """Return the rows of all parameters with a limit, starting with the limiting one."""
    cells = {}
    for i in np.argsort(-design.ratios):
        name, ratio = NAMES[i], float(design.ratios[i])
        if not np.isfinite(design.limits[i]):
            continue
        sigma, unit = display(name, float(design.sigma[i]))
        cells[name] = {
            "unit": unit,
            "sigma": f"{sigma:.3g}",
            "limit": f"{display(name, float(design.limits[i]))[0]:.3g}",
            "ratio": f"{ratio:.3f}",
            "state": "good" if ratio <= 1.0 else "bad",
        }
    return cells


def _variation_cells(design: Design) -> dict[str, dict[str, str]]:
    """Return the rows of the conditions; for several with the same name, only the worst one."""
    cells = {}
    for variation in sorted(design.variations, key=lambda v: (v.duration is None, v.duration or 0.0, v.worst)):
        angle = variation.value if variation.name == "noise" else float(np.rad2deg(variation.value))
        condition = say(f"engineer.design_{variation.name}", value=angle)
        reached = variation.duration
        cells[condition] = {
            "condition": condition,
            "reached": say("engineer.expected_missed") if reached is None else duration_text(reached),
            "worst": f"{variation.worst:.2f}",
            "state": "caution" if reached is None else "good",
        }
    return cells


def _hidden_cells(design: Design) -> dict[str, dict[str, str]]:
    """Return the rows of the effects, starting with those that leave the largest error."""
    cells = {}
    for number, limit in enumerate(sorted(design.hidden, key=lambda limit: -limit.move)):
        if limit.parameter:
            effect = say("engineer.design_drift", parameter=limit.parameter)
            size, unit = display(limit.parameter, limit.size)
        else:
            effect = f"{term('group', limit.cause)} {limit.component}".strip()
            size, unit = display_by_unit(limit.unit, limit.size)
        seen = bool(np.isfinite(limit.size))
        cells[str(number)] = {
            "effect": effect,
            "size": f"{size:.3g}" if seen else "∞",
            "unit": unit,
            "moved": parameter_text(limit.moved) if limit.moved in INDEX else _NONE,
            "move": f"{limit.move:.1f}" if seen else _NONE,
        }
    return cells


def _notes(design: Design) -> list[str]:
    """Return the sentences about rests, latitude and noise."""
    longest = max(design.rests)
    if design.gravity_rest is None:
        sentences = [say("engineer.design_rests", count=len(design.rests), longest=longest)]
    else:
        count = sum(rest >= design.gravity_rest for rest in design.rests)
        sentences = [say("engineer.design_long_rests", count=count, shortest=design.gravity_rest, longest=longest)]
    if design.latitude_sigma is None:
        sentences.append(say("engineer.design_no_latitude"))
    else:
        sentences.append(say("engineer.design_latitude", sigma=design.latitude_sigma / DEGREE))
    return [*sentences, say("engineer.design_noise_seen", percent=100.0 * design.noise_seen)]
