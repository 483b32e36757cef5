"""Summary of a folder's runs: yield, and charts and capability of every parameter."""

import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import datetime
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np

from calstation.config import CheckStandardSection, ProductConfig, library, load_product
from calstation.devices.profiles import load_imu_profile
from calstation.errors import ConfigurationError
from calstation.jobs import ProgressCallback
from calstation.judgement import reference_variances
from calstation.physics import INDEX, FloatArray, IntArray, entry_of, further_parameter
from calstation.quality.capability import Capability, capability
from calstation.quality.charts import (
    BASELINE,
    RULES,
    CusumChart,
    EwmaChart,
    IndividualsChart,
    Process,
    cusum_chart,
    ewma_chart,
    individuals_chart,
)
from calstation.quality.random_effects import RandomEffects, random_effects
from calstation.quality.runs import judged_runs, last_of_each_unit, product_runs, production_runs
from calstation.quality.yields import Share, Yields, count_yields
from calstation.records import RunColumns

#: Smallest number of values of a parameter for charts and capability.
LEAST_VALUES = 10


@dataclass(frozen=True)
class Charts:
    """Control charts of the same values."""

    individuals: IndividualsChart
    ewma: EwmaChart
    cusum: CusumChart

    def signals(self) -> dict[str, IntArray]:
        """Return the indices of values that signal: ``nelson_1`` to ``nelson_8``, ``range``, ``ewma``, ``cusum``."""
        found, cusum = self.individuals.signals, self.cusum
        nelson = {f"nelson_{rule}": found.index[found.rule == rule] for rule in RULES}
        both = np.flatnonzero(np.maximum(cusum.upper, cusum.lower) > cusum.decision)
        return {**nelson, "range": self.individuals.range_signals, "ewma": self.ewma.signals, "cusum": both}


@dataclass(frozen=True)
class ParameterQuality:
    """A parameter of a product over time: one value per unit, or all values of one unit."""

    product: str
    parameter: str
    names: tuple[str, ...]  #: File names of the logs of the runs, without suffix.
    started: FloatArray  #: Start times of the runs, s since 1970 in UTC, shape (n,).
    values: FloatArray  #: Charted values, SI or in standard deviations, shape (n,).
    process: Process
    alarms: Mapping[str, int]  #: Number of signals, see `Charts.signals`.
    latest: int | None  #: Index of the last value that signals.
    capability: Capability | None  #: None without a limit, or for one unit.
    declared: bool = False  #: Whether the center is the reference value of a check standard.
    effects: RandomEffects | None = None  #: Model that made values of several schedules comparable, SI.

    @classmethod
    def of(
        cls, product: str, parameter: str, names: tuple[str, ...], started: FloatArray, values: FloatArray, **more: Any
    ) -> "ParameterQuality":
        """Create the charts of values; `more` are the other fields, including the process."""
        signals = charts_of(values, more["process"]).signals()
        alarms = {code: len(found) for code, found in signals.items()}
        latest = max((int(found[-1]) for found in signals.values() if len(found)), default=None)
        return cls(product, parameter, names, started, values, alarms=alarms, latest=latest, **more)

    def charts(self) -> Charts:
        """Return the charts."""
        return charts_of(self.values, self.process)

    def to_json(self) -> dict[str, Any]:
        """Return numbers and signals, SI; `run` is the name of a run."""
        charts, names, process = self.charts(), self.names, self.process
        chart, found = charts.individuals, charts.individuals.signals
        return {
            "product": self.product,
            "parameter": self.parameter,
            "count": len(names),
            "center": process.center,
            "center_from": "reference" if self.declared else process.source,
            "sigma": process.sigma,
            "limits_from": process.source,
            "baseline": process.baseline,
            "between_units": None if self.effects is None else asdict(self.effects),
            "low": chart.low,
            "high": chart.high,
            "range_center": chart.range_center,
            "range_high": chart.range_high,
            "signals": [
                {"run": names[k], "rule": rule}
                for k, rule in zip(found.index.tolist(), found.rule.tolist(), strict=True)
            ],
            "range_signals": [names[k] for k in chart.range_signals],
            "ewma_signals": [names[k] for k in charts.ewma.signals],
            "cusum_signals_high": [names[k] for k in charts.cusum.signals_high],
            "cusum_signals_low": [names[k] for k in charts.cusum.signals_low],
            "capability": None if self.capability is None else asdict(self.capability),
        }


def charts_of(values: FloatArray, process: Process) -> Charts:
    """Return the control charts of values, shape (n,)."""
    center, sigma, widths = process.center, process.sigma, process.widths
    return Charts(
        individuals_chart(values, center, sigma, width=widths.individuals),
        ewma_chart(values, center, sigma, width=widths.ewma),
        cusum_chart(values, center, sigma, decision=widths.cusum),
    )


@dataclass(frozen=True)
class QualitySummary:
    """Quality of the runs of a folder."""

    product: str | None  #: The selected product; None for all.
    yields: Yields
    parameters: tuple[ParameterQuality, ...]  #: One value per unit.
    serial: str | None  #: The golden unit, which is excluded from everything else; None without one.
    golden: tuple[ParameterQuality, ...]  #: All runs of the golden unit.

    def to_json(self) -> dict[str, Any]:
        """Return everything, SI."""
        found = self.yields
        return {
            "schema": "calstation.quality/1",
            "product": self.product,
            "yield": {
                "overall": _share_json(found.overall),
                "first_pass": _share_json(found.first_pass),
                **{
                    kind: {name: _share_json(share) for name, share in getattr(found, kind).items()}
                    for kind in ("days", "products", "stations", "operators")
                },
                "failed_checks": [check.to_json() for check in found.failed_checks],
            },
            "parameters": [each.to_json() for each in self.parameters],
            "golden": None
            if self.serial is None
            else {"serial": self.serial, "parameters": [each.to_json() for each in self.golden]},
        }


