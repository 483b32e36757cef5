"""Faults rehearsed on the virtual bench: each run must end with its code, and no fault may lead to a wrong verdict.

The runs use the engine, the drivers and the protocols of a real run, with the shipped profiles and a separate site.
"""

import math
import os
import tempfile
import threading
import time
from collections.abc import Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import tomli_w

from calstation.errors import CalstationError, StoppedError
from calstation.messages import Text
from calstation.records import KEY_VARIABLE, open_log
from calstation.results import Result, load_result, resolve_log
from calstation.runs import Engine
from calstation.schema import read_toml
from calstation.sequencer import Command, StateChanged, TableMoved
from calstation.simulation import SHORT_STAGES, PlannedRun, RunEvaluation, judge_run, write_request
from calstation.validation.lines import CheckStopped, Line, guarded

#: Variable with the folder of the site.
_HOME = "CALSTATION_HOME"
_STAGE = "six_position"
#: Longest host time of a run, s.
_TIMEOUT = 240.0
#: Longest time between STOP and axes off on the bench in real time, s: the table decelerates from 100 °/s at
#: 100 °/s² in 1 s, and the rest is for one tick of the engine and the polls of the table.
STOP_LIMIT = 2.0
#: Rate of the table above which STOP is sent in real time, rad/s: 90 °/s.
_STOP_FROM = math.radians(90.0)
#: Number of simultaneous runs; each has several processes.
_PARALLEL = 2


@dataclass(frozen=True)
class Case:
    """One rehearsal: its fault and value, and the outcome and code with which the run must end."""

    kind: str
    outcome: str
    code: str | None = None
    value: float | None = None
    from_start: bool = False  #: Whether the fault exists before the run.
    real_time: bool = False  #: Whether the bench runs in real time, and STOP is sent while the table turns.


#: Name of the run without a fault.
NO_FAULT = "none"
CASES = (
    Case(NO_FAULT, "passed"),
    Case("interlock", "fault", "table.latched_interlock", 0.0),
    Case("trip_watchdog", "fault", "table.latched_watchdog"),
    Case("silence_imu", "fault", "stream.not_started", 600.0),
    Case("engine_killed", "incomplete"),
    Case("disk_full", "fault", "log.disk_nearly_full"),
    Case("wrong_unit", "fault", "preflight.other_unit", from_start=True),
    Case("wrong_gravity", "failed", from_start=True),
    Case("operator_stop", "stopped", real_time=True),
)


@dataclass(frozen=True)
class Ending:
    """How a rehearsal ended."""

    case: Case
    evaluation: RunEvaluation
    log: Path | None
    result: Result | None
    stop_s: float | None  #: Host time between STOP and axes off.


def rehearsal_lines(check_stopped: CheckStopped) -> Generator[Line]:
    """Run all cases, two at a time and the real-time case alone at the end, and yield their lines."""
    stopped = threading.Event()
    with (
        tempfile.TemporaryDirectory(prefix="calstation-validate-") as temporary,
        _separate_site(Path(temporary)),
        ThreadPoolExecutor(_PARALLEL) as pool,
    ):
        try:
            for real_time in (False, True):  # a run in real time needs the computer for itself
                pending = {
                    pool.submit(_rehearse, number, case, Path(temporary) / case.kind, stopped): case.kind
                    for number, case in enumerate(CASES)
                    if case.real_time == real_time
                }
                while pending:
                    done, _ = wait(pending, timeout=0.2, return_when="FIRST_COMPLETED")
                    check_stopped()
                    for future in done:
                        yield from guarded("faults", "ending", pending.pop(future), partial(_lines, future))
        finally:
            stopped.set()
            pool.shutdown(cancel_futures=True)


@contextmanager
def _separate_site(folder: Path) -> Iterator[None]:
    """Use another site, because runs write to the audit trail."""
    before = {name: os.environ.pop(name, None) for name in (_HOME, KEY_VARIABLE)}
    os.environ[_HOME] = str(folder / "site")
    try:
        yield
    finally:
        del os.environ[_HOME]
        os.environ.update({name: value for name, value in before.items() if value is not None})


