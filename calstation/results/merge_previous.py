"""Which registers part of a calibration leaves alone: those that an earlier one has found far better.

A part of the stages (scale factors only, say) finds a parameter more coarsely than the whole calibration before it did.
Where that calibration's value is still in the unit and nothing contradicts it, it stays, and what is written beside it
is the answer of this run given that value: parameters that were found together fit together. The whole calibration
keeps nothing.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from calstation.estimation.common.context import Belief
from calstation.physics.parameters import INDEX
from calstation.physics.units import display, number

#: An earlier sigma this many times smaller than the present one is worth keeping.
BETTER = 2.0

#: Sigmas of both values together; further apart the unit has changed, and what it was is worth nothing.
_CONTRADICTED = 6.0


@dataclass(frozen=True)
class VerifiedRegister:
    """A register as a run wrote and proved it: value and sigma, SI; when that run was begun, ISO 8601."""

    value: float
    sigma: float
    started_utc: str


@dataclass(frozen=True)
class PreviousValue:
    """A parameter that was found far better before, and what it is found to be now; SI."""

    name: str
    before: VerifiedRegister
    now: float
    sigma: float
    contradicted: bool

    def values(self) -> dict[str, Any]:
        """What its message says, with units that read the same in every language."""
        return {
            "parameter": self.name,
            "before": _sigma(self.name, self.before.sigma),
            "now": _sigma(self.name, self.sigma),
            "date": self.before.started_utc[:10],
        }

    def to_json(self) -> dict[str, Any]:
        """As a result holds it."""
        return {
            "sigma": self.before.sigma,
            "sigma_now": self.sigma,
            "value_now": self.now,
            "from": self.before.started_utc,
        }


def better_previous_values(
    held: Mapping[str, float],
    belief: Belief,
    estimated: Iterable[str],
    in_force: Mapping[str, VerifiedRegister],
    *,
    after_registers: bool,
) -> tuple[PreviousValue, ...]:
    """Parameters that were found far better before, of those estimated now.

    Parameters
    ----------
    held : the unit's registers now, by parameter, SI; one that was changed since by other hands is worth nothing
    after_registers : the stream follows the registers, so that what is found now is what they leave over
    """
    better = []
    for name in estimated:
        before = in_force.get(name)
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
    """What is known of all parameters, given that the kept ones are what the registers say; arguments as above."""
    chosen = tuple(kept)
    if not chosen:
        return belief
    index = [INDEX[k.name] for k in chosen]
    value = np.array([0.0 if after_registers else held[k.name] for k in chosen])
    innovation = value - belief.mean[index]
    covariance = belief.covariance[np.ix_(index, index)] + np.diag([k.before.sigma**2 for k in chosen])
    scale = np.sqrt(np.diag(covariance))  # units are apart by many powers of ten
    gain = np.linalg.solve(covariance / np.outer(scale, scale), (belief.covariance[index] / scale[:, None])).T
    after = belief.covariance - gain @ (belief.covariance[index] / scale[:, None])
    return Belief(belief.mean + gain @ (innovation / scale), 0.5 * (after + after.T))


def _sigma(name: str, sigma: float) -> str:
    shown, unit = display(name, sigma)
    return f"{number(shown, shown)} {unit}"