def summarise_quality(
    report: ProgressCallback,
    folder: Path,
    product: Path | None = None,
    serial: str | None = None,
    parameter: str | None = None,
    since: datetime | None = None,
    *,
    relative: bool = False,
) -> QualitySummary:
    """Job: summarise the quality of the runs of a folder.

    Parameters
    ----------
    folder : folder of the runs, whose index is up to date, see `calstation.results.refresh_history`
    product : product file, whose limits apply; by default all products, with the limits of the product files with their
        names
    serial : golden unit: its runs are charted individually. They do not count for the yield and the other charts, in
        which each unit counts with its last run; nor do runs of check standards, according to their result or to a
        current product file.
    parameter : parameter that is charted; by default all
    since : earliest start of the runs
    relative : whether to chart deviations in standard deviations, for runs of several schedules; then there is no
        capability. For all units it is (x - mean) / sqrt(sigma² + tau²), with each run's own sigma, and mean and tau of
        the random effects model of the baseline. For a golden unit with a reference it is (x - reference) / sqrt(sigma²
        + sigma_ref² + change²), in which the unit's expected change is taken from its IMU profile.

    Raises
    ------
    ConfigurationError : the product file is wrong
    """
    chosen = None if product is None else load_product(product)[1]
    runs = product_runs(folder, "" if chosen is None else chosen.name)
    begin = -math.inf if since is None else since.timestamp()
    limits = dict(known_products()) if chosen is None else {chosen.name: chosen}
    standards = {standard.serial for each in limits.values() for standard in each.check_standards}
    standards |= set() if serial is None else {serial}
    yields = count_yields(runs, begin, standards)
    report(0.4)
    found: list[ParameterQuality] = []
    golden: list[ParameterQuality] = []
    names = sorted({name for name in runs.products.values if name is not None})
    late = runs.started >= begin
    production, of_serial = production_runs(runs, standards), judged_runs(runs)
    production = production[late[production]]
    of_serial = of_serial[(late & runs.serials.among(() if serial is None else (serial,)))[of_serial]]
    for done, name in enumerate(names):
        of_product, config = runs.products.among((name,)), limits.get(name)
        units, own = last_of_each_unit(runs, production[of_product[production]]), of_serial[of_product[of_serial]]
        found += _charts(runs, name, units, parameter, None if relative else config, relative=relative)
        known = None if config is None else _Reference.of(config, serial, runs.started[own])
        golden += _charts(runs, name, own, parameter, None, relative=relative, reference=known)
        report(0.4 + 0.6 * (done + 1) / len(names))
    return QualitySummary(None if chosen is None else chosen.name, yields, tuple(found), serial, tuple(golden))


def limit_interval(product: ProductConfig, parameter: str) -> tuple[float, float] | None:
    """Return the lowest and highest value of a parameter that a product permits, SI; None without a limit."""
    limit = entry_of(product.limits, parameter)
    return None if limit is None else limit.interval


@dataclass(frozen=True)
class _Reference:
    """Declared values of a check standard, and the variances of the true values about them for some runs."""

    standard: CheckStandardSection
    variances: Mapping[str, FloatArray]  #: SI, shape (n,).

    @classmethod
    def of(cls, product: ProductConfig, serial: str | None, started: FloatArray) -> "_Reference | None":
        standard = next((each for each in product.check_standards if each.serial == serial), None)
        if standard is None:
            return None
        imu = load_imu_profile(library.find("imus", product.imu))
        return cls(standard, reference_variances(standard, imu, started))


def _charts(
    runs: RunColumns,
    product: str,
    rows: IntArray,
    parameter: str | None,
    limits: ProductConfig | None,
    *,
    relative: bool,
    reference: _Reference | None = None,
) -> Iterator[ParameterQuality]:
    """Yield charts and capability of the parameters that have enough values."""
    names, started = tuple(map(runs.names.__getitem__, rows.tolist())), runs.started[rows]
    for name, column in runs.values.items():
        unknown = name not in INDEX and further_parameter(name) is None  # from another version of the program
        if unknown or parameter not in (None, name):
            continue
        values, sigmas = column[rows], runs.sigmas[name][rows]
        solved = ~np.isnan(values)
        if relative:
            solved &= sigmas > 0.0
        values, sigmas, whole = values[solved], sigmas[solved], bool(solved.all())
        if len(values) < LEAST_VALUES or not np.ptp(values) > 0.0:
            continue  # or a parameter held at a fixed value
        known = None if reference is None else reference.standard.reference.get(name)
        effects, process = None, Process(0.0, 1.0)
        if not relative:
            process = Process.estimated(values, None if known is None else known.value)
        elif known is not None and reference is not None:
            values = (values - known.value) / np.sqrt(sigmas**2 + reference.variances[name][solved])
        else:
            effects = random_effects(values[:BASELINE], sigmas[:BASELINE])
            values = effects.scores(values, sigmas)
            process = Process.estimated(values)
        interval = None if limits is None else limit_interval(limits, name)
        yield ParameterQuality.of(
            product,
            name,
            names if whole else tuple(compress(names, solved)),
            started if whole else started[solved],
            values,
            process=process,
            capability=None if interval is None else capability(values, *interval),
            declared=known is not None,
            effects=effects,
        )


def known_products() -> Iterator[tuple[str, ProductConfig]]:
    """Yield the site's and the shipped product files, with the name of the product."""
    for name in library.names("products"):
        with suppress(ConfigurationError):
            _, product = load_product(library.find("products", name))
            yield product.name, product


def _share_json(share: Share | None) -> Mapping[str, float] | None:
    return None if share is None else {**asdict(share), "value": share.value}