def _rehearse(number: int, case: Case, folder: Path, stopped: threading.Event) -> Ending:
    folder.mkdir()
    planned = PlannedRun(number, 1, False, () if case.kind == NO_FAULT else ((case.kind, case.value),))
    request = write_request(planned, folder, SHORT_STAGES)
    fault: dict[str, Any] = {"kind": case.kind} | ({} if case.value is None else {"value": case.value})
    if not case.from_start:
        fault["stage"] = _STAGE
    planned_faults = [] if case.real_time or case.kind == NO_FAULT else [fault]
    (folder / "plan.toml").write_text(tomli_w.dumps({"fault": planned_faults}), encoding="utf-8")
    if case.real_time:
        station = read_toml(folder / "station.toml")
        station["bench"]["speed"] = 1.0
        (folder / "station.toml").write_text(tomli_w.dumps(station), encoding="utf-8")
    begin = time.monotonic()
    hung, stop_s = False, None
    with Engine.start(request) as engine:
        sent: float | None = None
        while not engine.ended:
            for event in engine.poll():
                if case.real_time and sent is None and isinstance(event, TableMoved) and _is_fast(event):
                    engine.send(Command.STOP)
                    sent = time.monotonic()
                if sent is not None and isinstance(event, StateChanged) and event.state == "stopped":
                    stop_s = time.monotonic() - sent
            hung = time.monotonic() - begin > _TIMEOUT
            if hung or stopped.wait(0.01):
                break
    if stopped.is_set():
        raise StoppedError("cli.aborted")
    report = folder / "bench" / f"{number}.json"
    evaluation = judge_run(planned, request, hung, 0.0, time.monotonic() - begin, report)
    log = next(iter(sorted(request.out.glob(f"{request.serial}_*.h5"))), None)
    result = None
    with suppress(CalstationError):
        result = load_result(log.with_suffix(".json")) if log is not None else None
    return Ending(case, evaluation, log, result, stop_s)


def _is_fast(event: TableMoved) -> bool:
    return max(abs(event.outer_rate), abs(event.inner_rate)) >= _STOP_FROM


def _lines(future: Future[Ending]) -> Generator[Line]:
    yield from ending_lines(future.result())


def ending_lines(ending: Ending) -> Generator[Line]:
    """Yield the lines of a rehearsal."""
    case, run = ending.case, ending.evaluation
    code = None if ending.result is None else ending.result.error_code
    expected = Text.of("validation.ends", outcome=case.outcome, error=case.code or "–")
    found = Text.of("validation.ends", outcome=run.outcome, error=code or "–")
    good = (run.outcome, code) == (case.outcome, case.code)
    ended = Line.compared("faults", "ending", case.kind, expected, found, good)
    yield _with_load(ended) if case.real_time else ended
    state = Text("validation.unsafe" if run.unsafe else "validation.safe")
    yield Line.compared("faults", "table", case.kind, Text("validation.safe"), state, not run.unsafe)
    records = ", ".join(run.record_defects) or Text("validation.complete")
    yield Line.compared("faults", "records", case.kind, Text("validation.complete"), records, not run.record_defects)
    if case.real_time:
        line = Line.timed("time", "stop", "", ending.stop_s or 0.0, STOP_LIMIT)
        missing = replace(line, found=Text("validation.missing"), state="failed")
        yield _with_load(line if ending.stop_s is not None else missing)
    if case.kind == NO_FAULT and ending.result is not None and ending.log is not None:
        yield from _nominal_lines(ending.result, ending.log)


def _with_load(line: Line) -> Line:
    """Return a line of the rehearsal in real time; if it failed, a load by other programs is a possible reason."""
    return replace(line, reason=Text("validation.loaded")) if line.state == "failed" else line


def _nominal_lines(result: Result, path: Path) -> Generator[Line]:
    """Yield the lines of the run without a fault: the same solution from the log, and the registers read back."""
    log = open_log(path)
    solved = resolve_log(log, log.meta, diagnostics=False).result
    same = solved.parameters == result.parameters
    bits = Text("validation.bits" if same else "validation.other_bits")
    yield Line.compared("calculation", "online", "", Text("validation.bits"), bits, same)
    verified = result.registers is not None and result.registers.verified is True
    count = 0 if result.registers is None or result.registers.new is None else len(result.registers.new)
    found = Text.of("validation.registers" if verified else "validation.registers_unverified", count=count)
    yield Line.compared("calculation", "registers", "", Text("validation.read_back"), found, verified and count > 0)
