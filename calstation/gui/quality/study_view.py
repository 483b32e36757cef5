"""Repeatability study: units that several operators or stations have calibrated equally often."""

from collections.abc import Mapping
from typing import Literal

import numpy as np
from PySide6.QtCore import QSignalBlocker
from PySide6.QtWidgets import QComboBox, QWidget

from calstation.errors import InputError
from calstation.gui.text import bind, error_text, on_language_change, parameter_text, say
from calstation.gui.widgets import CellTable, StateBadge, column, label, row, show_text, split, theme
from calstation.physics import display, number
from calstation.quality import GaugeStudy, Variation, crossed, gauge_study
from calstation.records import RunColumns

#: State of each verdict.
_STATES = {"acceptable": "good", "marginal": "caution", "unacceptable": "bad"}
#: Components in the order of the table, and whether they are the sum of those above.
_COMPONENTS = ("repeatability", "reproducibility", "interaction", "gauge", "part", "total")


class StudyView(QWidget):
    """Shows the analysis of variance of the runs of one product."""

    def __init__(self) -> None:
        super().__init__()
        self._runs: RunColumns | None = None
        self._limits: Mapping[str, tuple[float, float]] = {}
        self._quantity, self._appraiser = QComboBox(), QComboBox()
        for combo, name in ((self._quantity, "study_quantity_combo"), (self._appraiser, "study_appraiser_combo")):
            combo.setObjectName(name)
            combo.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToContents)
            combo.currentIndexChanged.connect(lambda _: self._show())
        with QSignalBlocker(self._appraiser):
            self._appraiser.addItem("", "operators")
            self._appraiser.addItem("", "stations")
        self.badge = StateBadge(theme.SECTION)
        self.about_label = label(name="study_about_label", wrap=True)
        self.problem_label = label(kind="caution", name="study_problem_label", wrap=True)
        self.components, self.anova = CellTable("study_components_table"), CellTable("study_anova_table")
        self._build_tables()
        plan = label(lambda: say("gauge.plan"), kind="muted", wrap=True)
        captions = (
            label(lambda: self.tr("Quantity"), buddy=self._quantity),
            label(lambda: self.tr("Measured by"), buddy=self._appraiser),
        )
        bar = row(captions[0], self._quantity, theme.GRID, captions[1], self._appraiser, None)
        self._answer = QWidget()
        column(
            row(self.badge, 2 * theme.GRID, (self.about_label, 1)),
            (split((self.components, 5), (self.anova, 4), handle=2 * theme.GRID), 1),
            on=self._answer,
        )
        column(plan, bar, self.problem_label, (self._answer, 1), None, on=self, margins=(0, theme.GRID, 0, 0))
        on_language_change(self, self._show_texts)

    def show_runs(self, runs: RunColumns, limits: Mapping[str, tuple[float, float]]) -> None:
        """Show runs of one product and the limits of its parameters, SI."""
        self._runs, self._limits = runs, limits
        wanted = self._quantity.currentData()
        with QSignalBlocker(self._quantity):
            self._quantity.clear()
            for name in runs.values:
                self._quantity.addItem(parameter_text(name), name)
            self._quantity.setCurrentIndex(max(0, self._quantity.findData(wanted)))
        self._show()

    def _build_tables(self) -> None:
        text = self.components.column
        self.components.verticalHeader().hide()
        self.components.parameters.set_columns(
            (
                text(lambda: self.tr("Variation"), "name", number=False),
                text(lambda: "σ", "sigma"),
                text(lambda: self.tr("95 % interval"), "interval"),
                text(lambda: self.tr("% of study"), "study"),
                text(lambda: self.tr("% of tolerance"), "tolerance"),
            )
        )
        bind(self.components.setAccessibleName, lambda: self.tr("Components of the variation"))
        text = self.anova.column
        self.anova.verticalHeader().hide()
        self.anova.parameters.set_columns(
            (
                text(lambda: self.tr("Source"), "name", number=False),
                text(lambda: self.tr("Degrees of freedom"), "dof"),
                text(lambda: "F", "f"),
                text(lambda: "p", "p"),
            )
        )
        bind(self.anova.setAccessibleName, lambda: self.tr("Analysis of variance"))

    def _show(self) -> None:
        runs, name = self._runs, self._quantity.currentData()
        if runs is None or name is None:
            return
        size, unit = display(name, 1.0)
        low, high = self._limits.get(name, (np.nan, np.nan))
        try:
            study, parts = _study(runs, name, size, self._appraiser.currentData(), (high - low) * size)
        except InputError as error:
            show_text(self.problem_label, error_text(error).sentences)
            self._answer.hide()
            return
        self.problem_label.hide()
        self._answer.show()
        self.badge.show_state(_STATES[study.verdict], say(f"gauge.{study.verdict}"))
        self.about_label.setText(
            say(
                "gauge.answer",
                parts=parts,
                appraisers=study.appraisers,
                trials=study.trials,
                categories=study.categories,
                unit=unit,
            )
        )
        cells = {}
        for key in _COMPONENTS:
            found = getattr(study, key)
            if found is not None:
                cells[key] = {"name": say(f"gauge.{key}"), **_cells(found)}
        self.components.show_cells(cells, ("sigma",))
        self.anova.show_cells(
            {
                line.source: {
                    "name": say(f"gauge.{line.source}"),
                    "dof": str(line.dof),
                    **({} if line.f is None or line.p is None else {"f": f"{line.f:.3g}", "p": f"{line.p:.3g}"}),
                }
                for line in study.anova
            }
        )

    def _show_texts(self) -> None:
        self._appraiser.setItemText(0, self.tr("operators"))
        self._appraiser.setItemText(1, self.tr("stations"))
        for index in range(self._quantity.count()):
            self._quantity.setItemText(index, parameter_text(self._quantity.itemData(index)))
        self._show()


def _study(
    runs: RunColumns, name: str, size: float, by: Literal["operators", "stations"], tolerance: float
) -> tuple[GaugeStudy, int]:
    """Return the study of a parameter and its number of units; 1 in SI is `size`. Raises InputError."""
    values, appraisers = runs.values[name], getattr(runs, by)
    rows = [
        (runs.serials[k], appraisers[k] or "–", float(values[k]) * size) for k in np.flatnonzero(np.isfinite(values))
    ]
    parts, _, table = crossed(rows)
    return gauge_study(table, tolerance if np.isfinite(tolerance) else None), len(parts)


def _cells(found: Variation) -> dict[str, str]:
    cells = {
        "sigma": number(found.sigma, found.sigma),
        "interval": f"{number(found.low, found.sigma)} … {number(found.high, found.sigma)}",
        "study": f"{found.percent_study:.1f}",
    }
    if found.percent_tolerance is not None:
        cells["tolerance"] = f"{found.percent_tolerance:.1f}"
    return cells
