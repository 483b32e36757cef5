"""Summary of a folder's runs: yield, and charts and capability of every parameter."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from calstation.config import ProductConfig, library, load_product
from calstation.errors import ConfigurationError
from calstation.jobs import ProgressCallback
from calstation.physics import INDEX, FloatArray, entry_of, further_parameter
from calstation.quality.capability import Capability, capability
from calstation.quality.charts import (
    RULES,
    CusumChart,
    EwmaChart,
    IndividualsChart,
    cusum_chart,
    ewma_chart,
    individuals_chart,
    standardised,
)
from calstation.quality.yields import Share, Yields, count_yields, judged_runs, production_runs
from calstation.records import RunColumns, RunFilter
from calstation.results import History

#: Fewest values of a parameter for charts and capability.
LEAST_VALUES = 10


@dataclass(frozen=True)
class ParameterQuality:
    """A parameter of a product over time: one value per unit, or all of one unit."""

    product: str
    parameter: str
    names: tuple[str, ...]  #: Runs of the values: file names of the logs without suffix.
    started: FloatArray  #: Their starts, s since 1970 in UTC, shape (n,).
    individuals: IndividualsChart
    ewma: EwmaChart
    cusum: CusumChart
    capability: Capability | None  #: None without a limit, or for one unit.

    def to_json(self) -> dict[str, Any]:
        """Return numbers and signals, SI; `run` is the name of a run."""
        chart, names = self.individuals, self.names
        return {
            "product": self.product,
            "parameter": self.parameter,
            "count": len(names),
            "center": chart.center,
            "sigma": chart.sigma,
            "low": chart.low,
            "high": chart.high,
            "range_center": chart.range_center,
            "range_high": chart.range_high,
            "signals": [
                {"run": names[k], "rule": rule}
                for k, rule in zip(chart.signals.index.tolist(), chart.signals.rule.tolist(), strict=True)
            ],
            "range_signals": [names[k] for k in chart.range_signals],
            "ewma_signals": [names[k] for k in self.ewma.signals],
            "cusum_signals_high": [names[k] for k in self.cusum.signals_high],
            "cusum_signals_low": [names[k] for k in self.cusum.signals_low],
            "capability": None if self.capability is None else asdict(self.capability),
        }

    @property
    def alarms(self) -> dict[str, int]:
        """Number of signals by rule, and of the other charts."""
        signals = self.individuals.signals
        return {
            **{f"rule {rule}": signals.count(rule) for rule in RULES},
            "ewma": len(self.ewma.signals),
            "cusum": len(self.cusum.signals_high) + len(self.cusum.signals_low),
        }


@dataclass(frozen=True)
class QualitySummary:
    """Quality of the runs of a folder."""

    product: str | None  #: The selected product; None for all.
    yields: Yields
    parameters: tuple[ParameterQuality, ...]  #: One value per unit.
    serial: str | None  #: The golden unit, which counts for nothing else; None without one.
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
                "failed_checks": [asdict(check) for check in found.failed_checks],
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
    folder
        Folder of the runs, whose index is up to date, see `calstation.results.refresh_history`.
    product
        Product file, whose limits apply; by default all products, with the limits of the product file of their name.
    serial
        Golden unit: its runs are charted one by one. They do not count for the yield and the other charts, in which
        each unit counts with its last run; nor do runs of check standards, by their result or by a product of today.
    parameter
        Parameter that is charted; by default all.
    since
        Earliest start of the runs.
    relative
        Whether to chart (value - mean) / sigma, with each run's own sigma, for runs of several schedules; then there
        is no capability.

    Raises
    ------
    ConfigurationError
        The product file is wrong.
    """
    chosen = None if product is None else load_product(product)[1]
    runs = History(folder).columns(RunFilter(product="" if chosen is None else chosen.name))
    begin = -math.inf if since is None else since.timestamp()
    limits = dict(_products()) if chosen is None else {chosen.name: chosen}
    standards = {standard.serial for each in limits.values() for standard in each.check_standards}
    standards |= set() if serial is None else {serial}
    yields = count_yields(runs, begin, standards)
    report(0.4)
    found: list[ParameterQuality] = []
    golden: list[ParameterQuality] = []
    names = sorted({name for name in runs.products if name is not None})
    production = set(production_runs(runs, standards))
    for done, name in enumerate(names):
        rows = [k for k in judged_runs(runs) if runs.products[k] == name and runs.started[k] >= begin]
        units = last_of_each_unit(runs, [k for k in rows if k in production])
        found += _charts(runs, name, units, parameter, None if relative else limits.get(name), relative=relative)
        alone = [k for k in rows if runs.serials[k] == serial]
        golden += _charts(runs, name, alone, parameter, None, relative=relative)
        report(0.4 + 0.6 * (done + 1) / len(names))
    return QualitySummary(None if chosen is None else chosen.name, yields, tuple(found), serial, tuple(golden))


def last_of_each_unit(runs: RunColumns, rows: Sequence[int]) -> list[int]:
    """Return the last run of each unit among runs of a product, so that a repeated unit counts once, in their order."""
    return sorted({runs.serials[k]: k for k in rows}.values())


def limit_interval(product: ProductConfig, parameter: str) -> tuple[float, float] | None:
    """Return the lowest and highest value of a parameter that a product permits, SI; None without a limit."""
    limit = entry_of(product.limits, parameter)
    return None if limit is None else limit.interval


def _charts(
    runs: RunColumns,
    product: str,
    rows: Sequence[int],
    parameter: str | None,
    limits: ProductConfig | None,
    *,
    relative: bool,
) -> Iterator[ParameterQuality]:
    """Yield charts and capability of the parameters that have enough values."""
    runs_of_product = np.array(rows, dtype=np.int64)
    names = tuple(runs.names[k] for k in rows)
    for name, column in runs.values.items():
        index = runs_of_product[~np.isnan(column[runs_of_product])]
        unknown = name not in INDEX and further_parameter(name) is None  # of another version of the program
        if unknown or parameter not in (None, name) or len(index) < LEAST_VALUES:
            continue
        values = column[index]
        if relative:
            values = standardised(values, float(values.mean()), runs.sigmas[name][index])
        if not np.ptp(values) > 0.0:
            continue  # held at a fixed value
        interval = None if limits is None else limit_interval(limits, name)
        yield ParameterQuality(
            product,
            name,
            names if len(index) == len(names) else tuple(runs.names[k] for k in index),
            runs.started[index],
            individuals_chart(values),
            ewma_chart(values),
            cusum_chart(values),
            None if interval is None else capability(values, *interval),
        )


def _products() -> Iterator[tuple[str, ProductConfig]]:
    """Yield the product files of the site and the shipped ones, by the name of the product."""
    for name in library.names("products"):
        with suppress(ConfigurationError):
            _, product = load_product(library.find("products", name))
            yield product.name, product


def _share_json(share: Share | None) -> Mapping[str, float] | None:
    return None if share is None else {**asdict(share), "value": share.value}
