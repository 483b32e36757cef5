"""Evaluation of a product's acceptance checks for a calibration."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from calstation.estimation import Diagnosis, Solution
from calstation.estimation.common import Posterior, SolveContext
from calstation.estimation.effects import effect_errors
from calstation.estimation.positions import RestEvidence, angle_errors, turn_between
from calstation.judgement.check import Check, Where
from calstation.judgement.limits import estimated_stage
from calstation.physics import EFFECTS, INDEX, PARAMETERS, FloatArray
from calstation.records import (
    CheckKind,
    ChecksSection,
    Excitation,
    GravityAtRest,
    ImprovementAtRest,
    Level,
    MotionAngle,
    Previous,
)

#: Smallest rotation of a motion that is checked, rad; smaller rotations are insensitive to scale factor errors.
MIN_TURN = np.deg2rad(10.0)
#: Number of sigmas by which noise increases a limit: for a rest, noise above that of the profiles; for a motion, all
#: noise. The limit of a rest is also at least this number of sigmas of the error due to the parameters.
NOISE_SIGMAS = 4.0
#: Parameters on which the magnitude of the compensated force depends.
_OF_FORCE = [i for i, p in enumerate(PARAMETERS) if p.group.startswith("accel_")]


def acceptance(
    section: ChecksSection,
    context: SolveContext,
    prior: Posterior,
    solutions: Sequence[Solution],
    previous: Mapping[str, float],
) -> list[Check]:
    """Evaluate the acceptance checks of a product for the result of a chain of stages.

    `prior` is the posterior before the first stage; `previous` the last calibration of the same unit by parameter, SI.
    """
    if not solutions:
        return []
    evaluated = _Acceptance(section, context, prior, solutions)
    return [evaluated.with_cause(check) for check in evaluated.checks(previous)]


def offline_online(section: ChecksSection, offline: Mapping[str, Any], online: Mapping[str, Any]) -> list[Check]:
    """Compare the parameters of a log that was solved again with the run's parameters, both as in the result JSON."""
    rule = section.offline_online
    shared = [n for n, row in offline.items() if n in online and online[n]["stage"] == row["stage"]]
    if rule is None or not shared:
        return []
    differences = {n: abs(offline[n]["value"] - online[n]["value"]) / max(offline[n]["sigma"], 1e-300) for n in shared}
    worst = max(differences, key=lambda n: float(np.nan_to_num(differences[n], nan=np.inf)))
    return [
        Check.compare(
            "offline_online",
            float(differences[worst]),
            rule.within_sigmas,
            "sigma",
            near=section.near_miss_beyond,
            where=Where(worst),
        )
    ]


#: Kind of check used instead if the required error is below the floor, by the kind of check of an improvement.
_FLOORS: dict[CheckKind, CheckKind] = {
    "improvement_at_rest": "improvement_at_rest_floor",
    "motion_improvement": "motion_improvement_floor",
}


#: Checks of the magnitude of the force at one rest.
_AT_REST: frozenset[CheckKind] = frozenset({"gravity_at_rest", "improvement_at_rest", "improvement_at_rest_floor"})


