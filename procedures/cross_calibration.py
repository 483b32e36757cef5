"""Cross-calibration of secondary IMUs against a primary IMU on the same body from any common motion.

With the trigger `command`, the whole recording is fitted for every secondary; with other triggers, only the secondaries
that fail a check are fitted.
"""

from collections.abc import Iterator
from dataclasses import replace
from operator import attrgetter
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
    StoredCrossCalibration,
    nis_consistency,
)
from calstation.estimation.effects import NO_SINGLE_EFFECT, effect_tests
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

NO_OBSERVATIONS = Consistency(0.0, 0.0, 0.0, 0)
#: Largest sigma of a value that counts as determined; the limit of the clock offset is half a sample.
MAX_SIGMA = {"secondary_gyro_matrix": 0.02, "secondary_accel_matrix": 0.02, "secondary_lever": 0.05}

#: Largest change of a value from the first to the second half of the recording, in standard deviations. Noise of any of
#: 28 values exceeds it in 1 of 5,000 recordings.
MAX_CHANGE = 4.5


def plan(geometry: TableGeometry, schedule: PairSchedule) -> Iterator[Step]:
    """Raise ConfigurationError, because a run on the table records only one IMU."""
    raise ConfigurationError("plan.needs_joint_recording")


class PairStage(StageSolver):
    """Solves the whole recording, or the parts selected by a trigger."""

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
        """Solve the recording. Raises InputError if it cannot be used."""
        if self._watch is None:
            return self._solve_all(self.buffer.data(), progress)
        return self._solve_watched(self._watch)

    def _solve_all(self, data: StageData, progress: Progress | None) -> Solution:
        results: dict[int, PairResult] = {}
        checks: dict[int, StaticCheck] = {}
        rest = self._calibration.last_rest(data)
        for index, secondary in enumerate(self.context.secondaries):
            if rest is not None:
                check = self._calibration.check(data, rest, index, secondary, secondary.stored)
                if check is not None:
                    checks[secondary.number] = check
            results[secondary.number] = self._calibration.calibrate(
                data, index, secondary, self._schedule.choice, secondary.stored
            )
            if progress is not None:
                progress((index + 1) / len(self.context.secondaries))
        return self._solution(results, checks, {s.number: s.stored for s in self.context.secondaries}, data.gaps, ())

    def _solve_watched(self, watch: PairWatch) -> Solution:
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
        results: dict[int, PairResult],
        checks: dict[int, StaticCheck],
        stored: dict[int, StoredCrossCalibration],
        gaps: int,
        messages: tuple[tuple[str, dict[str, Any]], ...],
    ) -> Solution:
        estimates: dict[str, Estimate] = {}
        for number, calibrated in results.items():
            estimates.update(_estimates(number, calibrated, self.context.imu.sample_rate))
        halves = [c.fit.halves for c in results.values()]
        fitted = int(sum(c.fit.fitted.sum() for c in results.values()))
        uncalibrated = [number for number in stored if number not in results]
        effects = {number: effect_tests(c.fit.effects) for number, c in results.items()}
        harmful, harmless = (
            [_of_pair(number, test) for number, tests in effects.items() if (test := tests[k]) is not None]
            for k in (0, 1)
        )
        value, halves_tests = attrgetter("value"), [_halves_test(*item) for item in results.items()]
        if uncalibrated:
            messages = (*messages, ("pair_kept", {"stage": "cross_calibration", "numbers": uncalibrated}))
        return Solution(
            stage="cross_calibration",
            posterior=self.prior,
            estimated=(),
            consistency=nis_consistency(float(np.mean(halves)) * fitted, fitted, 1) if results else NO_OBSERVATIONS,
            gaps=gaps,
            details={
                "secondaries": [
                    _details(s, results.get(s.number), checks.get(s.number), stored[s.number])
                    for s in self.context.secondaries
                ],
                "events": [
                    {"kind": e.kind, "time": e.time, "number": e.number, **values_to_json(e.values)}
                    for e in self._events
                ],
            },
            messages=messages,
            estimates=estimates,
            tests=tuple(max(tests, key=value) for tests in (halves_tests, harmful) if tests),
            explanation=max(harmless, key=value, default=None),
        )


def _estimates(number: int, calibrated: PairResult, sample_rate: float) -> dict[str, Estimate]:
    fit = calibrated.fit
    sigma = np.sqrt(np.diag(fit.covariance))
    limits = {**MAX_SIGMA, "clock_offset": 0.5 / sample_rate}
    # a bias is valid only with its matrix, which is therefore listed even if it was not fitted
    fixed = {
        f"secondary_{s}_matrix" for s, bias in (("gyro", GYRO_BIAS), ("accel", ACCEL_BIAS)) if fit.fitted[bias].any()
    }
    return {
        pair_name(p.name, number): Estimate(float(value), float(s), p.unit, bool(s <= limits.get(p.group, np.inf)))
        for p, value, s, chosen in zip(PAIR_PARAMETERS, fit.value, sigma, fit.fitted, strict=True)
        if chosen or p.group in fixed
    }


def _halves_test(number: int, calibrated: PairResult) -> ModelTest:
    """Return the test of the value that changed most between the halves, in standard deviations of the change."""
    fit = calibrated.fit
    changes = np.nan_to_num(fit.change / fit.change_sigma)
    names = [pair_name(p.name, number) for p in PAIR_PARAMETERS]
    worst = int(np.argmax(np.abs(changes)))
    shift = {name: float(change) for name, change in zip(names, changes, strict=True) if abs(change) > MAX_CHANGE}
    values = {"parameter": names[worst]}
    unit = PAIR_PARAMETERS[worst].unit
    diagnosis = Diagnosis(
        "halves_differ", float(fit.change[worst]), float(fit.change_sigma[worst]), unit, shift, values
    )
    return ModelTest("halves", float(abs(changes[worst])), MAX_CHANGE, "sigma", diagnosis)


def _of_pair(number: int, test: ModelTest) -> ModelTest:
    """Return a test for effects outside the model in which the parameters have the names of a pair."""
    diagnosis = test.diagnosis
    shift = {pair_name(name, number): size for name, size in diagnosis.parameter_shift.items()}
    if changed := diagnosis.values.get("parameter"):
        values = {**diagnosis.values, "parameter": pair_name(changed, number)}
        return replace(test, diagnosis=replace(diagnosis, parameter_shift=shift, values=values))
    if diagnosis.cause == NO_SINGLE_EFFECT:
        return replace(test, diagnosis=replace(diagnosis, parameter_shift=shift))
    values = {**diagnosis.values, "number": number, "effect": diagnosis.cause}
    return replace(test, diagnosis=replace(diagnosis, cause="pair_effect", parameter_shift=shift, values=values))


def _details(
    secondary: Secondary, calibrated: PairResult | None, check: StaticCheck | None, stored: StoredCrossCalibration
) -> dict[str, Any]:
    current = stored if calibrated is None else calibrated.stored
    details: dict[str, Any] = {
        "number": secondary.number,
        "serial": secondary.imu.serial,
        "check": check and check_values(check),
        "stored": {
            "values": dict(current.values),
            "gyro_static": current.gyro_static,
            "accel_static": current.accel_static,
        },
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
