"""The data for the charts of a certificate: limits, convergence, observability and rests."""

import math
from collections.abc import Sequence
from typing import Any

from calstation.judgement import COVERAGE_FACTOR
from calstation.messages import Language, term
from calstation.physics import INDEX, unit_of_parameter
from calstation.reports.analysis import Analysis
from calstation.reports.content import Quantity
from calstation.reports.numbers import check_unit
from calstation.results import Result


class Charts:
    """The charts of a certificate in one language; `groups` are its quantities by group."""

    def __init__(
        self, result: Result, analysis: Analysis, groups: Sequence[tuple[str, Sequence[Quantity]]], language: Language
    ) -> None:
        self._result, self._analysis, self._groups, self._language = result, analysis, groups, language

    def sections(self) -> dict[str, Any]:
        """Return the data of all charts."""
        analysis = self._analysis
        spans = [
            {"name": stage_name(stage, self._language), "begin": a / 60.0, "end": b / 60.0}
            for stage, (a, b) in analysis.spans.items()
        ]
        return {
            "limits": [chart for g, rows in self._groups if (chart := self._limits_chart(g, rows)) is not None],
            "time": analysis.time / 60.0,
            "spans": spans,
            "convergence": [self._convergence(*group) for group in self._groups if self._converges(group[1])],
            "observability": [
                {
                    "name": capitalised(term("group", group, self._language)),
                    "rows": [
                        {"axis": axis_of(group, q.name), "ratio": analysis.before[i] / analysis.after[i]}
                        for q in rows
                        if (i := INDEX[q.name]) is not None and analysis.after[i] > 0.0
                    ],
                }
                for group, rows in self._groups
                if rows[0].name in INDEX
            ],
            "rests": [chart for stage in analysis.rests if (chart := self._rests(stage))["series"]],
        }

    def _limits_chart(self, group: str, rows: Sequence[Quantity]) -> dict[str, Any] | None:
        points = []
        for q in rows:
            if q.limit is None or not all(map(math.isfinite, q.limit)):
                continue
            middle, half = 0.5 * (q.limit[0] + q.limit[1]), 0.5 * (q.limit[1] - q.limit[0])
            compared = self._result.worst(q.name)[0]
            points.append(
                {
                    "axis": axis_of(group, q.name),
                    "at": (compared.value - middle) / half,
                    "half": COVERAGE_FACTOR * compared.sigma / half,
                    "decision": q.decision,
                }
            )
        return {"name": capitalised(term("group", group, self._language)), "points": points} if points else None

    def _converges(self, rows: Sequence[Quantity]) -> bool:
        """Return whether a solver reported sigmas before the end of the stage."""
        names = [INDEX[q.name] for q in rows if q.name in INDEX]
        return bool(names) and bool((self._analysis.sigma[-2, names] != self._analysis.sigma[0, names]).any())

    def _convergence(self, group: str, rows: Sequence[Quantity]) -> dict[str, Any]:
        unit, size = unit_of_parameter(rows[0].name)
        limits = [q.sigma_limit for q in rows if q.sigma_limit is not None]
        return {
            "name": capitalised(term("group", group, self._language)),
            "unit": unit,
            "limit": min(limits) / size if limits else None,
            "lines": [
                {"axis": axis_of(group, q.name), "sigma": self._analysis.sigma[:, INDEX[q.name]] / size} for q in rows
            ],
        }

    def _rests(self, stage: str) -> dict[str, Any]:
        rests = self._analysis.rests[stage]
        (g_unit, g_size), (r_unit, r_size) = check_unit("m/s²"), check_unit("rad/s")
        series = [
            ("force", g_unit, rests.force / g_size, rests.force_sigma / g_size),
            ("vertical", r_unit, rests.vertical_rate / r_size, rests.rate_sigma / r_size),
            ("horizontal", r_unit, rests.horizontal_rate / r_size, rests.rate_sigma / r_size),
        ]
        # If the biases are not estimated, the output at rest is shown instead of residuals.
        solved_groups = {group for group, _ in self._groups}
        calibrated = {
            "force": "accel_bias" in solved_groups,
            "vertical": "gyro_bias" in solved_groups,
            "horizontal": "gyro_bias" in solved_groups,
        }
        return {
            "stage": stage_name(stage, self._language),
            "up": [rests.axis(k).replace("-", "−") for k in range(len(rests))],
            "series": [
                {"name": name, "unit": unit, "value": value, "sigma": sigma}
                for name, unit, value, sigma in series
                if calibrated[name] and len(rests)
            ],
        }


def axis_of(group: str, name: str) -> str:
    """Return the axes of a parameter and, if there are several secondaries, the number of the IMU."""
    number = "".join(filter(str.isdigit, name))
    axis = name.rpartition("_")[2] if name.translate(str.maketrans("", "", "0123456789")) != group else ""
    return f"{axis} ({number})" if number else axis


def capitalised(text: str) -> str:
    """Return a text with a capital first letter."""
    return text[:1].upper() + text[1:]


def stage_name(stage: str, language: Language) -> str:
    """Return the name of a stage in the terminology of certificates."""
    return in_certificate_terms(term("stage", stage, language))


def in_certificate_terms(text: str) -> str:
    """Replace terms of the user interface with those of certificates: in Chinese, 标定 with 校准."""
    return text.replace("标定", "校准")
