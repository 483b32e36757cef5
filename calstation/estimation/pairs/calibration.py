"""One secondary against its primary: checked at a rest, calibrated from synchronous motion, stored for what follows."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from calstation.errors import InputError
from calstation.estimation.common.context import Belief, Secondary, SolveContext, StoredPair
from calstation.estimation.common.stage_data import StageData
from calstation.estimation.common.stillness import find_stillness
from calstation.estimation.pairs.faults import require_pairs, require_sense
from calstation.estimation.pairs.fit import PairChoice, PairFit, fit_pair
from calstation.estimation.pairs.signals import pair_data
from calstation.estimation.pairs.static import (
    SENSORS,
    RestDeviation,
    StaticCheck,
    Threshold,
    compensate_secondary,
    pair_vector,
    static_figures,
)
from calstation.physics.arrays import FloatArray
from calstation.physics.earth import normal_gravity
from calstation.physics.imu_model import compensate, compensation
from calstation.physics.parameters import PAIR_PARAMETERS


@dataclass(frozen=True)
class PairRules:
    """What counts as off, and what is fitted then.

    rest : length of a rest to check at, s; primary, secondary : thresholds by sensor
    choice : what is fitted; only_triggering : of it only the sensors that are off
    """

    rest: float
    primary: Mapping[str, Threshold]
    secondary: Mapping[str, Threshold]
    choice: PairChoice = field(default_factory=PairChoice)
    only_triggering: bool = False

    def chosen(self, check: StaticCheck) -> PairChoice:
        """What is fitted after a check that found a sensor off: nothing against one of the primary that is off."""
        c = self.choice
        fitted = check.off if self.only_triggering else [s for s in SENSORS if s not in check.doubtful]
        return PairChoice(
            c.gyro if "gyro" in fitted else None, c.accel if "accel" in fitted else None, c.lever, c.offset
        )


@dataclass(frozen=True)
class PairResult:
    """A fit and what is stored for it."""

    fit: PairFit
    stored: StoredPair


class PairCalibration:
    """What is known of the primary and its site, and the rules; acts on a stage's data."""

    def __init__(self, context: SolveContext, prior: Belief, rules: PairRules) -> None:
        site = context.site
        self._primary, self.rules = context.imu, rules
        self._c = compensation(prior.mean)
        self._gravity = site.gravity or normal_gravity(site.latitude, site.height)

    def last_rest(self, data: StageData) -> tuple[int, int] | None:
        """The last rest long enough to check at; None where there is none."""
        rests = find_stillness(data, self._primary, self.rules.rest).rests
        return rests[-1] if rests else None

    def check(
        self, data: StageData, rest: tuple[int, int], place: int, secondary: Secondary, stored: StoredPair
    ) -> StaticCheck | None:
        """Both units at a rest, the secondary (`place`d so in the rows) compensated with what is stored; None
        where it has no samples there."""
        a, b = rest
        pair = pair_data(data, place, secondary.imu)
        gyro2, accel2 = _mean(pair.gyro2[a:b]), _mean(pair.accel2[a:b])
        if gyro2 is None or accel2 is None:
            return None
        own = compensate(self._c, data.gyro[a:b].mean(axis=0)[None], data.accel[a:b].mean(axis=0)[None])
        other = compensate_secondary(pair_vector(stored), self._c, gyro2, accel2)
        first, second = (static_figures(w[0], f[0], self._gravity) for w, f in (own, other))
        last = {"gyro": stored.gyro_static, "accel": stored.accel_static}
        return StaticCheck(
            {s: RestDeviation(first[s], self.rules.primary[s].limit(None)) for s in SENSORS},
            {s: RestDeviation(second[s], self.rules.secondary[s].limit(last[s])) for s in SENSORS},
        )

    def calibrate(
        self, data: StageData, place: int, secondary: Secondary, choice: PairChoice, stored: StoredPair
    ) -> PairResult:
        """Fit from all of the data; what is stored for the sensors and terms that are not chosen stays.

        Raises InputError naming what makes the data worthless.
        """
        pair = pair_data(data, place, secondary.imu)
        require_pairs(pair, secondary.number, choice)
        try:
            fit = fit_pair(pair, self._primary, secondary.imu, self._c, choice, pair_vector(stored))
        except np.linalg.LinAlgError as exc:
            raise InputError(
                f"imu{secondary.number}: the motion does not determine what is asked for; turn about all axes"
            ) from exc
        require_sense(fit, secondary.number, choice)
        values = dict(zip((p.name for p in PAIR_PARAMETERS), fit.value.tolist(), strict=True))
        found = StoredPair({n: v for n, v in values.items() if fit.fitted[_PLACE[n]] or n in stored.values})
        rest = self.last_rest(data)
        check = None if rest is None else self.check(data, rest, place, secondary, found)
        if check is not None:
            shown = {s: check.secondary[s].value for s in SENSORS}
            found = StoredPair(found.values, shown["gyro"], shown["accel"])
        return PairResult(fit, found)


_PLACE = {p.name: i for i, p in enumerate(PAIR_PARAMETERS)}


def _mean(values: FloatArray) -> FloatArray | None:
    """Mean of the rows that are there, shape (1, 3); None where there are none."""
    there = values[~np.isnan(values).any(axis=1)]
    return there.mean(axis=0, keepdims=True) if len(there) else None
