"""Keeps registers that an earlier run estimated much more accurately than a partial run, unless they contradict it.

The other parameters are conditioned on them, so that the registers remain consistent. A full calibration keeps none.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from calstation.estimation.common import Belief
from calstation.physics import INDEX, display, number

#: Ratio of the current to the previous sigma above which the previous value is kept.
BETTER = 2.0

#: Difference in combined sigmas above which the unit has changed and the previous value is discarded.
_CONTRADICTED = 6.0


@dataclass(frozen=True)
class VerifiedRegister:
    """A register that a run wrote and verified: value and sigma, SI, and the start of the run, ISO 8601."""

    value: float
    sigma: float
    started_utc: str


@dataclass(frozen=True)
class PreviousValue:
    """A parameter that an earlier run estimated much more accurately, and its current estimate, SI."""

    name: str
    before: VerifiedRegister
    now: float
    sigma: float
    contradicted: bool

    def values(self) -> dict[str, Any]:
        """Return the values of its message, with units that are the same in every language."""
        return {
            "parameter": self.name,
            "before": _sigma(self.name, self.before.sigma),
            "now": _sigma(self.name, self.sigma),
            "date": self.before.started_utc[:10],
        }

    def to_json(self) -> dict[str, Any]:
        """Return the entry for the result JSON."""
        now = {"sigma_now": self.sigma, "value_now": self.now}
        return {"sigma": self.before.sigma, **now, "from": self.before.started_utc}


def better_previous_values(
    held: Mapping[str, float],
    belief: Belief,
    estimated: Iterable[str],
    previous: Mapping[str, VerifiedRegister],
    *,
    after_registers: bool,
) -> tuple[PreviousValue, ...]:
    """Find the estimated parameters that an earlier run estimated much more accurately.

    `held` contains the unit's current registers by parameter, SI; a register changed since its verification is ignored.
    `belief` is the posterior of this run, `previous` contains the registers written and verified by earlier runs. If
    the registers are applied to the stream (`after_registers`), this run estimates the remaining error.
    """
    better = []
    for name in estimated:
        before = previous.get(name)
        if before is None or name not in held or not abs(held[name] - before.value) <= before.sigma:
            continue
        i = INDEX[name]
        sigma = float(np.sqrt(belief.covariance[i, i]))
        if not BETTER * before.sigma < sigma:
            continue
        now = float(belief.mean[i]) + (held[name] if after_registers else 0.0)
        apart = abs(now - held[name]) > _CONTRADICTED * float(np.hypot(sigma, before.sigma))
        better.append(PreviousValue(name, before, now, sigma, apart))
    return tuple(better)


def condition_on(
    belief: Belief, kept: Iterable[PreviousValue], held: Mapping[str, float], *, after_registers: bool
) -> Belief:
    """Condition the posterior on the previous values to keep; other arguments are as in `better_previous_values`."""
    chosen = tuple(kept)
    if not chosen:
        return belief
    index = [INDEX[k.name] for k in chosen]
    value = np.array([0.0 if after_registers else held[k.name] for k in chosen])
    innovation = value - belief.mean[index]
    covariance = belief.covariance[np.ix_(index, index)] + np.diag([k.before.sigma**2 for k in chosen])
    scale = np.sqrt(np.diag(covariance))  # units differ by many powers of ten
    gain = np.linalg.solve(covariance / np.outer(scale, scale), (belief.covariance[index] / scale[:, None])).T
    after = belief.covariance - gain @ (belief.covariance[index] / scale[:, None])
    return Belief(belief.mean + gain @ (innovation / scale), 0.5 * (after + after.T))


def _sigma(name: str, sigma: float) -> str:
    shown, unit = display(name, sigma)
    return f"{number(shown, shown)} {unit}"
