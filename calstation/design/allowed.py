"""Constraints of table and unit: speeds, rests suitable for a check, and the duration of the current stages."""

import numpy as np

from calstation.config import ProductConfig, RunConfiguration
from calstation.design.design import DesignRequest
from calstation.devices.profiles import span
from calstation.errors import ConfigurationError
from calstation.estimation.common import SolveContext, rest_mean_variance
from calstation.sequencer import plan_time, table_task

#: Placeholder for the serial number of any unit of the product.
SERIAL = "design"
#: Fractions of the table's limits that a schedule uses.
_RATE, _ACCELERATION = 0.85, 0.75
#: Fraction of the gyro range that a move may use.
_RANGE = 0.8
#: Limit of the product's gravity check in sigmas of the force at a rest.
_GRAVITY_SIGMAS = 4.0


def speeds(setup: RunConfiguration, request: DesignRequest) -> tuple[float, float]:
    """Return rate, °/s, and acceleration, °/s², of all moves: from the request, or fractions of the limits."""
    limits, imu = setup.table.geometry().limits, setup.solve_context().imu
    per_count = imu.gyro_lsb * (imu.sample_rate if imu.output == "increment" else 1.0)
    ends = span(setup.imu.frame)
    reach = float(np.min(np.minimum(-ends.low[:3], ends.high[:3]))) * per_count
    both = 2.0**0.5  # two perpendicular joints that move simultaneously
    rate = np.rad2deg(min(_RATE * min(limits.rate), _RANGE * reach / both))
    acceleration = _ACCELERATION * np.rad2deg(min(limits.acceleration))
    return request.rate_dps or _rounded(rate), request.acceleration_dps2 or _rounded(acceleration)


def _rounded(value: float) -> float:
    """Return a positive number rounded down to two digits."""
    size = 10.0 ** np.floor(np.log10(value) - 1.0)
    return float(np.floor(value / size + 1e-9) * size)


def gravity_rest(product: ProductConfig, context: SolveContext) -> float | None:
    """Return the shortest rest, s, that is suitable for the product's gravity check; None without this check."""
    check = product.checks.gravity_at_rest if product.checks is not None else None
    if check is None:
        return None
    enough = (check.within / _GRAVITY_SIGMAS) ** 2
    rests = np.arange(1.0, check.shortest_rest_s, 0.5)
    return next((float(rest) for rest in rests if rest_mean_variance(context, rest) < enough), check.shortest_rest_s)


def stages_duration(setup: RunConfiguration) -> float | None:
    """Return the duration of all stages without targets, s; None if this table cannot execute them."""
    try:
        return sum(plan_time(s.steps(), s.rule, (0.0, 0.0), setup.table.settle_s) for s in table_task(setup).stages)
    except ConfigurationError:
        return None
