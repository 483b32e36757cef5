"""Summary of a folder's runs: yield, and charts and capability of every parameter."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from datetime import datetime
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np

from calstation.config import CheckStandardSection, ProductConfig, known_products, library, load_product
from calstation.devices.profiles import load_imu_profile
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
from calstation.quality.gravity_shift import COMMON_SCALE, SCALES, common_scale
from calstation.quality.runs import (
    NOT_SIMULATED,
    SimulatedRuns,
    first_of_each_unit,
    judged_runs,
    last_of_each_unit,
    product_runs,
    production_runs,
)
from calstation.quality.yields import Share, Yields, count_yields
from calstation.records import RunColumns
from calstation.results import History

#: Smallest number of values of a parameter for charts and capability.
MIN_VALUES = 10
#: Relative change at which the iteration ends, and its maximum number of steps.
_CONVERGED, _STEPS = 1e-9, 100


@dataclass(frozen=True)
class RandomEffects:
    """Mean and variance between units of values with different uncertainties: the random effects model.

    A value x_i has the variance sigma_i² + tau², the sum of the measurement variance and the variance between units.
    Source: R. C. Paule and J. Mandel, *Consensus Values and Weighting Factors*, Journal of Research of the National
    Bureau of Standards 87(5), 1982, 377-385. Unlike the estimate of R. DerSimonian and N. Laird (Controlled Clinical
    Trials 7, 1986, 177-188), which is its first step, it is also accurate if tau is large compared with unequal sigmas.
    """

    mean: float  #: Mean with weights 1 / (sigma² + tau²).
    between: float  #: Standard deviation between units, tau.

    def scores(self, values: FloatArray, sigmas: FloatArray) -> FloatArray:
        """Return (x - mean) / sqrt(sigma² + tau²), which has variance 1, shape (n,)."""
        return np.asarray((values - self.mean) / np.hypot(sigmas, self.between))


def random_effects(values: FloatArray, sigmas: FloatArray) -> RandomEffects:
    """Estimate mean and standard deviation between units from values and their standard deviations, shape (n,).

    The weighted sum of squares about the mean decreases with tau² and is convex, so that Newton's method approaches its
    expectation n - 1 from above; tau is 0 if the sum does not exceed n - 1 for tau = 0.
    """
    variances, between = sigmas**2, 0.0
    for _ in range(_STEPS):
        weights = 1.0 / (variances + between)
        squares = weights * (values - np.average(values, weights=weights)) ** 2
        excess = float(squares.sum()) - (len(values) - 1)
        step = excess / float(np.sum(weights * squares)) if excess > 0.0 else 0.0
        between += step
        if step <= _CONVERGED * between:
            break
    return RandomEffects(float(np.average(values, weights=1.0 / (variances + between))), float(np.sqrt(between)))


@dataclass(frozen=True)
class Charts:
    """Control charts of the same values."""

    individuals: IndividualsChart
    ewma: EwmaChart
    cusum: CusumChart

    def signals(self) -> dict[str, IntArray]:
        """Return the indices of values that signal: ``nelson_1`` to ``nelson_8``, ``range``, ``ewma``, ``cusum``."""
        individuals, cusum = self.individuals.signals, self.cusum
        nelson = {f"nelson_{rule}": individuals.index[individuals.rule == rule] for rule in RULES}
        cusum_signals = np.flatnonzero(np.maximum(cusum.upper, cusum.lower) > cusum.decision)
        return {**nelson, "range": self.individuals.range_signals, "ewma": self.ewma.signals, "cusum": cusum_signals}

    def after(self, count: int) -> "Charts":
        """Return the charts without their first `count` values, which still affect later points."""
        return Charts(self.individuals.after(count), self.ewma.after(count), self.cusum.after(count))


@dataclass(frozen=True)
class ParameterQuality:
    """A parameter of a product over time: the first value of each unit, or all values of one unit."""

    product: str
    parameter: str  #: Name, or `COMMON_SCALE`.
    names: tuple[str, ...]  #: File names of the logs of the runs, without suffix.
    started: FloatArray  #: Start times of the runs, s since 1970 in UTC, shape (n,).
    values: FloatArray  #: Charted values, SI or in standard deviations, shape (n,).
    process: Process
    alarms: Mapping[str, int]  #: Number of signals, see `Charts.signals`.
    signalling: int  #: Number of values that signal.
    latest: int | None  #: Index of the last value that signals.
    capability: Capability | None  #: None without a limit, or for one unit.
    declared: bool = False  #: Whether the center is the reference value of a check standard.
    effects: RandomEffects | None = None  #: Model that made values of several schedules comparable, SI.
    baseline: int = 0  #: Number of the first values that belong to the baseline of the process.
    #: Charted values of earlier runs, with which averages, sums and patterns begin, shape (m,).
    earlier: FloatArray = field(default_factory=lambda: np.empty(0))
    #: Values of the last run of each unit in the period, from which the capability is computed, SI, shape (k,).
    last_values: FloatArray = field(default_factory=lambda: np.empty(0))

    @classmethod
    def of(
        cls, product: str, parameter: str, names: tuple[str, ...], started: FloatArray, values: FloatArray, **more: Any
    ) -> "ParameterQuality":
        """Create the charts of values; `more` are the other fields, including the process and the earlier values."""
        signals = _charts_after(more["earlier"], values, more["process"]).signals()
        alarms = {code: len(indices) for code, indices in signals.items()}
        signalling = np.unique(np.concatenate([*signals.values()]))
        latest = int(signalling[-1]) if len(signalling) else None
        more |= {"alarms": alarms, "signalling": len(signalling), "latest": latest}
        return cls(product, parameter, names, started, values, **more)

    def charts(self) -> Charts:
        """Return the charts."""
        return _charts_after(self.earlier, self.values, self.process)

    def to_json(self) -> dict[str, Any]:
        """Return values in SI and signals as JSON data; `run` is the name of a run."""
        charts, names, process = self.charts(), self.names, self.process
        chart, signals = charts.individuals, charts.individuals.signals
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
                for k, rule in zip(signals.index.tolist(), signals.rule.tolist(), strict=True)
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


def _charts_after(earlier: FloatArray, values: FloatArray, process: Process) -> Charts:
    """Return the charts of values, whose averages, sums and patterns begin with earlier values."""
    return charts_of(np.concatenate([earlier, values]), process).after(len(earlier))


@dataclass(frozen=True)
class QualitySummary:
    """Quality of the runs of a folder."""

    product: str | None  #: The selected product; None for all.
    yields: Yields
    parameters: tuple[ParameterQuality, ...]  #: Charts of each unit's first value, capability of last values.
    #: Unit that is charted individually and excluded from `yields` and `parameters`, if any.
    serial: str | None
    single_unit: tuple[ParameterQuality, ...]  #: All runs of the unit `serial`.
    chartable: int  #: Number of runs for `parameters`.
    unit_chartable: int  #: Number of runs for `single_unit`.
    stations: tuple[str, ...] = ()  #: All stations of the runs in the folder.
    simulated: SimulatedRuns = NOT_SIMULATED

    def to_json(self) -> dict[str, Any]:
        """Return all values in SI as JSON data."""
        yields = self.yields
        return {
            "schema": "calstation.quality/1",
            "product": self.product,
            "yield": {
                "overall": _share_json(yields.overall),
                "units": _share_json(yields.units),
                "first_pass": _share_json(yields.first_pass),
                **{
                    kind: {name: _share_json(share) for name, share in getattr(yields, kind).items()}
                    for kind in ("days", "products", "stations", "operators")
                },
                "failed_checks": [check.to_json() for check in yields.failed_checks],
                "partial_failed": yields.partial_failed,
                "missing": yields.missing,
            },
            "simulated": self.simulated.to_json(),
            "parameters": [each.to_json() for each in self.parameters],
            "golden": None
            if self.serial is None
            else {"serial": self.serial, "parameters": [each.to_json() for each in self.single_unit]},
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
    station: str = "",
) -> QualitySummary:
    """Job: summarise the quality of the runs of a folder; simulated runs are left out unless all are simulated.

    Parameters
    ----------
    folder : folder of the runs, whose index is up to date, see `calstation.results.refresh_history`
    product : product file, whose limits apply; by default all products, with the limits of the product files with their
        names
    serial : unit, such as a check standard, whose runs are charted individually. Its runs, and the runs of check
        standards according to their results or to a current product file, are excluded from everything else. The other
        charts use the first run of each unit, so that later runs change neither limits nor signals; the capability uses
        the last run of each unit.
    parameter : parameter that is charted; by default all
    since : earliest start of the runs; limits and signals of the charts do not depend on it, because baseline,
        averages, sums and patterns begin with the first runs of any time
    relative : whether to chart deviations in standard deviations, for runs of several schedules; then there is no
        capability. For all units it is (x - mean) / sqrt(sigma² + tau²), with each run's own sigma, and mean and tau of
        the random effects model of the baseline. For a single unit with reference values it is (x - reference) /
        sqrt(sigma² + sigma_ref² + change²), in which the unit's expected change is taken from its IMU profile.
    station : station of the runs, "" for all; the first and the last run of a unit are those at this station

    Raises
    ------
    ConfigurationError : if the product file cannot be used
    """
    chosen = None if product is None else load_product(product)[1]
    selection = folder, "" if chosen is None else chosen.name, station
    simulated = SimulatedRuns.among(*selection, since)
    runs = product_runs(*selection, measured=not simulated.only)
    start = -math.inf if since is None else since.timestamp()
    limits = dict(known_products()) if chosen is None else {chosen.name: chosen}
    standards = {standard.serial for each in limits.values() for standard in each.check_standards}
    standards |= set() if serial is None else {serial}
    yields = count_yields(runs, start, standards)
    report(0.4)
    parameters: list[ParameterQuality] = []
    single_unit: list[ParameterQuality] = []
    chartable = unit_chartable = 0
    names = sorted({name for name in runs.products.values if name is not None})
    in_period = runs.started >= start
    production, unit_runs = production_runs(runs, standards), judged_runs(runs)
    unit_runs = unit_runs[runs.serials.isin(() if serial is None else (serial,))[unit_runs]]
    for done, name in enumerate(names):
        of_product, config = runs.products.isin((name,)), limits.get(name)
        of_units = production[of_product[production]]
        units, last = first_of_each_unit(runs, of_units), last_of_each_unit(runs, of_units)
        unit_rows = unit_runs[of_product[unit_runs]]
        chartable += int(np.count_nonzero(in_period[units]))
        unit_chartable += int(np.count_nonzero(in_period[unit_rows]))
        limits_of = None if relative or config is None else _Limits(config, last[in_period[last]])
        parameters += _charts(runs, name, units, parameter, limits_of, start, relative=relative)
        reference = None if config is None else _Reference.of(config, serial, runs.started[unit_rows])
        single_unit += _charts(runs, name, unit_rows, parameter, None, start, relative=relative, reference=reference)
        report(0.4 + 0.6 * (done + 1) / len(names))
    return QualitySummary(
        None if chosen is None else chosen.name,
        yields,
        tuple(parameters),
        serial,
        tuple(single_unit),
        chartable,
        unit_chartable,
        History(folder).choices().stations,
        simulated,
    )


def limit_interval(product: ProductConfig, parameter: str) -> tuple[float, float] | None:
    """Return the lowest and highest value of a parameter that a product permits, SI; None without a limit."""
    limit = entry_of(product.limits, parameter)
    return None if limit is None else limit.interval


@dataclass(frozen=True)
class _Limits:
    """The product whose limits apply, and the last run of each unit in the period."""

    product: ProductConfig
    last: IntArray  #: Indices of the runs, shape (k,).

    def values(self, name: str, all_values: FloatArray) -> tuple[FloatArray, Capability | None]:
        """Return the last values of a parameter, SI, and their capability, None without a limit or with few values."""
        interval = None if name == COMMON_SCALE else limit_interval(self.product, name)
        values = all_values[self.last]
        values = values[~np.isnan(values)]
        enough = interval is not None and len(values) >= MIN_VALUES and np.ptp(values) > 0.0
        return values, capability(values, *interval) if enough and interval is not None else None


@dataclass(frozen=True)
class _Reference:
    """Declared values of a check standard, and the variances of its true values about them at n runs."""

    standard: CheckStandardSection
    variances: Mapping[str, FloatArray]  #: SI, shape (n,).

    @classmethod
    def of(cls, product: ProductConfig, serial: str | None, started: FloatArray) -> "_Reference | None":
        standard = next((each for each in product.check_standards if each.serial == serial), None)
        if standard is None:
            return None
        imu = load_imu_profile(library.find("imus", product.imu))
        return cls(standard, reference_variances(standard, imu, started))

    def declared(self, name: str) -> tuple[float, FloatArray] | None:
        """Return the reference value of a charted quantity and the variances about it, SI; None without a value."""
        parts = SCALES if name == COMMON_SCALE else (name,)
        values = [self.standard.reference[part].value for part in parts if part in self.standard.reference]
        if len(values) < len(parts):
            return None
        return float(np.mean(values)), np.sum([self.variances[part] for part in parts], axis=0) / len(parts) ** 2


def _charts(
    runs: RunColumns,
    product: str,
    rows: IntArray,
    parameter: str | None,
    limits: _Limits | None,
    start: float,
    *,
    relative: bool,
    reference: _Reference | None = None,
) -> Iterator[ParameterQuality]:
    """Yield charts and capability of the parameters that have enough values, and charts of `common_scale`.

    The charts show the runs that started at `start` or later, but are computed from the first of all `rows` on.
    """
    names, started = tuple(map(runs.names.__getitem__, rows.tolist())), runs.started[rows]
    columns = {name: (values, runs.sigmas[name]) for name, values in runs.values.items()}
    if (common := common_scale(runs)) is not None:
        columns[COMMON_SCALE] = common
    for name, (all_values, all_sigmas) in columns.items():
        # a parameter from another version of the program is unknown
        is_known = name in INDEX or further_parameter(name) is not None or name == COMMON_SCALE
        if not is_known or parameter not in (None, name):
            continue
        values, sigmas = all_values[rows], all_sigmas[rows]
        solved = ~np.isnan(values)
        if relative:
            solved &= sigmas > 0.0
        values, sigmas = values[solved], sigmas[solved]
        first = int(np.searchsorted(started[solved], start))
        if len(values) - first < MIN_VALUES or not np.ptp(values[first:]) > 0.0:
            continue  # too few values, or a fixed parameter
        declared = None if reference is None else reference.declared(name)
        effects, process = None, Process(0.0, 1.0)
        if not relative:
            process = Process.estimated(values, None if declared is None else declared[0])
        elif declared is not None:
            values = (values - declared[0]) / np.sqrt(sigmas**2 + declared[1][solved])
        else:
            effects = random_effects(values[:BASELINE], sigmas[:BASELINE])
            values = effects.scores(values, sigmas)
            process = Process.estimated(values)
        last_values, capable = (np.empty(0), None) if limits is None else limits.values(name, all_values)
        yield ParameterQuality.of(
            product,
            name,
            tuple(compress(names, solved))[first:],
            started[solved][first:],
            values[first:],
            earlier=values[:first],
            process=process,
            baseline=max(0, process.baseline - first),
            capability=capable,
            last_values=last_values,
            declared=declared is not None,
            effects=effects,
        )


def _share_json(share: Share | None) -> Mapping[str, float] | None:
    return None if share is None else {**asdict(share), "value": share.value}
