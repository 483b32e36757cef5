"""Monte Carlo study of decisions: how often decisions about units near their limits are wrong.

python -m tests.outside.conformity --units 400
"""

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from scipy.stats import binom

from calstation.bench import BenchConfig
from calstation.bench.truth import Simulator
from calstation.config import RunRequest, load_configuration
from calstation.estimation.common import SampleBlock
from calstation.judgement import judge
from calstation.physics import INDEX, NAMES, parameter_vector
from calstation.records import ConformitySection, Limit, Rule
from calstation.results import StageChain, one_blas_thread
from calstation.simulation import bench_config
from procedures import method

PRODUCT = Path("data/products/mems_c_fast.toml")
#: Spread of the units and magnitude of the limits, in sigmas of the measurement.
SPREAD, LIMIT = 4.0, 5.0
RULES: tuple[Rule, ...] = ("simple", "guard_band")


@dataclass(frozen=True)
class Decision:
    """A decision about a parameter of a unit, with the probabilities that the result states."""

    parameter: str
    rule: Rule
    accepted: bool
    conforms: bool  #: Whether the true value is within the limits.
    probability: float
    false_accept: float
    false_reject: float


def calibrate(seed: int, sigmas: dict[str, float] | None = None) -> tuple[list[Decision], dict[str, float]]:
    """Calibrate a unit with random true values of `SPREAD` times `sigmas`; return decisions and estimated sigmas.

    Without `sigmas`, a nominal unit of the grade is calibrated, without decisions.
    """
    resolved = load_configuration(RunRequest(f"SN-{seed:06d}", product=PRODUCT))
    meta, settings = resolved.log_meta(), bench_config(resolved)
    rng = np.random.default_rng(seed)
    truth = {name: float(rng.normal(0.0, SPREAD * sigma)) for name, sigma in (sigmas or {}).items()}
    config = BenchConfig.model_validate({**settings, "seed": seed, "flash_file": None, "parameters": truth})
    simulator, chain = Simulator(config.truth(), seed + 10_000), StageChain(meta)
    with one_blas_thread():
        for stage, schedule in resolved.schedules.items():
            s = simulator.run(method(stage).plan(resolved.table.geometry(), schedule), stage, None)
            valid = np.ones(len(s.seq), dtype=np.bool_)
            chain.start(stage)
            chain.feed(SampleBlock(stage, s.seq, s.time, s.counts, s.angles, s.step, valid, s.temperature))
            chain.finish()
    found = dict(zip(NAMES, map(float, chain.posterior.sigma), strict=True))
    if sigmas is None:
        return [], found
    y, decisions = simulator.parameters, []
    y = y if isinstance(y, np.ndarray) else parameter_vector(y)
    limits = {name: Limit(within=LIMIT * sigma) for name, sigma in sigmas.items()}
    for rule in RULES:
        conformity = ConformitySection(rule=rule, spread={name: SPREAD * sigma for name, sigma in sigmas.items()})
        assert meta.product is not None
        product = meta.product.model_copy(update={"limits": limits, "conformity": conformity, "checks": None})
        judged = meta.model_copy(update={"product": product})
        decided = judge(judged, chain.prior, tuple(chain.solutions)).conformity
        assert decided is not None
        for name, row in decided.parameters.items():
            assert row.false_accept is not None
            assert row.false_reject is not None
            conforms = abs(y[INDEX[name]]) <= LIMIT * sigmas[name]
            risks = (row.probability, row.false_accept, row.false_reject)
            decisions.append(Decision(name, rule, row.accepted, bool(conforms), *risks))
    return decisions, found


def decisions(units: int, first_seed: int = 1, workers: int = 2) -> Iterator[list[Decision]]:
    """Yield the decisions about each unit."""
    _, sigmas = calibrate(0)
    jobs = [(seed, sigmas) for seed in range(first_seed, first_seed + units)]
    if workers == 1:
        yield from (calibrate(*job)[0] for job in jobs)
        return
    with get_context("spawn").Pool(workers) as pool:
        yield from pool.imap(_decisions, jobs)


def _decisions(job: tuple[int, dict[str, float]]) -> list[Decision]:
    return calibrate(*job)[0]


@dataclass(frozen=True)
class Row:
    """Number of false decisions of a type by a rule, the predicted number, and its 99.9 % interval."""

    rule: str
    kind: str
    decisions: int
    observed: int
    predicted: float
    low: float
    high: float
    beyond: int  #: Parameters whose own number is outside their binomial interval of 99.9 %, of all 30.


def summary(found: list[list[Decision]]) -> list[Row]:
    """Compare false decisions with the probabilities of the results.

    The prediction uses the global probabilities of the product, and the sum of the specific probabilities of decisions.
    The number for one parameter is binomial. The errors of a unit's parameters are correlated, which widens the
    interval of their sum.
    """
    rows = []
    for rule in RULES:
        for kind in ("accept", "reject", "accept, specific", "reject, specific"):
            accept, specific = kind.startswith("accept"), kind.endswith("specific")
            per_unit, by_name = [], {}
            for unit in found:
                observed = predicted = 0.0
                for d in unit:
                    if d.rule != rule:
                        continue
                    wrong = d.accepted == accept and d.conforms != d.accepted
                    if specific:
                        p = d.probability if d.accepted == accept else 0.0
                    else:
                        p = d.false_accept if accept else d.false_reject
                    observed, predicted = observed + wrong, predicted + p
                    before = by_name.get(d.parameter, (0, 0.0))
                    by_name[d.parameter] = (before[0] + wrong, before[1] + p)
                per_unit.append((observed, predicted))
            o, p = np.array(per_unit).T
            count, total = len(o) * len(by_name), float(p.sum())
            # Correlated decisions are worth fewer: the ratio of the variance between units to the binomial one.
            effect = max(1.0, len(o) * float(np.var(o - p, ddof=1)) / (total * (1.0 - total / count)))
            low, high = (effect * edge for edge in binom.interval(0.999, round(count / effect), total / count))
            bands = {n: binom.interval(0.999, len(o), total / len(o)) for n, (_, total) in by_name.items()}
            beyond = sum(not bands[n][0] <= wrong <= bands[n][1] for n, (wrong, _) in by_name.items())
            rows.append(Row(rule, kind, count, int(o.sum()), total, low, high, beyond))
    return rows


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--units", type=int, default=100)
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    found = []
    for unit in decisions(args.units, workers=args.workers):
        found.append(unit)
        print(f"{len(found)}/{args.units}", file=sys.stderr, end="\r")
    for row in summary(found):
        print(json.dumps(row.__dict__))
    return 0


if __name__ == "__main__":
    sys.exit(main())
