"""View of a design: its duration and limiting parameter, plots, parameters, robustness and hidden effects."""

import json
from collections.abc import Callable

import numpy as np
from PySide6.QtCore import QModelIndex, QPersistentModelIndex
from PySide6.QtGui import QColor, QGuiApplication, QPainter
from PySide6.QtWidgets import QStyledItemDelegate, QStyleOptionViewItem, QWidget

from calstation.config import ScheduleOptions
from calstation.designer import STAGE, Design
from calstation.gui.engineer.designer.form import ResultHead, export_design
from calstation.gui.engineer.designer.plots import DesignPath, FrontPlot, PathPlot, SphereView
from calstation.gui.text import duration_text, on_language_change, parameter_text, say, term
from calstation.gui.widgets import (
    ROW,
    Cell,
    CellTable,
    EmptyState,
    JobRow,
    JobWatch,
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
from calstation.messages import plain_number
from calstation.physics import DEGREE, INDEX, NAMES, display, display_by_unit
from calstation.results import Preview

_NONE = "–"
_PARAMETER_COLUMNS = (
    Cell("common.unit", "unit", number=False),
    Cell("engineer.sigma_planned", "sigma"),
    Cell("engineer.sigma_limit", "limit"),
    Cell("engineer.sigma_over_limit", "ratio", state="state"),
    Cell("", "bar", number=False),
)
_VARIATION_COLUMNS = (
    Cell("engineer.condition", "condition", number=False, state="state"),
    Cell("engineer.reached_after", "reached"),
    Cell("engineer.largest_sigma_then", "worst"),
)
_HIDDEN_COLUMNS = (
    Cell("engineer.effect", "effect", number=False),
    Cell("engineer.hidden_up_to", "size"),
    Cell("common.unit", "unit", number=False),
    Cell("engineer.effect_moves_most", "parameter", number=False),
    Cell("engineer.effect_by", "shift"),
)

Index = QModelIndex | QPersistentModelIndex


class RatioBar(QStyledItemDelegate):
    """Draws the ratio in each row of a table as a bar, whose full width is the larger of the largest ratio and 1."""

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
    """Shows, copies and exports a design; `path_job` computes its path, and a button calls `save`."""

    def __init__(self, path_job: JobWatch, save: Callable[[], None]) -> None:
        super().__init__()
        self._design: tuple[Design, ScheduleOptions] | None = None
        self._head = ResultHead("design_headline")
        self._summary = label(kind="muted", name="design_about", wrap=True)
        self._front, self._path, self._sphere = FrontPlot(), PathPlot(), SphereView()
        self._parameters = CellTable("design_parameters", "common.parameters", _PARAMETER_COLUMNS)
        self._parameters.setItemDelegateForColumn(len(_PARAMETER_COLUMNS) - 1, RatioBar(self._parameters))
        self._variations = CellTable("design_variations", "engineer.robustness", _VARIATION_COLUMNS, named=False)
        self._hidden = CellTable("design_hidden", "engineer.hidden_effects", _HIDDEN_COLUMNS, named=False)
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
        copy_button = button("copy_schedule_button", "engineer.copy_schedule", self._copy)
        export_button = button("export_design_button", "engineer.export", self._export)
        buttons = copy_button, export_button, self._save_button
        tables = self._parameters, self._variations, self._hidden
        #: The widgets in Tab order.
        self.tab_order = (self._tabs, *buttons, self._sphere.slider, *tables)
        column(
            self._head,
            self._summary,
            row(self._tabs, None, *buttons),
            (self._views, 1),
            on=self,
            spacing=theme.GRID // 2,
        )
        on_language_change(self, self._show_texts)

    def show_design(self, design: Design, options: ScheduleOptions) -> None:
        """Show a design and the options for which it was searched."""
        self._design = design, options
        self._front.show_design(design)
        self._drawn.setCurrentIndex(0)
        self._show_texts()

    def show_path(self, preview: Preview) -> None:
        """Show the motion of the design."""
        if self._design is None:
            return
        path = DesignPath(self._design[0], preview, self._design[1].geometry)
        self._path.show_path(path)
        self._sphere.sphere.show_path(path)
        self._drawn.setCurrentIndex(1)

    def lock(self, reason: str, outdated: str) -> None:
        """Disable saving for `reason`, and show why the design is out of date, `outdated`; both may be ""."""
        self._head.set_outdated(outdated)
        enable(self._save_button, reason, say("engineer.save_as_product_tip"))

    def _copy(self) -> None:
        if self._design is not None:
            QGuiApplication.clipboard().setText(_schedule_text(self._design[0]))

    def _export(self) -> None:
        if self._design is not None:
            export_design(self, *self._design)

    def _show_texts(self) -> None:
        if self._design is None:
            return
        design, options = self._design
        self._head.show_design(_verdict(design), options, _headline(design))
        self._summary.setText(_summary(design))
        self._notes.setText("\n".join(_notes(design)))
        self._parameters.show_cells(_parameter_cells(design), ("sigma", "limit", "ratio"))
        self._variations.show_cells(_variation_cells(design))
        header = self._variations.horizontalHeader().sizeHint().height()
        self._variations.setFixedHeight(header + ROW * len(self._variations.cells) + theme.GRID // 2)
        self._hidden.show_cells(_hidden_cells(design), ("size", "shift"))


def _verdict(design: Design) -> tuple[str, str]:
    """Return the shape and the text of the badge."""
    if design.undetermined:
        return "bad", say("engineer.preview_undetermined")
    if design.worst > 1.0:
        return "caution", say("engineer.design_missed")
    if not design.searched:
        return "caution", say("engineer.design_not_searched")
    if design.present is not None and design.duration >= design.present:
        return "caution", say("engineer.design_not_shorter")
    return "good", say("engineer.design_reached")


def _headline(design: Design) -> str:
    """Return the duration, compared with the present schedule, and the limiting parameter."""
    values = {"duration": duration_text(design.duration), "longest": duration_text(design.longest)}
    reserve = design.longest > design.duration
    first = say(f"engineer.design_{'with' if reserve else 'without'}_reserve", **values)
    if design.present is not None:
        times, present = design.present / design.duration, duration_text(design.present)
        same = f"{times:.3g}" == "1"
        first += " " + say(f"engineer.design_present{'_same' if same else ''}", present=present, times=times)
    worst = {"parameter": design.limiting, "worst": design.worst, "margin": design.margin}
    too_long = not design.searched and design.worst < design.margin
    limiting = say("engineer.design_limiting_random" if too_long else "engineer.design_limiting", **worst)
    if design.undetermined:
        limiting = f"{say('engineer.undetermined', names=design.undetermined)}\n{limiting}"
    hidden = max((limit for limit in design.hidden if np.isfinite(limit.size)), key=lambda h: h.move, default=None)
    if hidden is not None and hidden.moved in INDEX:
        limiting += " " + say("engineer.design_hides", shift=hidden.move, parameter=hidden.moved)
    return f"{first}\n{limiting}"


def _summary(design: Design) -> str:
    """Return the conditions and the size of the search."""
    return say(
        "engineer.design_made",
        planned=design.planned,
        reserve=len(design.moves) - design.planned,
        rate=design.rate_dps,
        acceleration=design.acceleration_dps2,
        seconds=duration_text(design.seconds),
    )


def _parameter_cells(design: Design) -> dict[str, dict[str, str]]:
    """Return the rows of the parameters with a limit, in descending order of the ratio of sigma to limit."""
    cells = {}
    for i in np.argsort(-design.ratios):
        name, ratio = NAMES[i], float(design.ratios[i])
        if not np.isfinite(design.limits[i]):
            continue
        sigma, unit = display(name, float(design.sigma[i]))
        cells[name] = {
            "unit": unit,
            "sigma": plain_number(sigma, ".3g"),
            "limit": plain_number(display(name, float(design.limits[i]))[0], ".3g"),
            "ratio": f"{ratio:.3f}",
            "state": "good" if ratio <= 1.0 else "bad",
            "bar": "",
        }
    return cells


def _variation_cells(design: Design) -> dict[str, dict[str, str]]:
    """Return a row for each condition, or only for the worst of several conditions with the same text."""
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
    """Return the rows of the effects, in descending order of the parameter shift that they cause."""
    cells = {}
    for number, limit in enumerate(sorted(design.hidden, key=lambda limit: -limit.move)):
        if limit.parameter:
            effect = say("engineer.design_drift", parameter=limit.parameter)
            size, unit = display(limit.parameter, limit.size)
        else:
            effect = f"{term('group', limit.cause)} {limit.component}".strip()
            size, unit = display_by_unit(limit.unit, limit.size)
        detectable = bool(np.isfinite(limit.size))
        cells[str(number)] = {
            "effect": effect,
            "size": plain_number(size, ".3g") if detectable else "∞",
            "unit": unit,
            "parameter": parameter_text(limit.moved) if limit.moved in INDEX else _NONE,
            "shift": f"{limit.move:.1f}" if detectable else _NONE,
        }
    return cells


def _notes(design: Design) -> list[str]:
    """Return sentences about the rests, the latitude and the noise."""
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


def _schedule_text(design: Design) -> str:
    """Return the schedule in the format of a product file, with a line for each move."""
    values = design.schedule()
    moves = values.pop("moves")
    targets = values.pop("targets", None)
    lines = [f"[schedule.{STAGE}]"]
    lines += [f"{key} = {json.dumps(value)}" for key, value in values.items()]
    lines += ["moves = [", *(f"    {json.dumps(move)}," for move in moves), "]"]
    if targets is not None:
        lines += [f"[schedule.{STAGE}.targets]", *(f"{key} = {value!r}" for key, value in targets.items())]
    return "\n".join(lines) + "\n"
