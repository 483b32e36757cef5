"""Cross-calibration of secondary IMUs against a primary IMU on the same body, from any common motion.

On command the whole recording is fitted; with triggers, only the secondaries that are out of tolerance in a check.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from calstation.errors import ConfigurationError, InputError
from calstation.estimation import Diagnosis, Estimate, Method, ModelTest, Progress, Solution, StageSolver
from calstation.estimation.common import (
    Consistency,
    Posterior,
    SampleBlock,
    Secondary,
    SolveContext,
    StageData,
    StoredPair,
    nis_consistency,
)
from calstation.estimation.effects import effect_tests
from calstation.estimation.pairs import (
    ACCEL_BIAS,
    GYRO_BIAS,
    PairCalibration,
    PairResult,
    PairSchedule,
    PairWatch,
    StaticCheck,
    WatchEvent,
    check_values,
)
from calstation.messages import values_to_json
from calstation.physics import PAIR_PARAMETERS, Step, TableGeometry, pair_name

NOTHING = Consistency(0.0, 0.0, 0.0, 0)
#: Sigmas above which the motion does not determine a value; for the clock offset the limit is half a sample.
UNDETERMINED = {"secondary_gyro_matrix": 0.02, "secondary_accel_matrix": 0.02, "secondary_lever": 0.05}

#: Largest change of a value from the first to the second half of the recording, in standard deviations: noise exceeds
#: it in one of 28 values once in 5,000 recordings.
CHANGED = 4.5


def plan(geometry: TableGeometry, schedule: PairSchedule) -> Iterator[Step]:
    """Raise ConfigurationError, because a run on the table records only one IMU."""
    raise ConfigurationError("plan.needs_joint_recording")


class PairStage(StageSolver):
    """Solves the whole recording, or for the parts selected by triggers."""

    def __init__(self, context: SolveContext, prior: Posterior, schedule: PairSchedule) -> None:
        if not context.secondaries:
            raise InputError("solve.no_second_imu")
        super().__init__(context, prior)
        self._schedule = schedule
        self._calibration = PairCalibration(context, prior, schedule)
        self._watch: PairWatch | None = None
        self._events: list[WatchEvent] = []
        if schedule.trigger != "command":
            self._watch = PairWatch(context.imu, context.secondaries, self._calibration)

    def feed(self, block: SampleBlock) -> None:
        """Add samples of the stage."""
        super().feed(block)
        if self._watch is not None:
            self._events += self._watch.feed(block)

    def finish(self, progress: Progress | None = None) -> Solution:
        """Solve the recording. Raises InputError if it is unusable."""
        if self._watch is None:
            return self._all(self.buffer.data(), progress)
        return self._watched(self._watch)

    def _all(self, data: StageData, progress: Progress | None) -> Solution:
        done: dict[int, PairResult] = {}
        checks: dict[int, StaticCheck] = {}
        rest = self._calibration.last_rest(data)
        for index, secondary in enumerate(self.context.secondaries):
            if rest is not None:
                check = self._calibration.check(data, rest, index, secondary, secondary.stored)
                if check is not None:
                    checks[secondary.number] = check
            done[secondary.number] = self._calibration.calibrate(
                data, index, secondary, self._schedule.choice, secondary.stored
            )
            if progress is not None:
                progress((index + 1) / len(self.context.secondaries))
        return self._solution(done, checks, {s.number: s.stored for s in self.context.secondaries}, data.gaps, ())

    def _watched(self, watch: PairWatch) -> Solution:
        self._events += watch.finish()
        messages = [
            (f"pair_{e.kind}", {"stage": "cross_calibration", "number": e.number, "time": e.time, **e.values})
            for e in self._events
            if e.kind in ("primary_off", "calibrated", "given_up")
        ]
        if not watch.checks:
            raise InputError("solve.no_rest_to_check", seconds=self._schedule.static_s)
        return self._solution(watch.calibrated, watch.checks, watch.stored, 0, tuple(messages))

    def _solution(
        self,
        done: dict[int, PairResult],
        checks: dict[int, StaticCheck],
        stored: dict[int, StoredPair],
        gaps: int,
        messages: tuple[tuple[str, dict[str, Any]], ...],
    ) -> Solution:
        estimates: dict[str, Estimate] = {}
        for number, calibrated in done.items():
            estimates.update(_estimates(number, calibrated, self.context.imu.sample_rate))
        halves = [c.fit.halves for c in done.values()]
        fitted = int(sum(c.fit.fitted.sum() for c in done.values()))
        kept = [number for number in stored if number not in done]
        outside = {number: effect_tests(c.fit.effects) for number, c in done.items()}
        harmful, harmless = (
            [_of_pair(number, test) for number, tests in outside.items() if (test := tests[k]) is not None]
            for k in (0, 1)
        )
        if kept:
            messages = (*messages, ("pair_kept", {"stage": "cross_calibration", "numbers": kept}))
        return Solution(
            stage="cross_calibration",
            posterior=self.prior,
            estimated=(),
            consistency=nis_consistency(float(np.mean(halves)) * fitted, fitted, 1) if done else NOTHING,
            gaps=gaps,
            details={
                "secondaries": [
                    _details(s, done.get(s.number), checks.get(s.number), stored[s.number])
                    for s in self.context.secondaries
                ],
                "events": [
                    {"kind": e.kind, "time": e.time, "number": e.number, **values_to_json(e.values)}
                    for e in self._events
                ],
            },
            messages=messages,
            estimates=estimates,
            tests=tuple(_worst(tests) for tests in ([_steady(*item) for item in done.items()], harmful) if tests),
            explanation=_worst(harmless) if harmless else None,
        )


def _estimates(number: int, calibrated: PairResult, sample_rate: float) -> dict[str, Estimate]:
    fit = calibrated.fit
    sigma = np.sqrt(np.diag(fit.covariance))
    limits = {**UNDETERMINED, "clock_offset": 0.5 / sample_rate}
    # if only the bias was fitted, the fixed matrix is listed too, because the bias is valid only in combination with it
    fixed = {
        f"secondary_{s}_matrix" for s, bias in (("gyro", GYRO_BIAS), ("accel", ACCEL_BIAS)) if fit.fitted[bias].any()
    }
    return {
        pair_name(p.name, number): Estimate(float(value), float(s), p.unit, bool(s <= limits.get(p.group, np.inf)))
        for p, value, s, chosen in zip(PAIR_PARAMETERS, fit.value, sigma, fit.fitted, strict=True)
        if chosen or p.group in fixed
    }


def _steady(number: int, calibrated: PairResult) -> ModelTest:
    """Return the test of the value that changed most between both halves, in standard deviations of the change."""
    fit = calibrated.fit
    changes = np.nan_to_num(fit.change / fit.change_sigma)
    names = [pair_name(p.name, number) for p in PAIR_PARAMETERS]
    worst = int(np.argmax(np.abs(changes)))
    shift = {name: float(change) for name, change in zip(names, changes, strict=True) if abs(change) > CHANGED}
    values = {"parameter": names[worst]}
    unit = PAIR_PARAMETERS[worst].unit
    diagnosis = Diagnosis(
        "halves_differ", float(fit.change[worst]), float(fit.change_sigma[worst]), unit, shift, values
    )
    return ModelTest("halves", float(abs(changes[worst])), CHANGED, "sigma", diagnosis)


def _worst(tests: list[ModelTest]) -> ModelTest:
    """Return the test with the largest value."""
    return max(tests, key=lambda test: test.value)


def _of_pair(number: int, test: ModelTest) -> ModelTest:
    """Return a test for effects outside the model with the parameter names of a pair."""
    diagnosis = test.diagnosis
    shift = {pair_name(name, number): size for name, size in diagnosis.parameter_shift.items()}
    if changed := diagnosis.values["parameter"]:
        values = {**diagnosis.values, "parameter": pair_name(changed, number)}
        return replace(test, diagnosis=replace(diagnosis, parameter_shift=shift, values=values))
    values = {**diagnosis.values, "number": number, "effect": diagnosis.cause}
    return replace(test, diagnosis=replace(diagnosis, cause="pair_effect", parameter_shift=shift, values=values))


def _details(
    secondary: Secondary, calibrated: PairResult | None, check: StaticCheck | None, stored: StoredPair
) -> dict[str, Any]:
    kept = stored if calibrated is None else calibrated.stored
    details: dict[str, Any] = {
        "number": secondary.number,
        "serial": secondary.imu.serial,
        "check": check and check_values(check),
        "stored": {"values": dict(kept.values), "gyro_static": kept.gyro_static, "accel_static": kept.accel_static},
    }
    if calibrated is not None:
        fit = calibrated.fit
        details["fit"] = {
            "residual": {"gyro": fit.rms[0], "accel": fit.rms[1]},
            "noise": {"gyro": fit.expected[0], "accel": fit.expected[1]},
            "blocks": fit.blocks,
            "settled": fit.converged,
        }
    return details


METHOD = Method("cross_calibration", PairSchedule, plan, PairStage, estimates=lambda context: (), needs_no_table=True)
