"""Was a run of a soak right? Its verdict against the bench's truth, its records, how the table was left."""

import json
import os
import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from calstation.bench.config import BenchConfig
from calstation.config.request import RunRequest
from calstation.config.resolved import ResolvedConfiguration, resolve_configuration
from calstation.devices.profiles.table import TableProfile
from calstation.errors import CalstationError
from calstation.physics.parameters import INDEX
from calstation.records.limits import Check
from calstation.records.log import open_log
from calstation.runs.incomplete import finish_incomplete
from calstation.simulation.fault_plan import HOST, SET_UP, with_faults

if TYPE_CHECKING:
    from calstation.simulation.soak import Planned

#: A parameter further from the truth than so many of its own sigmas is wrong.
SIGMAS = 6.0

#: Host time in which a bench says how it was left, s.
_REPORT_WITHIN = 10.0

#: A gap of more samples than any run lasts in silence is a counter's jump.
_JUMP = 5_000

#: Kinds under which a good unit is rightly outside its limits.
_MUST_FAIL = ("wrong_gravity",)

#: Kinds with values that a run gets over: where a good unit has no others, no verdict is wrong.
MILD: tuple[tuple[str, float | None], ...] = (
    ("corrupt_frames", 3),
    ("drop_frames", 3),
    ("duplicate_frames", 2),
    ("reorder_frames", 2),
    ("noise_bytes", 4),
    ("jump_counter", 65_500),
    ("silence_imu", 0.4),
    ("garble_imu", 0.3),
    ("saturate_imu", 0.3),
    ("invalid_imu", 0.3),
    ("reset_imu", None),
    ("mute_table", 2),
    ("slow_table", 0.3),
    ("slow_imu", 1.2),
    ("garble_table", 1),
    ("refuse_table", 6),
)

_OUTCOMES = ("passed", "failed", "stopped", "fault", "incomplete")
_VERDICTS = ("passed", "failed")


@dataclass(frozen=True)
class Judged:
    """A run of a soak as it really was.

    Attributes
    ----------
    injected : kinds of faults that did happen
    wrong : what is wrong with its verdict; lost : what of its records is missing
    unsafe : the table was left moving, or with its axes on where it can switch them off without its engine
    samples, samples_lost : in its log, and missing between them
    engine_mb, parent_mb : peak of resident memory
    """

    planned: "Planned"
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
        """The right verdict in spite of faults."""
        return bool(self.injected) and self.outcome in _VERDICTS and not self.wrong

    @property
    def stopped_safely(self) -> bool:
        """No verdict because of faults, and the table at rest with its axes off."""
        return bool(self.injected) and self.outcome in _OUTCOMES and not (self.recovered or self.unsafe)


def judge_run(
    planned: "Planned", request: RunRequest, hung: bool, engine_mb: float, seconds: float, report: Path
) -> Judged:
    """Look at what a run left behind. `report` : of the bench, missing where it died with its engine."""
    from calstation.simulation.soak import resident_mb

    kinds = [kind for kind, _ in planned.faults]
    bench = _bench(report)
    died = bool(kinds) and "engine_killed" in kinds and not _ended(request)
    setup = resolve_configuration(request, with_faults)
    happened = [kind for kind in kinds if kind in bench.get("obeyed", ()) or _set_up(kind, setup)]
    result, lost = _records(request, died)
    outcome = "hung" if hung else str(result.get("outcome", "lost"))
    happened += [kind for kind in kinds if kind in HOST and outcome == "incomplete"]
    happened += [
        kind for kind in kinds if kind in ("operator_stop", "window_killed") and outcome == "stopped"
    ]
    lost_link = died or "mute_table" in happened
    samples, missing = _samples(result, "jump_counter" in happened)
    return Judged(
        planned=planned,
        outcome=outcome,
        error=result.get("error"),
        injected=tuple(happened),
        wrong=tuple(_wrong(planned, request, result, outcome, happened)),
        lost=tuple(lost),
        unsafe=bool(
            bench.get("moving", True) or (bench["enabled"] and not (lost_link and _left_alone(setup.table)))
        ),
        samples=samples,
        samples_lost=missing,
        engine_mb=engine_mb,
        parent_mb=resident_mb(os.getpid()),
        seconds=seconds,
    )


def _set_up(kind: str, setup: ResolvedConfiguration) -> bool:
    """Whether a kind made the bench another from the start: no device misses what it never had."""
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
    """Whether the table has nothing that switches its axes off when its link is lost: it ends its move and rests."""
    return table.link_loss_stop_s is None and not _watched(table)


def _records(request: RunRequest, died: bool) -> tuple[dict[str, Any], list[str]]:
    """The run's result, and what is missing of its records."""
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
    planned: "Planned", request: RunRequest, result: dict[str, Any], outcome: str, happened: Collection[str]
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
    """Whether the truth is outside its limit, or so near that noise may take the estimate there."""
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
    """Parameters that were found and judged inside their limits, and truly are not by more than their sigma allows."""
    found = []
    for check in result["checks"]:
        interval = _interval(check, result)
        if interval is not None:
            name, low, high, room = interval
            if not low - room <= truth[INDEX[name]] <= high + room:
                found.append(f"passed with {name} outside its limits")
    return found


def _bench(report: Path) -> dict[str, Any]:
    """How the bench was left, once its watchdog has had its time; {} where it never says."""
    deadline = time.monotonic() + _REPORT_WITHIN
    while not report.exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    return _read(report)


def _ended(request: RunRequest) -> bool:
    """Whether the run wrote its result itself."""
    return bool(list(request.out.glob(f"{request.serial}_*.json")))


def _samples(result: dict[str, Any], jumped: bool) -> tuple[int, int]:
    """Samples in a run's log, and those missing between them; what a counter on order `jumped` is no loss."""
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
