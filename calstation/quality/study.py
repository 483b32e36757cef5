"""Evaluation of a planned study of repeatability and reproducibility from the stored runs."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from calstation.config import load_product
from calstation.errors import InputError
from calstation.jobs import ProgressCallback
from calstation.physics import NAMES, further_parameter
from calstation.quality.gauge import GaugeStudy, gauge_study
from calstation.quality.gauge_plan import GaugePlan, Measurement
from calstation.quality.runs import product_runs
from calstation.quality.summary import known_products, limit_interval


@dataclass(frozen=True)
class StudyState:
    """A plan and its evaluation from the stored runs."""

    plan: GaugePlan
    left: tuple[Measurement, ...]  #: Runs that are still missing, in order.
    out_of_order: int  #: Number of runs out of the planned order.
    studies: Mapping[str, GaugeStudy]  #: By parameter, SI; empty while runs are missing.


def evaluate_study(report: ProgressCallback, folder: Path, path: Path, product: Path | None) -> StudyState:
    """Job: read a plan and evaluate it from the runs of a folder, whose index is up to date.

    The tolerances are the widths of the limits of the plan's product, from the file `product` or by default from the
    known product with this name; an unknown product has none. Raises InputError or ConfigurationError if the plan or
    the product cannot be used, or if the plan is for another product.
    """
    plan = GaugePlan.load(path)
    limits = dict(known_products()).get(plan.product) if product is None else load_product(product)[1]
    if limits is not None and limits.name != plan.product:
        raise InputError("quality.study_other_product", product=limits.name, plan=plan.product)
    runs = product_runs(folder, plan.product)
    left = tuple(plan.remaining(runs))
    studies = {}
    values = {} if left else plan.values(runs)
    for done, (name, of_parameter) in enumerate(values.items(), 1):
        if name in NAMES or further_parameter(name) is not None:
            interval = None if limits is None else limit_interval(limits, name)
            tolerance = None if interval is None else interval[1] - interval[0]
            studies[name] = gauge_study(plan.factors, of_parameter, tolerance)
        report(done / len(values))
    return StudyState(plan, left, plan.out_of_order(runs), studies)
