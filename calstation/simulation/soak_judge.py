"""Judges a run of a soak: its verdict against the bench's truth, its records, and how the table was left."""

import json
import os
import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calstation.bench import BenchConfig
from calstation.config import ResolvedConfiguration, RunRequest, resolve_configuration
from calstation.devices.profiles import TableProfile
from calstation.errors import CalstationError
from calstation.physics import INDEX
from calstation.records import Check, open_log
from calstation.runs import finish_incomplete
from calstation.simulation.fault_plan import HOST, SET_UP, with_faults
from calstation.simulation.soak_plan import MILD, Planned

#: A parameter further from the truth than this many of its sigmas is wrong.
SIGMAS = 6.0

#: Host time in which the bench writes its report, s.
_REPORT_WITHIN = 10.0

#: A larger gap is a jump of the counter, not a loss: no run survives such a long silence.
_JUMP = 5_000

#: Faults with which a good unit must fail.
_MUST_FAIL = ("wrong_gravity",)

_OUTCOMES = ("passed", "failed", "stopped", "fault", "incomplete")
_VERDICTS = ("passed", "failed")


@dataclass(frozen=True)
class Judged:
    """Judgement of one run.

    `outcome` and `error` are the result's; ``hung`` or ``lost`` without a result. `injected` are the kinds of faults
    that occurred, `wrong` what is wrong with the verdict, `lost` what is missing of the records. `unsafe` : the table
    was left moving, or enabled although it can switch off without the engine. Peaks of resident memory in MB, host time
    in s.
    """

    planned: Planned
    outcome: str
    error: str | None
    injected: tuple[str, ...]
    wrong: tuple[str, ...]
    lost: tuple[str, ...]
    unsafe: bool
    samples: int
    samples_lost: int
    engine_mb: float
    parent_mb: float
    seconds: float

    @property
    def recovered(self) -> bool:
        """Whether the verdict is right in spite of faults."""
        return bool(self.injected) and self.outcome in _VERDICTS and not self.wrong

    @property
    def stopped_safely(self) -> bool:
        """Whether faults prevented a verdict and the table is at rest with its axes off."""
        return bool(self.injected) and self.outcome in _OUTCOMES and not (self.recovered or self.unsafe)


def judge_run(
    planned: Planned, request: RunRequest, hung: bool, engine_mb: float, seconds: float, report: Path
) -> Judged:
    """Judge a run by what it left behind.

    Parameters
    ----------
    planned, request : of the run
    hung : whether it did not end in time
    engine_mb, seconds : peak memory of the engine, MB; duration, host time
    report : file that the bench writes at its end; missing if it died with the engine
    """
    kinds = [kind for kind, _ in planned.faults]
    bench = _bench(report)
    died = bool(kinds) and "engine_killed" in kinds and not _ended(request)
    setup = resolve_configuration(request, with_faults)
    happened = [kind for kind in kinds if kind in bench.get("obeyed", ()) or _set_up(kind, setup)]
    result, lost = _records(request, died)
    outcome = "hung" if hung else str(result.get("outcome", "lost"))
    happened += [kind for kind in kinds if kind in HOST and outcome == "incomplete"]
    happened += [kind for kind in kinds if kind in ("operator_stop", "window_killed") and outcome == "stopped"]
    lost_link = died or "mute_table" in happened
    samples, missing = _samples(result, "jump_counter" in happened)
    return Judged(
        planned=planned,
        outcome=outcome,
        error=result.get("error"),
        injected=tuple(happened),
        wrong=tuple(_wrong(planned, request, result, outcome, happened)),
        lost=tuple(lost),
        unsafe=bool(bench.get("moving", True) or (bench["enabled"] and not (lost_link and _left_alone(setup.table)))),
        samples=samples,
        samples_lost=missing,
        engine_mb=engine_mb,
        parent_mb=resident_mb(os.getpid()),
        seconds=seconds,
    )


def _set_up(kind: str, setup: ResolvedConfiguration) -> bool:
    """Whether a fault from the start had an effect on these devices."""
    if kind == "watchdog_off":
        return _watched(setup.table)
    if kind == "never_ready":
        return bool(setup.imu.status.ready)
    return kind in SET_UP


def _watched(table: TableProfile) -> bool:
    """Whether the table has a watchdog."""
    names = table.registers if table.text is None else table.text.queries
    return any("watchdog" in name for name in names)


def _left_alone(table: TableProfile) -> bool:
    """Whether nothing switches the axes off when the link is lost: the table completes its move and rests."""
    return table.link_loss_stop_s is None and not _watched(table)


