"""Pass or fail: comparison of a run's solutions with the limits and checks, and its verdict."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

from calstation.config import ProductConfig, excess_gravity_sigma, gravity_contradiction
from calstation.estimation import Diagnosis, Solution
from calstation.estimation.common import Posterior
from calstation.estimation.effects import NO_SINGLE_EFFECT
from calstation.judgement.acceptance import acceptance
from calstation.judgement.check import Check
from calstation.judgement.conformity import Conformity, conformity, conformity_section
from calstation.judgement.limits import check_limits, check_prior, not_compared
from calstation.judgement.site import check_latitude, unconfirmed_latitude
from calstation.judgement.standards import StandardComparison
from calstation.parsing import parse_toml
from calstation.records import NEAR_MISS_FRACTION, CheckKind, Limit, LogMeta, Verdict, context_from_meta
from procedures import DEFAULT_STAGES

#: Kinds of checks that may fail because the model does not describe the data.
_MODEL_DEPENDENT: frozenset[CheckKind] = frozenset({
    "within", "consistency", "agreement", "halves", "prior", "gravity_at_rest", "improvement_at_rest",
    "improvement_at_rest_floor", "motion_angle", "motion_improvement", "motion_improvement_floor",
})  # fmt: skip


#: Kinds of checks whose causes are listed before those of the site.
_OF_DATA: frozenset[CheckKind] = frozenset({
    "clipping", "samples", "sample_clock", "temperature_sensor", "sigma_below", "within",
})  # fmt: skip
#: Kinds of checks of the site and the mounting, the most certain first.
_OF_SITE: tuple[CheckKind, ...] = ("latitude", "heading", "start_attitude")
#: Deviation of the heading, in units of its limit, above which no effect is its cause.
_FAR = 3.0
#: Kinds of checks that a partial run fails if the current calibration is missing, too old or no longer valid.
_OF_CALIBRATION: frozenset[CheckKind] = frozenset({"sigma_below", "unobservable", "change"})
#: Causes that reseating the unit can remove: its mounting, its cable, or a disturbance of the table.
_OF_MOUNTING = frozenset({
    "mount_unlike", "heading_unlike", "spikes", "stuck", "table_vibrates", "gyro_moving_bias", "accel_moving_bias",
    "excess_shift", "excess_scatter", "excess_there", "excess_spread", NO_SINGLE_EFFECT,
})  # fmt: skip
#: Temporary causes, such as warm-up or the link, which may be absent when the run is repeated.
_OF_TIME = frozenset({
    "temperature_changed", "drift", "drift_throughout", "jump", "jump_before", "gyro_bias_wanders", "changed_in_time",
    "stages_disagree", "samples_lost", "samples_repeated", "samples_doubled",
})  # fmt: skip
#: Smallest ratio of the measured to the stated noise at which the noise is a cause.
_NOTABLE_NOISE = 1.2


@dataclass(frozen=True)
class Judgement:
    """Checks of a run's solutions against the limits of its product, and their outcome."""

    checks: tuple[Check, ...]
    #: None without limits, if data and model were not tested, if the data of a stage are insufficient, or if gravity is
    #: contradictory.
    passed: bool | None
    partial: bool  #: Whether stages of the product were omitted.
    not_compared: tuple[str, ...] = ()  #: Parameters with a limit that no stage estimated or determined.
    tested: bool = True  #: Whether data and model were tested.
    conformity: Conformity | None = None  #: None if no value has limits.
    standard: StandardComparison | None = None  #: None for a production unit.
    #: Stage and latitude of an inconsistent stage, see `unconfirmed_latitude`.
    latitude: Mapping[str, str | float] | None = None


@dataclass(frozen=True)
class SolvedAgain:
    """Additional input to the judgement of a log that was solved again, possibly with fewer stages than in its run."""

    complete: bool = True  #: Whether every stage of the log was solved; otherwise the unit may fail, but not pass.
    online: Sequence[Check] = ()  #: Comparison with the result of the run, see `offline_online`.


