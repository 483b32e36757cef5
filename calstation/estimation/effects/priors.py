"""Prior sizes of effects before a calibration."""

from typing import NamedTuple

from calstation.estimation.common import SolveContext
from calstation.physics import EFFECTS, OUTER_LEVER, Effect, FloatArray


class EffectPrior(NamedTuple):
    """Means and standard deviations of the sizes of an effect, one per component; a sigma of 0 fixes a size."""

    mean: tuple[float, ...]
    sigma: tuple[float, ...]


_OFFSET = next(effect for effect in EFFECTS if effect.cause == "axis_offset")


def plausible(effect: Effect) -> EffectPrior:
    """Return the prior of an effect without further knowledge: mean 0 and its plausible size."""
    count = len(effect.components)
    return EffectPrior(count * (0.0,), count * (effect.plausible or float("nan"),))


def known_effects(before: FloatArray, context: SolveContext) -> dict[str, EffectPrior]:
    """Return the priors of the effects for which the profiles of table and IMU give values, by cause.

    Without a state `axis_offset`, the profile of the table bounds the offset. If the outer lever arm is estimated, it
    includes any offset along the inner axis, which is therefore fixed to the value in the profile. A low-pass in the
    profile of the IMU has been removed from the samples as a first-order filter; for other filters with the same
    bandwidth, the variance of the impulse response is between 0 and twice the first-order value.

    Parameters
    ----------
    before : sigmas of the parameters before calibration, shape (30,)
    context : models of table and IMU, and the effects that are estimated without a bound
    """
    table, half_variance = context.table, context.imu.half_variance
    sigma = plausible(_OFFSET).sigma[0] if _OFFSET.cause in context.states else table.axis_offset_sigma
    priors = {_OFFSET.cause: EffectPrior(table.axis_offset, (sigma, 0.0 if before[OUTER_LEVER].any() else sigma))}
    if half_variance:
        priors["low_pass"] = EffectPrior((0.0,), (half_variance,))
    return priors


def possible_signs(context: SolveContext) -> dict[str, int]:
    """Return the sign of each size that can have only one sign, by cause.

    The size of a low-pass is negative only if the low-pass in the profile of the IMU is stronger than the real one. A
    coning compensation is missing either in the data or in the profile.
    """
    coning = {"coning": -1 if context.imu.coning_compensated else 1}
    return coning if context.imu.half_variance else {"low_pass": 1, **coning}
