"""A product's acceptance checks, which read as sentences, and what they find in the evidence of a calibration.

[checks.gravity_at_rest]      after compensation the force at every rest is as long as gravity: within 0.002 m/s²
[checks.improvement_at_rest]  what is left of it there is below 0.5 times what it was
[checks.level]                at the level position: horizontal_within, vertical_within m/s²
[checks.motion_angle]         motions turn by the angle of the reference: within 0.001 rad, below 0.5 times before
[checks.offline_online]       a log solved again gives the run's answer: within_sigmas 0.001
[checks.previous]             no group has changed since the last calibration by more than change_within
[checks.excitation]           every sigma is below 0.5 times what it was before
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import Field, field_validator

from calstation.estimation.common.context import Belief, SolveContext
from calstation.estimation.method import Solution
from calstation.estimation.positions.evidence import Evidence, MotionEvidence, gravity_misses, turned_angle
from calstation.physics.arrays import FloatArray
from calstation.physics.earth import normal_gravity
from calstation.physics.parameters import GROUPS, INDEX, NAMES, PARAMETERS
from calstation.physics.table import TableGeometry
from calstation.records.limits import NEAR, Check, estimated_stage
from calstation.schema import StrictModel, suggestion

#: A motion that turns less proves nothing of a scale factor.
LEAST_TURN = np.deg2rad(10.0)


class GravityAtRest(StrictModel):
    """Largest difference between force and gravity, m/s², at rests of at least so many s."""

    within: float = Field(gt=0)
    shortest_rest_s: float = Field(default=2.0, ge=1.0)


class ImprovementAtRest(StrictModel):
    """What is left of the difference, as a part of what it was; what noise leaves is no failure.

    positions : rests of the stage by number from 0, all where absent; stage : the last that rests where absent
    or_within : an error this small, m/s², needs no improvement
    """

    below: float = Field(gt=0)
    or_within: float = Field(default=0.0, ge=0)
    positions: list[int] | None = None
    stage: str | None = None


class Level(StrictModel):
    """Components at the level position: the first rest, or `position` of `stage`; m/s²."""

    horizontal_within: float | None = Field(default=None, gt=0)
    vertical_within: float | None = Field(default=None, gt=0)
    position: int = Field(default=0, ge=0)
    stage: str | None = None


class MotionAngle(StrictModel):
    """Angle of motions by calibrated gyros against the encoders', or against gravity where there are none.

    within : rad; below : as a part of the error before; or_within : an error this small, rad, needs no improvement
    """

    within: float | None = Field(default=None, gt=0)
    below: float | None = Field(default=None, gt=0)
    or_within: float = Field(default=0.0, ge=0)
    stage: str | None = None


class OfflineOnline(StrictModel):
    """Largest difference of a parameter from the run's own answer, in its sigmas."""

    within_sigmas: float = Field(ge=0)


class Previous(StrictModel):
    """Largest change since the last calibration of the same unit, per parameter or group, SI."""

    change_within: dict[str, float] = Field(min_length=1)

    @field_validator("change_within")
    @classmethod
    def _known(cls, limits: dict[str, float]) -> dict[str, float]:
        for name, limit in limits.items():
            if name not in NAMES and name not in GROUPS:
                raise ValueError(f"'{name}' is no parameter or group{suggestion(name, NAMES + GROUPS)}")
            if not limit > 0:
                raise ValueError(f"change_within.{name} = {limit} must be positive")
        return limits


class Excitation(StrictModel):
    """Largest part of a sigma before that may be left of it."""

    sigma_ratio_below: float = Field(gt=0, le=1)


