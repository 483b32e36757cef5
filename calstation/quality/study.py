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
from calstation.quality.summary import limit_interval
from calstation.results import History


@dataclass(frozen=True)
class StudyState:
    """A plan, and what the stored runs say about it."""

    plan: GaugePlan
    left: tuple[Measurement, ...]  #: Runs that are still missing, in order.
    studies: Mapping[str, GaugeStudy]  #: By parameter, SI; empty while runs are missing.


def evaluate_study(report: ProgressCallback, folder: Path, path: Path, product: Path | None) -> StudyState:
    """Job: read a plan and evaluate it from the runs of a folder, whose index is up to date.

    The tolerances are the widths of the limits of `product`; None for no tolerance. Raises InputError or
    ConfigurationError if the plan or the product cannot be used, or if runs of the plan are of another product.
    """
    plan = GaugePlan.load(path)
    limits = None if product is None else load_product(product)[1]
    runs = History(folder).columns()
    left = tuple(plan.remaining(runs))
    others = sorted(name or "–" for name in plan.products(runs) if limits is not None and name != limits.name)
    if limits is not None and others:
        raise InputError("quality.study_other_product", product=limits.name, others=", ".join(others))
    studies = {}
    for name, values in ({} if left else plan.values(runs)).items():
        if name in NAMES or further_parameter(name) is not None:
            interval = None if limits is None else limit_interval(limits, name)
            studies[name] = gauge_study(values, None if interval is None else interval[1] - interval[0])
    return StudyState(plan, left, studies)
