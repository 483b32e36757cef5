"""Evaluation of a run of a soak test: its verdict against the truth of the bench, its records, and the final state."""

import os
import time
from collections.abc import Collection
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calstation.bench import BenchConfig, BenchReport
from calstation.config import RunConfiguration, RunRequest, load_configuration
from calstation.devices.profiles import TableProfile
from calstation.errors import CalstationError
from calstation.judgement import Check
from calstation.physics import INDEX, FloatArray
from calstation.records import open_log
from calstation.results import Result, load_result
from calstation.runs import finish_incomplete
from calstation.simulation.bench_settings import bench_config
from calstation.simulation.fault_plan import HOST_FAULTS, INITIAL_FAULTS, with_faults
from calstation.simulation.soak_plan import OBSERVER_FAULTS, TOLERATED_FAULTS, PlannedRun

#: Largest error of a correct parameter, in sigmas.
SIGMA_LIMIT = 6.0

#: Time allowed for the bench to write its report, host time, s.
_REPORT_TIMEOUT = 20.0

#: Smallest gap that is interpreted as a counter jump, in samples: no run continues after losing so many.
_MIN_COUNTER_JUMP = 5_000

#: Kinds of faults with which a good unit must fail.
_MUST_FAIL = {"wrong_gravity"}

_VERDICTS = ("passed", "failed")


@dataclass(frozen=True)
class RunEvaluation:
    """Evaluation of one run.

    `outcome` is the outcome of the result, ``hung``, or ``lost`` without a result; `error` is the error in the result.
    `injected` lists the kinds of faults that occurred, `verdict_errors` the errors of the verdict, and `record_defects`
    the defects of the records. `unsafe` is True if the table was still moving at the end, or was still enabled although
    it can switch off without the engine. `engine_mb` and `parent_mb` are peaks of resident memory, MB; `seconds` is
    host time, s.
    """

    planned: PlannedRun
    outcome: str
    error: str | None
    injected: tuple[str, ...]
    verdict_errors: tuple[str, ...]
    record_defects: tuple[str, ...]
    unsafe: bool
    samples: int
    samples_lost: int
    engine_mb: float
    parent_mb: float
    seconds: float

    @property
    def recovered(self) -> bool:
        """Whether the verdict is correct despite faults."""
        return bool(self.injected) and self.outcome in _VERDICTS and not self.verdict_errors

    @property
    def stopped_safely(self) -> bool:
        """Whether faults prevented a verdict and the table is at rest with its axes off."""
        ended = self.outcome not in ("hung", "lost")
        return bool(self.injected) and ended and not (self.recovered or self.unsafe)


def judge_run(
    planned: PlannedRun, request: RunRequest, hung: bool, engine_mb: float, seconds: float, report: Path
) -> RunEvaluation:
    """Evaluate a run from its files; wait for the report of the bench for at most `_REPORT_TIMEOUT`.

    Parameters
    ----------
    planned : plan of the run
    request : request for the run
    hung : whether the run did not end in time
    engine_mb, seconds : peak memory of the engine, MB, and duration, host time in s
    report : file of the bench's report, which is missing if the bench died with the engine
    """
    kinds = [kind for kind, _ in planned.faults]
    bench = _bench_report(report)
    died = "engine_killed" in kinds and not list(request.out.glob(f"{request.serial}_*.json"))
    setup = load_configuration(request, with_faults)
    executed = () if bench is None else bench.executed
    occurred = [kind for kind in kinds if kind in executed or _takes_effect(kind, setup)]
    result, defects = _records(request, died)
    outcome = "hung" if hung else "lost" if result is None else result.outcome
    occurred += [kind for kind in kinds if kind in HOST_FAULTS and outcome == "incomplete"]
    occurred += [kind for kind in kinds if kind in OBSERVER_FAULTS and outcome == "stopped"]
    link_lost = died or "mute_table" in occurred
    may_stay_on = link_lost and _keeps_axes_on(setup.table)
    samples, missing = _samples(result, "jump_counter" in occurred)
    return RunEvaluation(
        planned=planned,
        outcome=outcome,
        error=None if result is None else result.error,
        injected=tuple(occurred),
        verdict_errors=tuple(_verdict_errors(planned, request, result, outcome, occurred)),
        record_defects=tuple(defects),
        unsafe=bench is None or bench.moving or (bench.enabled and not may_stay_on),
        samples=samples,
        samples_lost=missing,
        engine_mb=engine_mb,
        parent_mb=resident_mb(os.getpid()),
        seconds=seconds,
    )


def _takes_effect(kind: str, setup: RunConfiguration) -> bool:
    """Return whether a fault present from the start has an effect on these devices."""
    if kind == "watchdog_off":
        return _has_watchdog(setup.table)
    if kind == "never_ready":
        return bool(setup.imu.status.ready)
    return kind in INITIAL_FAULTS


