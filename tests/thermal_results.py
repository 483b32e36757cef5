"""A result over temperature, fitted to solutions that are drawn at every temperature, without samples."""

from dataclasses import replace

import numpy as np

from calstation.config import RunRequest, library, load_configuration
from calstation.estimation import Solution
from calstation.estimation.common import Consistency, Posterior
from calstation.estimation.temperature import TemperaturePoint, fit_temperature, held_out_points
from calstation.judgement import End, judge, verdict_of
from calstation.physics import INDEX, NAMES, PARAMETERS
from calstation.records import LogFacts, LogMeta, TemperatureSection
from calstation.results import Ending, Result, build_result

TEMPERATURES = (25.0, -40.0, -15.0, -10.0, 10.0, 40.0, 60.0, 85.0, 50.0, 0.0, 25.0)
SECTION = TemperatureSection(
    range_c=(-40.0, 85.0),
    order={"gyro_bias": 3, "gyro_scale": 2, "accel_bias": 2, "accel_scale": 1},
    rate_term=["gyro_bias"],
    held_out_c=[-10.0, 60.0],
)
#: Sizes of the values in units of the limits of the product.
_SIZE = 0.3


def thermal_meta(product: str = "mems_c_fast") -> LogMeta:
    """Return the configuration of a log of the stage temperature."""
    resolved = load_configuration(RunRequest("SN-000001", product=library.find("products", product)))
    meta = resolved.log_meta().model_copy(update={"temperature": SECTION, "run": None})
    return meta.model_copy(update={"product": meta.product.model_copy(update={"checks": None})})


def thermal_solution(meta: LogMeta, *, hysteresis: float = 0.0, seed: int = 1) -> tuple[Posterior, Solution]:
    """Return the prior and the solution of a unit whose gyro bias x has a hysteresis, in units of its limit."""
    random, model = np.random.default_rng(seed), SECTION.model()
    limits = [meta.product.limits[p.group] for p in PARAMETERS]
    sizes = np.array([limit.within for limit in limits])
    sigma = 0.3 * np.array([limit.sigma_below for limit in limits])
    prior = Posterior(np.zeros(len(NAMES)), np.diag(sizes**2))
    scaled = np.array([_SIZE * sizes[c.parameter] * random.normal() * 0.5 ** (c.power or 0) for c in model.columns])
    scaled[[c.power is None for c in model.columns]] *= 0.1
    covariance = np.outer(sigma, sigma) * (0.8 * np.eye(len(sigma)) + 0.2)
    points = []
    for k, t in enumerate(TEMPERATURES):
        way = "soak" if k == 0 else "up" if t > TEMPERATURES[k - 1] else "down"
        step = hysteresis * {"up": 0.5, "down": -0.5, "soak": 0.0}[way]
        rate = {"up": 1e-3, "down": -1e-3, "soak": 0.0}[way] * (k % 3)
        truth = model.basis(t, rate) @ scaled
        truth[INDEX["gyro_bias_x"]] += step * sizes[0]
        posterior = Posterior(random.multivariate_normal(truth, covariance), covariance)
        points.append(TemperaturePoint(t, rate, 600.0 * k, way, 1000 * k, 1000 * k + 999, prior, posterior))
    fit = fit_temperature(model, held_out_points(points, model.held_out), prior)
    solution = Solution("temperature", fit.at(model.reference), NAMES, Consistency(1.0, 0.9, 1.1, 1000))
    held_out = fit.held_out_test(NAMES)
    return prior, replace(solution, temperature=fit, tests=(fit.test, held_out), details={"points": len(points)})


def thermal_result(**changes: float) -> Result:
    """Return the result of such a unit; see `thermal_solution`."""
    meta = thermal_meta()
    prior, solution = thermal_solution(meta, **changes)
    judgement = judge(meta, prior, (solution,))
    facts = LogFacts(
        sha256="0" * 64, first_seq=0, last_seq=10_999, samples=11_000, gaps=0, temperature=(25.0, -40.0, 85.0)
    )
    verdict = verdict_of(End.COMPLETED, judgement.passed, partial=False)
    return build_result(meta, prior, (solution,), judgement, Ending(verdict, "SN-000001.h5", facts))