def judge(
    meta: LogMeta,
    prior: Posterior,
    solutions: Sequence[Solution],
    *,
    again: SolvedAgain | None = None,
    standard: StandardComparison | None = None,
) -> Judgement:
    """Compare the solutions of a run with the limits in its log's configuration; without a solution the unit fails.

    Parameters
    ----------
    meta : configuration of the log, with limits, acceptance checks and decision rule
    prior : posterior before the first stage
    solutions : solutions of the stages, with the tests of data and model, in order
    again : additional input for a log that was solved again; None for a run
    standard : comparison of a check standard with its reference; None for a production unit
    """
    limits, near = _limits(meta)
    section = meta.product.checks if meta.product is not None else None
    compared = check_limits(limits, prior, solutions, near, meta.calibrated, conformity_section(meta).rule)
    limit_checks = [_with_cause(meta, check) for check in compared]
    stated = {name for name, row in meta.prior.items() if row.sigma is not None and name not in meta.calibrated}
    limit_checks += check_prior(prior, solutions, stated)
    if section is not None:
        if meta.calibrated:  # most of the sigmas are due to the current calibration instead of the run
            section = section.model_copy(update={"excitation": None})
        limit_checks += acceptance(section, context_from_meta(meta), prior, solutions, meta.previous)
    explained = [*_with_explanation(limit_checks, solutions), *check_latitude(meta, solutions)]
    checks = _with_noise(_site_first(explained), solutions)
    passed = None
    if limits or section is not None:
        checks += again.online if again is not None else ()
        passed = bool(limit_checks) and all(check.passed for check in checks) and (standard is None or standard.passed)
    if again is not None and not (again.complete and gravity_contradiction(meta.site) is None):
        passed = None if passed else passed  # the unit may fail, but not pass
    return Judgement(
        checks=tuple(checks),
        passed=passed,
        partial=is_partial(meta, None if again is None else [solution.stage for solution in solutions]),
        not_compared=tuple(not_compared(limits, prior, solutions)),
        conformity=conformity(meta, prior, solutions, checks),
        standard=standard,
        latitude=unconfirmed_latitude(meta, solutions),
    )


def compare_only(meta: LogMeta, prior: Posterior, solutions: Sequence[Solution]) -> Judgement:
    """Compare the values and sigmas of untested solutions with the limits; the unit neither passes nor fails."""
    limits, near = _limits(meta)
    checks = check_limits(limits, prior, solutions, near, meta.calibrated, conformity_section(meta).rule)
    limit_checks = tuple(_with_cause(meta, check) for check in checks if check.kind in ("within", "sigma_below"))
    partial = is_partial(meta, [s.stage for s in solutions])
    return Judgement(limit_checks, None, partial, tuple(not_compared(limits, prior, solutions)), tested=False)


def _limits(meta: LogMeta) -> tuple[Mapping[str, Limit], float]:
    """Return the limits of the product, and the fraction of a limit beyond which a value is a near miss."""
    if meta.product is None:
        return {}, NEAR_MISS_FRACTION
    checks = meta.product.checks
    return meta.product.limits, NEAR_MISS_FRACTION if checks is None else checks.near_miss_beyond


def _with_explanation(checks: list[Check], solutions: Sequence[Solution]) -> list[Check]:
    """Return the checks with the explanation of the last stage before the first failed check that it may explain."""
    failed = [k for k, check in enumerate(checks) if not check.passed and check.kind in _MODEL_DEPENDENT]
    last_solution = solutions[-1] if solutions else None
    if not failed or last_solution is None or last_solution.explanation is None:
        return checks
    return [*checks[: failed[0]], Check.of_model(last_solution.stage, last_solution.explanation), *checks[failed[0] :]]


def _site_first(checks: list[Check]) -> list[Check]:
    """Return the checks; a failed latitude, heading or mounting precedes the failed checks that it may cause.

    An effect that explains all innovations may itself shift the latitude and the heading slightly; it remains before
    them unless the heading is far off.
    """
    effects = [check.diagnosis.cause for check in checks if check.kind == "effects" and check.diagnosis is not None]
    site = [check for check in checks if check.kind in _OF_SITE and not check.passed]
    is_far = any(
        check.kind == "heading" and not isinstance(check.limit, tuple) and check.value > _FAR * check.limit
        for check in site
    )
    if not site or (effects and NO_SINGLE_EFFECT not in effects and not is_far):
        return sorted(checks, key=lambda check: check in site)
    others = [check for check in checks if check not in site]
    consequences = (k for k, check in enumerate(others) if check.diagnosis and check.kind not in _OF_DATA)
    first = next(consequences, len(others))
    return [*others[:first], *sorted(site, key=lambda check: _OF_SITE.index(check.kind)), *others[first:]]


def _with_cause(meta: LogMeta, check: Check) -> Check:
    """Return a check of a sigma with a diagnosis if the gravity uncertainty alone exceeds its limit."""
    if check.kind != "sigma_below" or isinstance(check.limit, tuple):
        return check
    gravity = excess_gravity_sigma(meta, check.subject, check.limit)
    if gravity is None:
        return check
    size = gravity["sigma_ppm"] * 1e-6
    values = {"parameter": check.subject, **gravity}
    return replace(check, diagnosis=Diagnosis("gravity_uncertain", size, values=values))