def _has_watchdog(table: TableProfile) -> bool:
    names = table.registers if table.text is None else table.text.queries
    return any("watchdog" in name for name in names)


def _keeps_axes_on(table: TableProfile) -> bool:
    """Return whether the axes stay on after the link is lost, so that the table completes its move and then rests."""
    return table.link_loss_stop_s is None and not _has_watchdog(table)


def _records(request: RunRequest, died: bool) -> tuple[Result | None, list[str]]:
    """Return the result of the run and the defects of its records."""
    logs = sorted(request.out.glob(f"{request.serial}_*.h5"))
    if not logs:
        return None, ["no log"]
    path = logs[-1]
    if died:
        os.utime(path, (0.0, 0.0))
        finish_incomplete(request.out)
    try:
        result = load_result(path.with_suffix(".json"))
    except CalstationError:
        return None, ["no result"]
    try:
        log = open_log(path)
        facts = log.facts()
    except CalstationError as error:
        return result, [f"log: {error}"]
    defects = []
    if facts.sha256 != result.log.sha256:
        defects.append("the digest of the log is not the one in the result")
    if log.outcome != (None if result.outcome == "incomplete" else result.outcome):
        defects.append(f"the log ends as {log.outcome}, the result as {result.outcome}")
    return result, defects


def _verdict_errors(
    planned: PlannedRun, request: RunRequest, result: Result | None, outcome: str, occurred: Collection[str]
) -> list[str]:
    if outcome == "hung":
        return ["it hung"]
    only_mild = {fault for fault in planned.faults if fault[0] in occurred} <= set(TOLERATED_FAULTS)
    if outcome not in _VERDICTS and not planned.faulty_unit and only_mild:
        return [f"no verdict without need: {(result and result.error) or outcome}"]
    must_fail = bool(_MUST_FAIL & set(occurred))
    if result is None or outcome not in _VERDICTS or (outcome == "failed" and (planned.faulty_unit or must_fail)):
        return []
    if must_fail:
        return [f"passed with {', '.join(occurred)}"]
    setup = load_configuration(request, with_faults)
    truth = BenchConfig.model_validate(bench_config(setup)).truth().parameters
    if outcome == "failed":
        if any(_outside(check, result, truth, -SIGMA_LIMIT) for check in result.failed_checks):
            return []  # the truth is outside, or so close that the estimate may be outside due to noise
        return [f"a good unit failed: {', '.join(check.name for check in result.failed_checks)}"]
    deviations = {n: abs(row.value - truth[INDEX[n]]) / row.sigma for n, row in result.parameters.items()}
    errors = [
        f"passed with {name} off by {sigmas:.1f} sigma" for name, sigmas in deviations.items() if sigmas > SIGMA_LIMIT
    ]
    outside_limits = [check.subject for check in result.checks if _outside(check, result, truth, SIGMA_LIMIT)]
    return errors + [f"passed with {name} outside its limits" for name in outside_limits]


def _outside(check: Check, result: Result, truth: FloatArray, sigmas: float) -> bool:
    """Return whether the true value is outside a value check's limits, widened by `sigmas`; False for other checks."""
    parameter = result.parameters.get(check.subject)
    if check.kind != "within" or not isinstance(check.limit, tuple) or parameter is None:
        return False
    (low, high), margin = check.limit, sigmas * parameter.sigma
    return not low - margin <= truth[INDEX[check.subject]] <= high + margin


def _bench_report(path: Path) -> BenchReport | None:
    """Return the bench's report, which is written after its watchdog's timeout; None if it is not written."""
    deadline = time.monotonic() + _REPORT_TIMEOUT
    while time.monotonic() < deadline:
        with suppress(OSError, ValueError):  # missing, or not yet complete
            return BenchReport.model_validate_json(path.read_text(encoding="utf-8"))
        time.sleep(0.05)
    return None


def _samples(result: Result | None, jumped: bool) -> tuple[int, int]:
    """Return the numbers of recorded and missing samples in a run's log; a counter jump is not a loss if `jumped`."""
    count = missing = 0
    if result is None:
        return count, missing
    last: int | None = None
    try:
        for block in open_log(Path(result.log.file)).blocks():
            seq = block.seq if last is None else np.concatenate(([last], block.seq))
            gaps = np.diff(seq) - 1
            missing += int(gaps[gaps < _MIN_COUNTER_JUMP].sum() if jumped else gaps.sum())
            count += len(block)
            last = int(block.seq[-1])
    except CalstationError:
        pass
    return count, missing


def resident_mb(pid: int | None) -> float:
    """Return the peak resident memory of a process, MB; 0 if unknown."""
    try:
        text = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    except OSError:
        return 0.0
    return next((int(line.split()[1]) / 1024.0 for line in text.splitlines() if line.startswith("VmHWM")), 0.0)
