"""Consecutive calibrations on the virtual bench with random faults, and their evaluation with the bench's truth."""

import random
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from calstation.config import RunRequest
from calstation.errors import ConfigurationError
from calstation.results import deliver_pending
from calstation.runs import Engine
from calstation.sequencer import Command, StepStarted
from calstation.simulation.soak_judge import RunEvaluation, judge_run, resident_mb
from calstation.simulation.soak_plan import STAGES, PlannedRun, plans, write_request

#: Longest host time of a run with short schedules, s; ten times as long with full schedules.
_RUN_TIMEOUT = 300.0

#: Permitted growth of a process's memory in addition to 10 %, MB, because code and caches are loaded on first use.
_ALLOWED_GROWTH = 20.0


@dataclass
class Soak:
    """The completed runs of a soak test, and the number of results not delivered to the hand-over folder."""

    runs: list[RunEvaluation] = field(default_factory=list)
    undelivered: int = 0

    def counts(self) -> dict[str, Any]:
        """Return totals over all runs as JSON data."""
        injected = Counter(kind for run in self.runs for kind in run.injected)
        return {
            "runs": len(self.runs),
            "outcomes": dict(Counter(run.outcome for run in self.runs)),
            "devices": dict(Counter(run.planned.devices for run in self.runs)),
            "faults": {
                kind: {
                    "injected": count,
                    "recovered": sum(kind in run.injected and run.recovered for run in self.runs),
                    "stopped_safely": sum(kind in run.injected and run.stopped_safely for run in self.runs),
                }
                for kind, count in sorted(injected.items())
            },
            "faults_injected": sum(injected.values()),
            "recovered": sum(run.recovered for run in self.runs),
            "stopped_safely": sum(run.stopped_safely for run in self.runs),
            "wrong_verdicts": sum(bool(run.verdict_errors) for run in self.runs),
            "unsafe": sum(run.unsafe for run in self.runs),
            "hung": sum(run.outcome == "hung" for run in self.runs),
            "samples": sum(run.samples for run in self.runs),
            "samples_lost": sum(run.samples_lost for run in self.runs),
            "lost_records": sum(bool(run.record_defects) for run in self.runs) + self.undelivered,
            "engine_memory_mb": _trend([run.engine_mb for run in self.runs]),
            "parent_memory_mb": _trend([run.parent_mb for run in self.runs]),
            "seconds_per_run": _mean([run.seconds for run in self.runs]),
            "problems": [
                {
                    "run": run.planned.number,
                    "seed": run.planned.seed,
                    "devices": run.planned.devices,
                    "faults": list(run.injected),
                    "what": what,
                }
                for run in self.runs
                for what in (*run.verdict_errors, *run.record_defects, *(["table not left safe"] if run.unsafe else []))
            ],
        }

    @property
    def passed(self) -> bool:
        """Whether no run had a wrong verdict, was unsafe or hung, no record was lost, and memory did not grow."""
        counts = self.counts()
        memory = counts["parent_memory_mb"]
        grown = memory["last"] > 1.1 * memory["first"] + _ALLOWED_GROWTH
        return not grown and not any(counts[name] for name in ("wrong_verdicts", "lost_records", "unsafe", "hung"))


def soak(
    runs: int, seed: int, folder: Path, *, full: bool, on_run: Callable[[Soak], None], stopping: Callable[[], bool]
) -> Soak:
    """Run consecutive calibrations with short schedules, or with full ones if `full`.

    Raises ConfigurationError if the folder already contains runs.

    Parameters
    ----------
    runs : number of runs
    seed : seed of the faults and units
    folder : folder for the runs
    full : whether to use full schedules
    on_run : function that is called after each run
    stopping : function that returns whether to stop before the next run
    """
    if (folder / "runs").exists():
        raise ConfigurationError("study.folder_in_use", folder=folder)
    series = Soak()
    stages = () if full else STAGES
    for planned in plans(runs, seed):
        if stopping():
            break
        request = write_request(planned, folder, stages)
        begin = time.monotonic()
        hung, memory = _observe(request, planned, _RUN_TIMEOUT * (10.0 if full else 1.0))
        report = folder / "bench" / f"{planned.number}.json"
        seconds = time.monotonic() - begin
        series.runs.append(judge_run(planned, request, hung, memory, seconds, report))
        on_run(series)
    series.undelivered = deliver_pending(lambda *_, **__: None, folder / "runs", folder / "station.toml").waiting
    return series


def _observe(request: RunRequest, planned: PlannedRun, timeout: float) -> tuple[bool, float]:
    """Run the engine; return whether it exceeded `timeout`, s, and its peak memory, MB."""
    kinds = [kind for kind, _ in planned.faults]
    moment = random.Random(planned.seed).randrange(2, 15)
    steps, memory = 0, 0.0
    deadline = time.monotonic() + timeout
    with Engine.start(request) as engine:
        while not engine.ended:
            memory = max(memory, resident_mb(engine.process.pid))
            for event in engine.poll():
                if isinstance(event, StepStarted):
                    steps += 1
                    if steps == moment and "operator_stop" in kinds:
                        engine.send(Command.STOP)
                    if steps == moment and "window_killed" in kinds:
                        engine.stop_listening()
            if time.monotonic() > deadline:
                return True, memory
            time.sleep(0.05)
    return False, memory


def _mean(values: list[float]) -> float:
    return sum(values) / len(values) if values else 0.0


def _trend(values: list[float]) -> dict[str, float]:
    """Return the means of the first and the last tenth of the values, and the largest value."""
    tenth = max(1, len(values) // 10)
    return {"first": _mean(values[:tenth]), "last": _mean(values[-tenth:]), "largest": max(values, default=0.0)}