def _with_noise(checks: list[Check], solutions: Sequence[Solution]) -> list[Check]:
    """Return the checks with the measured noise as the cause of failed checks of sigmas, unless another cause is known.

    With the noise of the profiles, such a sigma would be within its limit. Noise only slightly above the stated noise
    is no cause, because measured noise has scatter.
    """
    noise = [test for s in solutions for test in s.tests if test.kind in ("table_noise", "imu_noise")]
    largest = max(noise, key=lambda test: test.value, default=None)
    if (
        largest is None
        or largest.value < _NOTABLE_NOISE
        or any(check.diagnosis is not None for check in checks if not check.passed)
    ):
        return checks
    return [
        replace(check, diagnosis=largest.diagnosis)
        if check.kind == "sigma_below"
        and not check.passed
        and not isinstance(check.limit, tuple)
        and check.value <= largest.value * check.limit
        else check
        for check in checks
    ]


def is_partial(meta: LogMeta, solved: Collection[str] | None = None) -> bool:
    """Return whether the run, or the `solved` stages of its log, omit stages of the product.

    A log without a run section is never partial.
    """
    text = meta.profiles.get("product")
    if meta.run is None or text is None:
        return False
    stages = parse_toml(text).get("stages", DEFAULT_STAGES)
    return not set(stages) <= set(meta.run.stages if solved is None else solved)


class End(StrEnum):
    """End of a run; a log that was solved again is completed."""

    COMPLETED = "completed"
    STOPPED = "stopped"
    FAULT = "fault"
    INCOMPLETE = "incomplete"  #: The process of the run ended unexpectedly.


def verdict_of(end: End, passed: bool | None, *, partial: bool) -> Verdict:
    """Return the verdict of a run, or of a log that was solved again.

    The verdict of a run that was not completed is how it ended, regardless of its values.

    Parameters
    ----------
    end : end of the run
    passed, partial : as in the judgement of its solutions
    """
    if end is not End.COMPLETED:
        return Verdict(end.value)
    if passed is None:
        return Verdict.UNDETERMINED
    if not passed:
        return Verdict.FAILED
    return Verdict.PARTIAL if partial else Verdict.PASSED


def needs_full_calibration(checks: Collection[Check], *, partial: bool) -> bool:
    """Return whether a partial run failed only because no current calibration agrees with the unit.

    The stages of a partial run determine only some parameters; the others are only as accurate as the current
    calibration.
    """
    failed = [check for check in checks if not check.passed]
    uncertain = {check.subject for check in failed if check.kind in _OF_CALIBRATION}
    explained = (check.kind in _OF_CALIBRATION or _is_of_uncertain(check, uncertain) for check in failed)
    return partial and bool(uncertain) and all(explained)


def remedy_of(checks: Collection[Check], *, partial: bool) -> str | None:
    """Return the action that the failed checks require: ``full_calibration``, ``repeat``, ``ask_engineer``, or None.

    The first failed check with a cause decides. Causes in a profile, the site or the unit require an engineer. None
    means the action configured in the product.
    """
    if needs_full_calibration(checks, partial=partial):
        return "full_calibration"
    cause = next((check.diagnosis.cause for check in checks if not check.passed and check.diagnosis is not None), None)
    if cause is None or cause in _OF_MOUNTING:
        return None
    return "repeat" if cause in _OF_TIME else "ask_engineer"


def _is_of_uncertain(check: Check, uncertain: Collection[str]) -> bool:
    """Return whether a check compares the value of a parameter that is too uncertain, and has no other cause."""
    return check.kind == "within" and check.subject in uncertain and check.diagnosis is None


def advice(
    product: ProductConfig,
    verdict: Verdict,
    failures: int,
    *,
    resumable: bool,
    shortened: bool = False,
    remedy: str | None = None,
) -> str | None:
    """Return the recommended action; None for a unit that passed.

    It is ``reseat``, ``repeat``, ``set_aside``, ``resume``, ``full_calibration`` or ``ask_engineer``. As long as
    attempts are allowed, a run that the operator `shortened` by ending a stage is repeated in full.

    Parameters
    ----------
    product : product with its actions and number of attempts
    verdict : verdict of the run
    failures : number of consecutive failed runs, including this one
    resumable : whether a run that was not completed can be resumed
    shortened : whether the operator ended a solved stage before the end of its schedule
    remedy : action that the failed checks require, see `remedy_of`
    """
    if verdict.passed:
        return None
    if verdict is not Verdict.FAILED:
        return "resume" if resumable else "repeat"
    if remedy == "ask_engineer" and not shortened:
        return remedy
    if product.attempts_allowed is not None and failures >= product.attempts_allowed:
        return "set_aside"
    if remedy == "full_calibration":
        return remedy
    if shortened:
        return "repeat"
    advised = product.advice[min(failures, len(product.advice)) - 1]
    return remedy or advised if advised == "reseat" else advised
