"""Shortening of a product's stages within its limits by faster moves, shorter rests, and fewer turns and rounds."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calstation.config import RunRequest, check_manual_rig, edit_toml, load_configuration, schedule_fields
from calstation.designer.design import SERIAL, DesignRequest, Reached, gravity_rest, speeds, stages_duration
from calstation.errors import ConfigurationError
from calstation.jobs import ProgressCallback
from calstation.physics import NAMES, FloatArray
from calstation.results import Preview, compute_preview
from calstation.schema import KeyPath

#: Factors by which the search reduces a value, in order.
_FACTORS = (0.5, 0.7, 0.85)
#: Rests are multiples of this, s.
_UNIT = 0.5

#: Values of schedules changed by the search, by stage.
Values = dict[str, dict[str, float]]


@dataclass(frozen=True)
class ShorterStages(Reached):
    """Shorter schedules of the same stages; `sigma` is the sigma after the last stage."""

    schedule: Values  #: Changed values, by stage.
    duration: float  #: Duration of all stages, s.
    present: float  #: Duration of the product's current stages, s.
    gravity_rest: float | None  #: Shortest rest, s, suitable for the product's gravity check; None without this check.
    seconds: float  #: Duration of the search, s.
    #: Parameters that the stages, like the current stages, do not determine, so that every run fails.
    undetermined: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return the result as JSON data."""
        return {
            "schema": "calstation.stages/1",
            "duration_s": self.duration,
            "default_duration_s": self.present,
            "worst_sigma_over_limit": self.worst,
            "limiting": self.limiting,
            "undetermined": list(self.undetermined),
            "schedule": self.schedule,
            "search_s": self.seconds,
        }


def shorten_stages(report: ProgressCallback, request: DesignRequest) -> ShorterStages:
    """Job: shorten the stages of a product as long as all sigmas stay within their limits times the margin.

    Raises ConfigurationError if the current stages do not meet the limits.
    """
    return _Shortening(report, request).run()


def shorter_product(text: str, shorter: ShorterStages) -> str:
    """Return the text of a product file with the shorter stages."""
    changes: dict[KeyPath, Any] = {
        ("schedule", stage, name): value for stage, values in shorter.schedule.items() for name, value in values.items()
    }
    if shorter.gravity_rest is not None:
        changes["checks", "gravity_at_rest", "shortest_rest_s"] = shorter.gravity_rest
    return edit_toml(text, changes)


class _Shortening:
    def __init__(self, report: ProgressCallback, request: DesignRequest) -> None:
        self._report, self._request = report, request
        self._start_time = time.monotonic()
        self._run = RunRequest(SERIAL, request.station, request.product, out=Path("nowhere"))
        #: Factor of the limits; with `as_present`, it allows for rounding errors.
        self._margin = 1.0 + 1e-9 if request.as_present else request.margin
        setup = load_configuration(self._run)
        check_manual_rig(setup)
        self._schedules = setup.schedules
        self._rest = gravity_rest(setup.product, setup.solve_context())
        self._speeds = dict(zip(("rate_dps", "acceleration_dps2"), speeds(setup, request), strict=True))
        self._product = setup.product.name
        first = self._preview({})
        self._undetermined = set(first.undetermined)
        self._present, sigma = first.duration, self._sigma(first)
        limits = setup.sigma_limits()
        estimated = np.array([any(name in stage.estimated for stage in first.stages) for name in NAMES])
        required = sigma if request.as_present else np.array([limits.get(name, np.inf) for name in NAMES])
        self._limits = np.where(estimated, required, np.inf)

    def run(self) -> ShorterStages:
        """Reduce one value at a time, starting with the reduction that saves most time."""
        fields = {stage: {field.name for field in schedule_fields(stage)} for stage in self._schedules}
        values: Values = {
            stage: {name: speed for name, speed in self._speeds.items() if name in names}
            for stage, names in fields.items()
        }
        best = self._preview(values)
        if not self._reached(best):
            values = {stage: {} for stage in self._schedules}
            best = self._preview(values)
        if not self._reached(best):
            raise ConfigurationError("design.stages_miss", parameter=Reached(self._sigma(best), self._limits).limiting)
        for number, factor in enumerate(_FACTORS):
            attempted: set[tuple[str, str, float]] = set()
            while (improved := self._improve(values, factor, attempted)) is not None:
                values, best = improved
                saved = 1.0 - best.duration / self._present
                self._report((number + saved) / len(_FACTORS), note=f"{best.duration:.1f}")
        spent = time.monotonic() - self._start_time
        found = self._sigma(best), self._limits, values, best.duration, self._present, self._rest, spent
        return ShorterStages(*found, best.undetermined)

    def _improve(
        self, values: Values, factor: float, attempted: set[tuple[str, str, float]]
    ) -> tuple[Values, Preview] | None:
        """Return the values after the reduction that saves the most time within the limits, or None."""
        reduced = sorted(self._reduced(values, factor), key=lambda change: self._duration(change[1]) or 0.0)
        for change, new in reduced:
            if change in attempted:
                continue
            attempted.add(change)
            preview = self._preview(new)
            if self._reached(preview):
                return new, preview
        return None

    def _reduced(self, values: Values, factor: float) -> Iterator[tuple[tuple[str, str, float], Values]]:
        """Yield every reduction of one rest or count by a factor, and the values after it."""
        for stage, schedule in self._schedules.items():
            for field in schedule_fields(stage):
                rest = field.name.endswith("dwell_s")
                if not rest and field.name not in ("turns", "rounds"):
                    continue
                old = values[stage].get(field.name, float(getattr(schedule, field.name)))
                step = _UNIT if rest else 1.0
                lowest = max(float(field.low or 0.0), step, self._rest or 0.0 if field.name == "dwell_s" else 0.0)
                new = max(float(np.floor(old * factor / step) * step), lowest)
                if new < old:
                    value = new if rest else int(new)
                    changed = {**values, stage: {**values[stage], field.name: value}}
                    yield (stage, field.name, new), changed

    def _duration(self, values: Values) -> float | None:
        return stages_duration(load_configuration(replace(self._run, schedule=values)))

    def _preview(self, values: Values) -> Preview:
        return compute_preview(lambda *_, **__: None, replace(self._run, schedule=values))

    def _reached(self, preview: Preview) -> bool:
        sigma = preview.stages[-1].sigma
        if sigma is None or not self._undetermined.issuperset(preview.undetermined):
            return False
        return bool(np.all(sigma <= self._margin * self._limits))

    def _sigma(self, preview: Preview) -> FloatArray:
        """Return the sigmas after the last stage. Raises ConfigurationError if the table cannot execute the stages."""
        sigma = preview.stages[-1].sigma
        if sigma is None:
            raise ConfigurationError("design.no_present", product=self._product)
        return sigma