class ChecksSection(StrictModel):
    """`[checks]` of a product; near_miss_beyond : a value that takes more of its limit than this is marked."""

    near_miss_beyond: float = Field(default=NEAR, gt=0, lt=1)
    gravity_at_rest: GravityAtRest | None = None
    improvement_at_rest: ImprovementAtRest | None = None
    level: Level | None = None
    motion_angle: MotionAngle | None = None
    offline_online: OfflineOnline | None = None
    previous: Previous | None = None
    excitation: Excitation | None = None

    @property
    def need_samples(self) -> bool:
        """Whether the stages' rests and motions are asked for."""
        asked = (self.gravity_at_rest, self.improvement_at_rest, self.level, self.motion_angle)
        return any(check is not None for check in asked)


def acceptance(
    section: ChecksSection,
    context: SolveContext,
    prior: Belief,
    solutions: Sequence[Solution],
    previous: Mapping[str, float],
) -> list[Check]:
    """The checks that a product asks for, of a chain's answer.

    prior : before the first stage; previous : values of the last calibration of the same unit by parameter, SI
    """
    if not solutions:
        return []
    return list(_Acceptance(section, context, prior, solutions).checks(previous))


def offline_online(
    section: ChecksSection, offline: Mapping[str, Any], online: Mapping[str, Any]
) -> list[Check]:
    """A log's parameters solved again against those its run found, both as a result JSON holds them."""
    rule = section.offline_online
    shared = [n for n, row in offline.items() if n in online and online[n]["stage"] == row["stage"]]
    if rule is None or not shared:
        return []
    apart = {
        n: abs(offline[n]["value"] - online[n]["value"]) / max(offline[n]["sigma"], 1e-300) for n in shared
    }
    worst = max(apart, key=lambda n: apart[n])
    value, limit = float(apart[worst]), rule.within_sigmas
    return [Check("offline_online", value, limit, "sigma", value <= limit, section.near_miss_beyond, worst)]