def _records(request: RunRequest, died: bool) -> tuple[dict[str, Any], list[str]]:
    """The result of the run, and what is missing of its records."""
    logs = sorted(request.out.glob(f"{request.serial}_*.h5"))
    if not logs:
        return {}, ["no log"]
    path = logs[-1]
    if died:
        os.utime(path, (0.0, 0.0))
        finish_incomplete(request.out)
    result = _read(path.with_suffix(".json"))
    if result.get("outcome") not in _OUTCOMES:
        return result, ["no result"]
    try:
        log = open_log(path)
        facts = log.facts()
    except CalstationError as error:
        return result, [f"log: {error}"]
    lost = []
    if facts.sha256 != result["log"]["sha256"]:
        lost.append("the log is not the one that the result is of")
    if log.outcome != (None if result["outcome"] == "incomplete" else result["outcome"]):
        lost.append(f"the log ends as {log.outcome}, the result as {result['outcome']}")
    return result, lost


def _wrong(
    planned: Planned, request: RunRequest, result: dict[str, Any], outcome: str, happened: Collection[str]
) -> list[str]:
    if outcome == "hung":
        return ["it hung"]
    happened_so = [fault for fault in planned.faults if fault[0] in happened]
    if outcome not in _VERDICTS and not planned.faulty_unit and set(happened_so) <= set(MILD):
        return [f"no verdict without need: {result.get('error') or outcome}"]
    must_fail = bool(set(_MUST_FAIL) & set(happened))
    if outcome not in _VERDICTS or (outcome == "failed" and (planned.faulty_unit or must_fail)):
        return []
    if must_fail:
        return [f"passed with {', '.join(happened)}"]
    setup = resolve_configuration(request, with_faults)
    truth = BenchConfig.model_validate(setup.bench_config()).truth().imu.parameters
    if outcome == "failed":
        missed = [check for check in result["checks"] if not check["passed"]]
        if any(_near_limit(check, result, truth) for check in missed):
            return []
        return [f"a good unit failed: {', '.join(check['name'] for check in missed)}"]
    return [*_off(result, truth), *_outside(setup, result, truth)]


def _near_limit(check: dict[str, Any], result: dict[str, Any], truth: np.ndarray) -> bool:
    """Whether the truth is outside its limit, or so near that noise may move the estimate outside."""
    interval = _interval(check, result)
    if interval is None:
        return False
    name, low, high, room = interval
    return not low + room <= truth[INDEX[name]] <= high - room


def _interval(row: Mapping[str, Any], result: dict[str, Any]) -> tuple[str, float, float, float] | None:
    """Parameter, limits and `SIGMAS` sigmas of a check of a value; None for other checks."""
    check = Check.from_json(row)
    if check.kind != "within" or not isinstance(check.limit, tuple):
        return None
    parameter = result["parameters"].get(check.subject)
    return None if parameter is None else (check.subject, *check.limit, SIGMAS * parameter["sigma"])


def _off(result: dict[str, Any], truth: np.ndarray) -> list[str]:
    found = []
    for name, row in result["parameters"].items():
        away = abs(row["value"] - truth[INDEX[name]]) / row["sigma"]
        if away > SIGMAS:
            found.append(f"passed with {name} off by {away:.1f} sigma")
    return found


def _outside(setup: ResolvedConfiguration, result: dict[str, Any], truth: np.ndarray) -> list[str]:
    """Parameters judged inside their limits whose truth is outside by more than their sigma allows."""
    found = []
    for check in result["checks"]:
        interval = _interval(check, result)
        if interval is not None:
            name, low, high, room = interval
            if not low - room <= truth[INDEX[name]] <= high + room:
                found.append(f"passed with {name} outside its limits")
    return found


def _bench(report: Path) -> dict[str, Any]:
    """The bench's report, written after its watchdog's timeout; {} if it never comes."""
    deadline = time.monotonic() + _REPORT_WITHIN
    while not report.exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    return _read(report)


def _ended(request: RunRequest) -> bool:
    """Whether the run itself wrote its result."""
    return bool(list(request.out.glob(f"{request.serial}_*.json")))


def _samples(result: dict[str, Any], jumped: bool) -> tuple[int, int]:
    """Number of samples in a run's log, and missing between them; a jump of the counter is not a loss."""
    if "log" not in result:
        return 0, 0
    count = missing = 0
    last: int | None = None
    try:
        for block in open_log(Path(result["log"]["file"])).blocks():
            seq = block.seq if last is None else np.concatenate(([last], block.seq))
            lost = np.diff(seq) - 1
            missing += int(lost[lost < _JUMP].sum() if jumped else lost.sum())
            count += len(block)
            last = int(block.seq[-1])
    except CalstationError:
        return count, missing
    return count, missing


def _read(path: Path) -> dict[str, Any]:
    try:
        content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content


def resident_mb(pid: int | None) -> float:
    """Peak resident memory of a process, MB; 0 if unknown."""
    try:
        text = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    except OSError:
        return 0.0
    return next((int(line.split()[1]) / 1024.0 for line in text.splitlines() if line.startswith("VmHWM")), 0.0)