class _Acceptance:
    """Acceptance checks of the solutions of a chain of stages."""

    def __init__(
        self, section: ChecksSection, context: SolveContext, prior: Posterior, solutions: Sequence[Solution]
    ) -> None:
        self._section, self._context, self._solutions = section, context, solutions
        self._prior, self._after = prior, solutions[-1].posterior
        self._gravity = context.site.local_gravity
        self._evidence = [s.evidence for s in solutions if s.evidence is not None]
        #: Sizes of the effects in the model, SI, by component; the 30 parameters of the result do not correct them.
        self._effects = {name: e.value for s in solutions for name, e in s.estimates.items()}

    def checks(self, previous: Mapping[str, float]) -> Iterator[Check]:
        """Yield all checks that the product requires for the solved stages.

        If a rest listed in the product or a motion between two rests is missing, the value is NaN and the check fails.
        """
        s = self._section
        if s.gravity_at_rest is not None:
            yield from self._gravity_at_rest(s.gravity_at_rest)
        if s.improvement_at_rest is not None:
            yield from self._improvement(s.improvement_at_rest)
        if s.level is not None:
            yield from self._level(s.level)
        if s.motion_angle is not None:
            yield from self._motions(s.motion_angle)
        if s.previous is not None:
            yield from self._previous(s.previous, previous)
        if s.excitation is not None:
            yield from self._excitation(s.excitation)

    def with_cause(self, check: Check) -> Check:
        """Return a failed check of the force at rest with the cause if it is an effect in the model."""
        if check.passed or check.kind not in _AT_REST or check.where.rest is None or math.isnan(check.value):
            return check
        rest = next(e for e in self._evidence if e.stage == check.where.stage).rests[check.where.rest]
        omega, force = rest.compensated(self._after.mean)
        errors = {}
        for effect in EFFECTS:
            sizes = {name: self._effects[name] for name in effect.names if name in self._effects}
            corrected = force - effect_errors(sizes, omega[None], force[None])[0, 3:]
            errors[effect.cause] = abs(float(np.linalg.norm(corrected)) - self._gravity)
        error, cause = self._force_error(rest, self._after.mean), min(errors, key=lambda cause: errors[cause])
        if not errors[cause] < 0.5 * error:
            return check
        return replace(check, diagnosis=Diagnosis("state_not_corrected", error, unit="m/s²", values={"state": cause}))

    def _check(self, kind: CheckKind, value: float, limit: float, unit: str, where: Where, subject: str = "") -> Check:
        near = self._section.near_miss_beyond
        return Check.compare(kind, value, limit, unit, subject=subject, near=near, where=where)

    def _force_error(self, rest: RestEvidence, parameters: FloatArray) -> float:
        """Return the difference in magnitude between the compensated force and gravity, m/s²."""
        return abs(float(np.linalg.norm(rest.compensated(parameters)[1])) - self._gravity)

    def _force_sigma(self, rest: RestEvidence) -> float:
        """Return the sigma of the force error due to the parameters, m/s².

        The uncertainty of gravity, which changes the force and its reference equally, is subtracted.
        """
        steps = np.diag(self._after.sigma)[_OF_FORCE]
        errors = [
            [float(np.linalg.norm(rest.compensated(self._after.mean + sign * step)[1])) for sign in (1.0, -1.0)]
            for step in steps
        ]
        slopes, sigma = 0.5 * (np.array(errors) @ [1.0, -1.0]), self._after.sigma[_OF_FORCE]
        scale = np.where(sigma > 0.0, sigma, 1.0)
        correlation = self._after.covariance[np.ix_(_OF_FORCE, _OF_FORCE)] / np.outer(scale, scale)
        variance = float(slopes @ correlation @ slopes)
        return math.sqrt(max(variance - (self._context.site.relative_gravity_sigma * self._gravity) ** 2, 0.0))

    def _gravity_at_rest(self, rule: GravityAtRest) -> Iterator[Check]:
        rests = []
        for evidence in self._evidence:
            for k, rest in enumerate(evidence.rests):
                if rest.duration >= rule.shortest_rest_s:
                    # noise above the profiles' and the sigmas of the parameters have their own checks
                    more = NOISE_SIGMAS * rest.excess_sigma
                    more += max(NOISE_SIGMAS * self._force_sigma(rest) - rule.within, 0.0)
                    where = Where(stage=evidence.stage, rest=k)
                    rests.append((self._force_error(rest, self._after.mean), where, more))
        if rests:
            value, where, more = max(rests, key=lambda row: _value_then_where((row[0] - row[2], row[1])))
            yield self._check("gravity_at_rest", value, rule.within + more, "m/s²", where)

    def _improvement(self, rule: ImprovementAtRest) -> Iterator[Check]:
        candidates = [e for e in self._evidence if e.rests and rule.stage in (None, e.stage)]
        if not candidates:
            return
        evidence = candidates[-1]
        rows = []
        for k in range(len(evidence.rests)) if rule.positions is None else rule.positions:
            before = after = math.nan
            if k < len(evidence.rests):
                before, after = (self._force_error(evidence.rests[k], p) for p in (evidence.before, self._after.mean))
            rows.append((before, after, 0.0, Where(stage=evidence.stage, rest=k)))
        yield from self._compare_improvement("improvement_at_rest", rule.below, rule.or_within, "m/s²", rows)

    def _compare_improvement(
        self, kind: CheckKind, below: float, floor: float, unit: str, rows: list[tuple[float, float, float, Where]]
    ) -> Iterator[Check]:
        """Compare the errors after calibration with a fraction of the errors before, or with `floor` if that is larger.

        Each row contains the errors before and after, the noise by which `floor` increases, and their origin.
        """
        factors = [
            (after / before, where) for before, after, noise, where in rows if not below * before <= floor + noise
        ]
        if factors:
            value, where = max(factors, key=_value_then_where)
            yield self._check(kind, value, below, "1", where)
        rest = [(after, noise, where) for before, after, noise, where in rows if below * before <= floor + noise]
        if rest:
            yield self._beyond_noise(_FLOORS[kind], floor, unit, rest)

    def _beyond_noise(self, kind: CheckKind, limit: float, unit: str, rows: list[tuple[float, float, Where]]) -> Check:
        """Compare each error with the limit plus its noise; return the check with the largest ratio."""
        smallest = np.finfo(float).tiny
        value, noise, where = max(
            rows, key=lambda row: _value_then_where((row[0] / max(limit + row[1], smallest), row[2]))
        )
        return self._check(kind, value, limit + noise, unit, where)

    def _level(self, rule: Level) -> Iterator[Check]:
        candidates = [e for e in self._evidence if e.stage == rule.stage or (e.rests and rule.stage is None)]
        if not candidates:
            return
        evidence = next((e for e in candidates if len(e.rests) > rule.position), candidates[0])
        where, force = Where(stage=evidence.stage, rest=rule.position), np.full(3, math.nan)
        if rule.position < len(evidence.rests):
            _, force = evidence.rests[rule.position].compensated(self._after.mean)
            force = np.array(self._context.table.orientation) @ force
        if rule.horizontal_within is not None:
            value = float(np.abs(force[:2]).max())
            yield self._check("level_horizontal", value, rule.horizontal_within, "m/s²", where)
        if rule.vertical_within is not None:
            value = abs(float(force[2]) - self._gravity)
            yield self._check("level_vertical", value, rule.vertical_within, "m/s²", where)

    def _motions(self, rule: MotionAngle) -> Iterator[Check]:
        rows = []
        parameters, axes = self._after.mean, None if rule.reference == "gravity" else self._context.table.geometry
        for evidence in self._evidence:
            if rule.stage not in (None, evidence.stage):
                continue
            successive = itertools.pairwise(range(len(evidence.rests)))
            positions = None if rule.positions is None else sorted(set(rule.positions))
            for first, second in successive if positions is None else itertools.combinations(positions, 2):
                where = Where(stage=evidence.stage, rest=first, to=second)
                turn = turn_between(evidence, first, second, parameters) if second < len(evidence.rests) else None
                if turn is not None and turn.path >= MIN_TURN:
                    before, after, sigma = angle_errors(evidence, turn, parameters, axes)
                    rows.append((before, after, NOISE_SIGMAS * sigma, where))
                elif turn is None and rule.positions is not None:
                    rows.append((math.nan, math.nan, 0.0, where))
        if rows and rule.within is not None:
            yield self._beyond_noise("motion_angle", rule.within, "rad", [row[1:] for row in rows])
        if rule.below is not None:
            yield from self._compare_improvement("motion_improvement", rule.below, rule.or_within, "rad", rows)

    def _previous(self, rule: Previous, previous: Mapping[str, float]) -> Iterator[Check]:
        for limited, limit in rule.change_within.items():
            changes = {
                name: abs(float(self._after.mean[INDEX[name]]) - previous[name])
                for name in estimated_stage(self._solutions)
                if name in previous and limited in (name, PARAMETERS[INDEX[name]].group)
            }
            if changes:
                worst = max(changes, key=lambda name: changes[name])
                unit = PARAMETERS[INDEX[worst]].unit
                yield self._check("previous", changes[worst], limit, unit, Where(worst), limited)

    def _excitation(self, rule: Excitation) -> Iterator[Check]:
        before, after = self._prior.sigma, self._after.sigma
        ratios = {
            name: float(after[INDEX[name]] / before[INDEX[name]])
            for name in estimated_stage(self._solutions)
            if before[INDEX[name]] > 0.0
        }
        if ratios:
            worst = max(ratios, key=lambda name: ratios[name])
            yield self._check("excitation", ratios[worst], rule.sigma_ratio_below, "1", Where(worst))


def _value_then_where(row: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the sort key of a row of a value and a `Where`; NaN is the largest, equal values are ordered by text."""
    value, where = row
    return math.inf if math.isnan(value) else value, str(where)
