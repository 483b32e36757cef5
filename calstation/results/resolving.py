"""Solves stored logs with the solver chain of a run, and loads finished runs for analysis."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from calstation import __version__
from calstation.config import computer_user, gravity_contradiction
from calstation.errors import ConfigurationError, InputError, InsufficientDataError
from calstation.estimation import Solution
from calstation.estimation.common import PositionResidual, SampleBlock
from calstation.estimation.navigation import warm_up as compile_kernels
from calstation.jobs import ProgressCallback
from calstation.judgement import (
    Check,
    End,
    SolvedAgain,
    compare_only,
    judge,
    offline_online,
    unconfirmed_site,
    verdict_of,
)
from calstation.messages import Text, os_reason, sentence
from calstation.physics import EffectName
from calstation.records import (
    SUFFIX,
    Limit,
    Log,
    LogMeta,
    ModelSection,
    ResolveRecord,
    append_resolve,
    damage_summary,
    open_log,
    resolve_file,
    solved_stages,
    stages_ended_by_hand,
    step_labels,
    unsolved_stages,
)
from calstation.results.building import Ending, build_result, solved_parameters
from calstation.results.diagnostics import stage_diagnostics
from calstation.results.history import History
from calstation.results.result import SCHEMA, Result, online_difference
from calstation.results.sections import DamagedRange, Parameter
from calstation.results.solver_chain import SolveProgress, StageChain, one_blas_thread, solve
from calstation.results.stated import load_confirmed_result, was_simulated


def warm_up() -> None:
    """Compile the kernels for solving; the import of this module loads everything else."""
    compile_kernels()


@dataclass(frozen=True)
class Resolved:
    """The result of a log solved again, and the messages of its stages as (message id, values)."""

    result: Result
    messages: tuple[tuple[str, dict[str, Any]], ...]
    missing_data: tuple[Text, ...] = ()  #: Reasons why stages could not be solved.
    #: Residuals per rest and move, by stage in the order of the log; empty unless requested.
    residuals: Mapping[str, tuple[PositionResidual, ...]] = field(default_factory=dict)


def resolve(
    path: Path,
    stages: tuple[str, ...] | None = None,
    first_seq: int | None = None,
    last_seq: int | None = None,
    progress: SolveProgress | None = None,
    *,
    residuals: bool = False,
    states: tuple[EffectName, ...] = (),
    diagnostics: bool = True,
) -> Resolved:
    """Solve a log, or a CSV with its TOML, between two sequence numbers (both included, unwrapped).

    Without `stages`, stages with insufficient data are skipped; the result can then fail, but not pass.
    Damaged rows are treated as gaps and reported by the message ``log_damaged``. `progress` is called periodically.
    With `residuals`, the log is read a second time for the residuals by rest and move. `states` are estimated in
    addition to the states of the log's model; the result then lists them and is not compared with the stored result.
    Without `diagnostics`, only the parameters are solved, with bit-identical values; the result then has no verdict.

    The solution is recorded next to the log; the message ``resolve_unrecorded`` reports a failure to do so.

    Raises InputError or ConfigurationError if the log cannot be used or solved.
    """
    log = open_log(path)
    meta, added = with_states(log.meta, states)
    resolved = resolve_log(
        log, meta, stages, first_seq, last_seq, progress, residuals=residuals, added=added, diagnostics=diagnostics
    )
    try:
        append_resolve(path.absolute().parent, _record_of(path, resolved.result, stored_result(log)))
    except OSError as exc:
        file = resolve_file(path.parent).path
        unrecorded = ("resolve_unrecorded", {"file": str(file), "reason": os_reason(exc)})
        return replace(resolved, messages=(*resolved.messages, unrecorded))
    return resolved


def resolve_log(
    log: Log,
    meta: LogMeta,
    stages: tuple[str, ...] | None = None,
    first_seq: int | None = None,
    last_seq: int | None = None,
    progress: SolveProgress | None = None,
    *,
    residuals: bool = False,
    added: Sequence[EffectName] = (),
    diagnostics: bool = True,
) -> Resolved:
    """Solve an open log like `resolve`, but record nothing, with a configuration that may differ from the log's.

    `added` are the states in the model of `meta` that are missing in the log's own model. The result is compared with
    the stored result only if the configuration equals that of the log.

    Raises InputError or ConfigurationError if the log cannot be used or solved.
    """
    if first_seq is not None and last_seq is not None and first_seq > last_seq:
        raise ConfigurationError("solution.range_reversed", first=first_seq, last=last_seq)
    _check_range(log, first_seq, last_seq)
    chain = StageChain(meta, diagnostics=diagnostics)
    unsolved = unsolved_stages(log.events) if stages is None else frozenset()

    def blocks() -> Iterator[SampleBlock]:
        return (block for block in log.blocks(first_seq, last_seq) if block.stage not in unsolved)

    solve(blocks, meta, stages, source=log.path, progress=progress, chain=chain)
    facts = log.facts(first_seq, last_seq)
    if log.damaged_rows and stages is None and first_seq is None and last_seq is None:
        _check_complete(log, [*(solution.stage for solution in chain.solutions), *chain.missing_data, *unsolved])
    solutions, missing = tuple(chain.solutions), chain.missing_data
    if diagnostics:
        stored = stored_result(log) if meta == log.meta else None
        solved_again = SolvedAgain(complete=not missing, online=_compare_online(meta, solutions, stored))
        judgement = judge(meta, chain.prior, solutions, again=solved_again)
    else:
        judgement = compare_only(meta, chain.prior, solutions)
    with one_blas_thread():
        table = chain.table()
    ending = Ending(
        verdict_of(End.COMPLETED, judgement.passed, partial=judgement.partial),
        str(log.path),
        facts,
        part=facts != log.facts(),
        table=table,
        solved_again=True,
        ended_by_hand=stages_ended_by_hand(log.events, meta.schedule),
    )
    result = build_result(meta, chain.prior, solutions, judgement, ending)
    messages = [(key, dict(values)) for solution in solutions for key, values in solution.messages]
    if judgement.latitude is not None:
        messages.append(("latitude_untold", dict(judgement.latitude)))
    contradiction = gravity_contradiction(meta.site)
    if contradiction is not None:
        messages.append(("gravity_contradicts", dict(contradiction.values)))
    site = unconfirmed_site(meta, solutions)
    if site is not None:
        messages.append(("site_unconfirmed", site))
    if added:
        result = result.model_copy(update={"states_added": list(added)})
        messages.insert(0, ("states_added", {"states": ", ".join(added)}))
    if log.damaged_rows:
        damaged = [DamagedRange(rows=rows.count, seq=rows.missing) for rows in log.damaged_rows]
        result = result.model_copy(update={"log": result.log.model_copy(update={"damaged": damaged})})
        messages.insert(0, ("log_damaged", {"file": log.path.name, **damage_summary(log.damaged_rows)}))
    messages[:0] = [("log_times", {"file": log.path.name, "what": text}) for text in log.times.irregularities]
    if missing:
        result = result.model_copy(update={"missing_data": {stage: sentence(why) for stage, why in missing.items()}})
    by_stage = {}
    if residuals:
        with one_blas_thread():
            by_stage = {d.stage: d.residuals for d in stage_diagnostics(log, chain, first_seq, last_seq)}
    return Resolved(result, tuple(messages), tuple(missing.values()), by_stage)


def _compare_online(meta: LogMeta, solutions: Sequence[Solution], stored: Result | None) -> list[Check]:
    """Return the check of the parameters against those of the run; [] if the product has none."""
    section = meta.product.checks if meta.product is not None else None
    if section is None or stored is None:
        return []
    both = (solved_parameters(solutions), stored.parameters)
    offline, online = ({name: row.model_dump() for name, row in rows.items()} for rows in both)
    return offline_online(section, offline, online)


def _record_of(path: Path, result: Result, stored: Result | None) -> ResolveRecord:
    return ResolveRecord(
        utc=datetime.now(UTC).isoformat(timespec="seconds"),
        by=computer_user(),
        log=path.name,
        log_sha256=result.log.sha256,
        first_seq=result.log.first_seq,
        last_seq=result.log.last_seq,
        stages=tuple(result.stages),
        states_added=tuple(result.states_added),
        software=__version__,
        configuration_sha256=result.configuration_sha256,
        passed=result.passed,
        tested=result.tested,
        difference=None if stored is None else online_difference(result, stored),
    )


def with_states(meta: LogMeta, states: tuple[EffectName, ...]) -> tuple[LogMeta, list[EffectName]]:
    """Return the configuration of a log with more states in its model, and the states that were added.

    Raises ConfigurationError for a log over temperature.
    """
    present = meta.model.states if meta.model is not None else []
    added = [state for state in dict.fromkeys(states) if state not in present]
    if added and meta.temperature is not None:
        raise ConfigurationError("temperature.states", states=added)
    return meta.model_copy(update={"model": ModelSection(states=[*present, *added])} if added else {}), added


def _check_range(log: Log, first: int | None, last: int | None) -> None:
    """Raise InputError if the range exceeds the log."""
    if first is None and last is None:
        return
    facts = log.facts()
    before, after = first is not None and first < facts.first_seq, last is not None and last > facts.last_seq
    if facts.samples and (before or after):
        span = {"first": facts.first_seq, "last": facts.last_seq}
        raise InputError("solution.range_beyond", file=log.path, wanted=first if before else last, **span)


def stored_result(log: Log) -> Result | None:
    """Return the last result in a log, None if there is none. Raises InputError if it is malformed."""
    try:
        return Result.from_json(log.results[-1]) if log.results else None
    except ValueError as exc:
        raise InputError("result.not_a_result", file=log.path, schema=SCHEMA) from exc


def _check_complete(log: Log, solved: list[str]) -> None:
    """Raise InsufficientDataError if damage destroyed all samples of a stage that the run had solved."""
    for stage in solved_stages(log.events):
        if stage not in solved:
            what = Text.of("solution.stage_damaged", stage=stage)
            raise InsufficientDataError("solution.in_log", file=log.path, what=what)


def result_of(path: Path) -> Result:
    """Read a result file, or the stored result of a log; a log without a result is solved.

    Raises InputError or ConfigurationError if the file cannot be used.
    """
    if path.suffix == ".json":
        result = load_confirmed_result(path)
        return result.model_copy(update={"simulated": True}) if was_simulated(result, path) else result
    return stored_result(open_log(path)) or resolve(path).result


@dataclass(frozen=True)
class FinishedRun:
    """A result and the values with which it is compared."""

    result: Result
    log: Path | None  #: The run's log; None if it is missing.
    previous: Mapping[str, Parameter]  #: The unit's latest earlier estimate of each parameter with the same product.
    #: Labels of the moves by the number of the step; empty if the log cannot be read or has none.
    step_labels: Mapping[int, tuple[str | float, ...]] = field(default_factory=dict)
    previous_utc: str = ""  #: Start of the latest run in `previous`, ISO 8601; "" if none is.
    #: Limits of the product in the log, SI, by parameter or group; empty if the log cannot be read.
    limits: Mapping[str, Limit] = field(default_factory=dict)
    #: Sigmas of the current calibration with which a partial run started, SI, by parameter; empty for other runs.
    prior_sigmas: Mapping[str, float] = field(default_factory=dict)
    changed_schedules: tuple[str, ...] = ()  #: Stages whose schedule differed from that of the product.

    @property
    def updates_previous(self) -> bool:
        """Whether the run started from the calibration of the previous run and updated it."""
        calibration = self.result.calibration
        return calibration is not None and calibration.started_utc == self.previous_utc

    @property
    def runs(self) -> Path:
        """Folder of the log, also if the log is missing."""
        return (self.log or Path(self.result.log.file)).parent


def find_log(result: Result, path: Path) -> Path | None:
    """Return the log of a result file, at its original path or next to the result; None if it is missing."""
    candidates = (Path(result.log.file), path.with_suffix(SUFFIX))
    return next((candidate for candidate in candidates if candidate.is_file()), None)


def load_finished_run(report: ProgressCallback, path: Path, runs: Path) -> FinishedRun:
    """Job: read a result file, or a log, solving it if it has no result; `runs` is the folder of the unit's history.

    Raises InputError or ConfigurationError if the file cannot be used.
    """
    report(0.1)
    result = result_of(path)
    log = find_log(result, path) if path.suffix == ".json" else path
    report(0.9)
    previous: Mapping[str, Parameter] = {}
    previous_utc = ""
    if runs.is_dir():
        history = History(runs, measured=not result.simulated)
        history.refresh()
        previous, previous_utc = history.previous(result.serial, result.product, result.started_utc)
    labels: Mapping[int, tuple[str | float, ...]] = {}
    limits: Mapping[str, Limit] = {}
    sigmas: dict[str, float] = {}
    changed: list[str] = []
    with suppress(InputError):  # a missing or damaged log does not affect the result
        if log is not None:
            opened = open_log(log)
            limits = opened.meta.product.limits if opened.meta.product is not None else {}
            priors = ((name, opened.meta.prior.get(name)) for name in opened.meta.calibrated)
            sigmas = {name: prior.sigma for name, prior in priors if prior is not None and prior.sigma is not None}
            labels = step_labels(opened.events)
            changed = [s for e in opened.events if e.get("id") == "schedule_changed" for s in e["values"]["stages"]]
    stages = tuple(dict.fromkeys(changed))
    return FinishedRun(result, log, previous, labels, previous_utc, limits, sigmas, stages)


def resolve_with_state(report: ProgressCallback, run: FinishedRun, state: EffectName) -> FinishedRun:
    """Job: solve the log of a run again with one more state; the run's values become the previous values.

    Raises InputError or ConfigurationError if the log cannot be used or solved.
    """
    if run.log is None:
        raise ValueError("the log of the run is missing")
    log, stages = run.result.log, tuple(run.result.stages)
    count = log.last_seq - log.first_seq + 1

    def watch(stage: str, seq: int, done: float) -> None:
        report(min((seq - log.first_seq) / count, 0.99), note=stage)

    states = (*run.result.states_added, state)
    result = resolve(run.log, stages, log.first_seq, log.last_seq, watch, states=states).result
    return FinishedRun(result, run.log, run.result.parameters, run.step_labels, limits=run.limits)