class _Acceptance:
    def __init__(
        self, section: ChecksSection, context: SolveContext, prior: Belief, solutions: Sequence[Solution]
    ) -> None:
        site = context.site
        self._section, self._context, self._solutions = section, context, solutions
        self._prior, self._found = prior, solutions[-1].belief
        self._gravity = site.gravity or normal_gravity(site.latitude, site.height)
        self._evidence = [s.evidence for s in solutions if s.evidence is not None]

    def checks(self, previous: Mapping[str, float]) -> Iterator[Check]:
        """All that are asked for and can be told."""
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

    def _check(self, name: str, value: float, limit: float, unit: str, where: str) -> Check:
        return Check(name, value, limit, unit, bool(value <= limit), self._section.near_miss_beyond, where)

    def _of(self, stage: str | None) -> Evidence | None:
        chosen = [e for e in self._evidence if e.rests and stage in (None, e.stage)]
        return chosen[-1] if chosen else None

    def _length(self, force: FloatArray) -> float:
        return abs(float(np.linalg.norm(force)) - self._gravity)

    def _gravity_at_rest(self, rule: GravityAtRest) -> Iterator[Check]:
        errors = [
            (self._length(rest.compensated(self._found.mean)[1]), f"{e.stage} rest {k}")
            for e in self._evidence
            for k, rest in enumerate(e.rests)
            if rest.duration >= rule.shortest_rest_s
        ]
        if errors:
            value, where = max(errors)
            yield self._check("gravity_at_rest", value, rule.within, "m/s²", where)

    def _improvement(self, rule: ImprovementAtRest) -> Iterator[Check]:
        evidence = self._of(rule.stage)
        if evidence is None:
            return
        places = range(len(evidence.rests)) if rule.positions is None else rule.positions
        rows = []
        for k in places:
            if k >= len(evidence.rests):
                continue
            before, after = (
                self._length(evidence.rests[k].compensated(p)[1])
                for p in (self._prior.mean, self._found.mean)
            )
            limit = max(rule.below * before, rule.or_within)
            rows.append((after / max(limit, 1e-300), after, limit, f"{evidence.stage} rest {k}"))
        if rows:
            _, value, limit, where = max(rows)
            yield self._check("improvement_at_rest", value, limit, "m/s²", where)

    def _level(self, rule: Level) -> Iterator[Check]:
        chosen = [e for e in self._evidence if len(e.rests) > rule.position and rule.stage in (None, e.stage)]
        if not chosen:
            return
        where = f"{chosen[0].stage} rest {rule.position}"
        _, force = chosen[0].rests[rule.position].compensated(self._found.mean)
        if rule.horizontal_within is not None:
            value = float(np.abs(force[:2]).max())
            yield self._check("level_horizontal", value, rule.horizontal_within, "m/s²", where)
        if rule.vertical_within is not None:
            value = abs(float(force[2]) - self._gravity)
            yield self._check("level_vertical", value, rule.vertical_within, "m/s²", where)

    def _motions(self, rule: MotionAngle) -> Iterator[Check]:
        rows = []
        for evidence in self._evidence:
            if rule.stage not in (None, evidence.stage):
                continue
            for motion in evidence.motions:
                if motion.path < LEAST_TURN:
                    continue
                errors = self._motion_errors(evidence, motion)
                if errors is not None:
                    rows.append(
                        (*errors, f"{evidence.stage} samples {motion.first_seq} to {motion.last_seq}")
                    )
        if rows and rule.within is not None:
            _, value, where = max((after, after, where) for _, after, where in rows)
            yield self._check("motion_angle", value, rule.within, "rad", where)
        if rows and rule.below is not None:
            below, least = rule.below, rule.or_within
            _, value, limit, where = max(
                (after / max(below * before, least, 1e-300), after, max(below * before, least), where)
                for before, after, where in rows
            )
            yield self._check("motion_improvement", value, limit, "rad", where)

    def _motion_errors(self, evidence: Evidence, motion: MotionEvidence) -> tuple[float, float] | None:
        """Error of a motion's angle with the parameters before and with the answer, rad; None without reference."""
        first, second = evidence.rests[motion.before], evidence.rests[motion.after]
        found, table = self._found.mean, self._context.table
        earth, _ = first.compensated(found)
        rotations = (motion.uncalibrated, motion.calibrated(found))
        if first.angles is not None and second.angles is not None:
            moved = np.abs(second.angles - first.angles)
            if moved.min() > 3.0 * table.encoder_sigma:
                geometry = TableGeometry(table.outer_axis, table.inner_axis)
                before, after = (geometry.body_to_home(*rest.angles) for rest in (first, second))  # type: ignore[misc]
                reference = turned_angle(before.T @ after, np.zeros(3), 0.0, motion.path)
            else:
                reference = float(moved.max())
            angles = [turned_angle(B, earth, motion.duration, motion.path) for B in rotations]
            return abs(angles[0] - reference), abs(angles[1] - reference)
        return gravity_misses(evidence, motion, found)

    def _previous(self, rule: Previous, previous: Mapping[str, float]) -> Iterator[Check]:
        for limited, limit in rule.change_within.items():
            changes = {
                name: abs(float(self._found.mean[INDEX[name]]) - previous[name])
                for name in estimated_stage(self._solutions)
                if name in previous and limited in (name, PARAMETERS[INDEX[name]].group)
            }
            if changes:
                worst = max(changes, key=lambda name: changes[name])
                unit = PARAMETERS[INDEX[worst]].unit
                yield self._check(f"previous {limited}", changes[worst], limit, unit, worst)

    def _excitation(self, rule: Excitation) -> Iterator[Check]:
        before, after = self._prior.sigma, self._found.sigma
        ratios = {
            name: float(after[INDEX[name]] / before[INDEX[name]])
            for name in estimated_stage(self._solutions)
            if before[INDEX[name]] > 0.0
        }
        if ratios:
            worst = max(ratios, key=lambda name: ratios[name])
            yield self._check("excitation", ratios[worst], rule.sigma_ratio_below, "1", worst)
