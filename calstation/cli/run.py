"""`run`: shows the events of a run as progress bars and messages, and stops the run safely after Ctrl-C."""

import shlex
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from math import degrees
from pathlib import Path
from typing import Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TaskProgressColumn, TextColumn
from rich.table import Table

from calstation.cli.confirmation import confirm_override
from calstation.cli.errors import command_options, complete_commands, print_error, station_options
from calstation.cli.process import interruption
from calstation.cli.show import emit_json, on_line, plain_console, result_notes, result_table, show_line
from calstation.cli.text import say, sentence, term
from calstation.config import RegisterOperation, RunRequest, load_station, with_product
from calstation.database import Claim, start_exchange
from calstation.errors import ConfigurationError, StoppedError
from calstation.jobs import on_stop_signals
from calstation.messages import Text, event_text, step_text
from calstation.records import Verdict
from calstation.results import History, Result
from calstation.runs import INTERNAL, Engine, Question, RunStart
from calstation.sequencer import (
    Command,
    Event,
    Fault,
    Finalized,
    Message,
    PositionGuided,
    StageProgress,
    StageSolved,
    StageStarted,
    StateChanged,
    StepStarted,
)
from calstation.validation import validation_due

#: Largest number of checks listed per unit of a batch.
_MAX_NAMED = 3

#: Line that the user enters to end a repeated stage.
_END_STAGE = "e"

#: Exit code by verdict; all other verdicts exit with 3.
_EXIT_CODES = {Verdict.PASSED: 0, Verdict.PARTIAL: 0, Verdict.FAILED: 1, Verdict.STOPPED: StoppedError.exit_code}

#: Code of the text for the result of the innovation test of a stage; None means that nothing was tested.
_CONSISTENCY = {True: "cli.consistent", False: "cli.not_consistent", None: "cli.consistency_untested"}

#: Answers used without a terminal, by the subject of the question. The engine refuses a unit after an interrupted
#: transfer unless the unit still has its old registers.
_WITHOUT_TERMINAL = {"spelling": "other_unit", "transfer": "undecided", "resume": "anew", "passed": "repeat"}


def run_command(
    request: RunRequest, json: str | None, answers: Mapping[str, str | None], *, confirmed_by: str | None, debug: bool
) -> int:
    """Run a calibration and return the exit code.

    Raises ConfigurationError if the request is invalid.

    Parameters
    ----------
    request : run to start
    json : file for the result JSON, ``-`` for standard output, or None
    answers : answers given by options, by the subject of the question; None without the option. For a check standard,
        the answer is the reason for the override
    confirmed_by : badge of the second person who confirms an override
    debug : whether to show the traceback of a programming error
    """
    if (due := validation_due()) is not None:
        show_line(plain_console(stderr=True), sentence(due))
    request = _ask_questions(with_product(request), answers, confirmed_by)
    finalized: list[Finalized] = []
    fault = None
    with shared_records(request) as new_claims:
        for event in engine_events(request, new_claims=new_claims):
            if isinstance(event, Finalized):
                finalized.append(event)
            elif isinstance(event, Fault) and not event.slot:
                fault = event
        with on_stop_signals(lambda: None):  # nothing is left to stop
            code = _show_outcome(finalized, fault, json, request, debug=debug)
        if (process := interruption()) is not None:
            process.command_completed(code)  # the last exchange of records may take some time
    return code


def _ask_questions(request: RunRequest, answers: Mapping[str, str | None], confirmed_by: str | None) -> RunRequest:
    """Ask the questions before the start of a run, and return the request for the engine.

    A question without an answer is asked on a terminal. Without a terminal, the run is refused unless
    `_WITHOUT_TERMINAL` contains an answer. Raises ConfigurationError or StoppedError.
    """
    if request.out.is_dir():
        History(request.out).refresh()
    has_options = request.stages is not None or request.seed is not None
    if has_options and request.resume is not None:
        raise ConfigurationError("cli.resume_options")
    start = RunStart(request, "engineer")
    while (question := start.next_question()) is not None:
        answer = answers.get(question.subject)
        if answer is None and not sys.stdin.isatty():
            answer = _WITHOUT_TERMINAL.get(question.subject)
            if answer is None:
                raise question.refusal
            show_line(plain_console(stderr=True), sentence(question.refusal.as_text))
        answer = _ask(question) if answer is None else answer
        if question.subject == "standard":
            confirm_override(start, answer, confirmed_by)
        else:
            start.answer(question, answer)
        if has_options and start.request.resume is not None:
            raise ConfigurationError("cli.resume_options")
    for warning in start.warnings:
        show_line(plain_console(stderr=True), sentence(warning))
    return start.request


def _ask(question: Question) -> str:
    """Ask a question on the terminal; return the answer, or the reason for an override. Raises StoppedError."""
    sys.stderr.write(f"{sentence(question.text)}\n")
    for answer in question.answers:
        if typer.confirm(sentence(Text(f"answer.{answer}", question.text.values)), err=True):
            reason = question.subject == "standard"
            return str(typer.prompt(say("cli.ask_reason"), err=True)) if reason else answer
    raise StoppedError("cli.not_confirmed")


@contextmanager
def shared_records(request: RunRequest) -> Iterator[Callable[[], Sequence[Claim]]]:
    """Exchange records with the database of the station, if it has one, and claim the unit, while the context is open.

    Yields a function that returns the new claims of other stations to the unit.
    """
    serials = filter(None, request.serials or (request.serial,))
    exchange = start_exchange(request.station, request.out, dict.fromkeys(serials, request.operator))
    if exchange is None:
        yield tuple
        return
    with exchange:
        yield exchange.new_claims


def engine_events(
    request: RunRequest,
    work: RunRequest | RegisterOperation | None = None,
    new_claims: Callable[[], Sequence[Claim]] = tuple,
) -> Iterator[Event]:
    """Run the engine, show its events and yield them; Ctrl-C and signals request a safe stop.

    Parameters
    ----------
    request : run that is shown
    work : job for the engine, by default the request itself
    new_claims : returns the claims of other stations to the unit; shown after every event
    """
    options = command_options(request.station, request.product, request.out, request.slot)
    console = plain_console(stderr=True)
    display = _Display(console, options)

    started, stopped = list[Engine](), list[Command]()

    def stop() -> None:
        stopped.append(Command.STOP)  # the engine may not have been started yet
        for engine in started:
            engine.send(Command.STOP)

    def end_stage() -> None:
        engine.send(Command.END_STAGE)
        show_line(console, say("cli.ending_stage"))

    if (process := interruption()) is not None and process.received:
        raise KeyboardInterrupt  # Python ignored the interruption, for instance in a destructor
    with (
        complete_commands(options),
        on_stop_signals(stop),
        Engine.start(work or request) as engine,
        display.progress,
    ):
        started.append(engine)
        if stopped:
            engine.send(Command.STOP)
        if work is None:
            on_line(_END_STAGE, end_stage)
        for event in engine.events():
            display.show(event)
            for claim in new_claims():
                display.show(claim.message)
            yield event


def print_fault(fault: Fault, request: RunRequest, *, debug: bool) -> int:
    """Show the fault that ended the engine's job, with its remedy, and return the exit code."""
    if fault.code:
        options = command_options(request.station, request.product, request.out, request.slot)
        print_error(sentence(Text(fault.code, {**fault.values, **options})))
    elif fault.kind == INTERNAL and not debug:
        print_error(say("cli.internal", words=fault.text.strip().splitlines()[-1]))
    else:
        print_error(fault.text)
    return fault.exit_code


def _show_outcome(
    finalized: Sequence[Finalized], fault: Fault | None, json: str | None, request: RunRequest, *, debug: bool
) -> int:
    """Show the finalized runs and the fault of a run; return the exit code, even if the output fails."""
    if finalized and request.serials:
        names = load_station(request.station)[1].slot_names
        finalized = sorted(finalized, key=lambda run: names.index(run.slot))
    results = [run.result for run in finalized]
    write = partial(emit_json, results if request.serials else results[0], json) if results else sys.stdout.flush
    for output in (partial(_show_runs, finalized, json, request), write, sys.stdout.flush):
        try:
            output()
        except BrokenPipeError:
            continue
        except ConfigurationError as error:
            print_error(sentence(error.as_text))
    if fault is not None:
        return print_fault(fault, request, debug=debug)
    return max((_EXIT_CODES.get(run.verdict, 3) for run in finalized), default=3)


def _show_runs(finalized: Sequence[Finalized], json: str | None, request: RunRequest) -> None:
    if finalized and request.serials:
        _show_batch(finalized, json, request)
    elif finalized:
        _show_run(finalized[0], json, request)


def _show_run(run: Finalized, json: str | None, request: RunRequest) -> None:
    result = Result.from_json(run.result)
    console = plain_console(stderr=json == "-")
    if json != "-":
        result_table(console, result)
    show_line(console, f"{result.serial}: {sentence(outcome_text(result))}")
    for note in result_notes(result):
        show_line(console, note)
    if result.cycle:
        show_line(console, _cycle_line(result.cycle_seconds))
    show_line(console, say("cli.log_file", file=run.log))
    if Path(run.result_file).exists():
        show_line(console, say("cli.result_file", file=run.result_file))
    if result.advice == "resume":
        show_line(console, _resume_hint([run], request))


def _resume_hint(runs: Sequence[Finalized], request: RunRequest) -> str:
    logs = (option for run in runs for option in ("--resume", run.log))
    command = shlex.join(["calstation", "run", *logs])
    options = station_options(request.station, request.product)
    return say("cli.to_resume", command=f"{command} {options}".rstrip())


def _show_batch(runs: Sequence[Finalized], json: str | None, request: RunRequest) -> None:
    """Show one line per unit of a batch."""
    results = [Result.from_json(run.result) for run in runs]
    console = plain_console(stderr=json == "-")
    table = Table(title=results[0].batch, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1))
    for code in ("cli.column_slot", "cli.column_serial", "cli.column_verdict", "cli.column_why", "cli.column_result"):
        table.add_column(say(code), overflow="fold")
    for run, result in zip(runs, results, strict=True):
        partial_failure = result.partial and run.verdict is Verdict.FAILED
        verdict = say("cli.outcome_partial_failed" if partial_failure else f"cli.outcome_{run.verdict}")
        file = Path(run.result_file)
        table.add_row(run.slot, result.serial, verdict, _failure_reason(result), file.name if file.exists() else "")
    console.print(table)
    longest = max((result.cycle_seconds for result in results), key=lambda cycle: sum(cycle.values()))
    if longest:
        show_line(console, _cycle_line(longest))
    resumable = [run for run, result in zip(runs, results, strict=True) if result.advice == "resume"]
    if resumable:
        show_line(console, _resume_hint(resumable, request))
    for folder in {str(Path(run.result_file).parent) for run in runs}:
        show_line(console, say("cli.run_folder", folder=folder))


def _failure_reason(result: Result) -> str:
    """Return the reason why a unit of a batch did not pass, and a note about unverified registers."""
    failed = [check.name for check in result.checks if check.passed is False]
    parts = [result.error or ", ".join(failed[:_MAX_NAMED]) + (" ..." if len(failed) > _MAX_NAMED else "")]
    if result.verdict is Verdict.STOPPED:
        parts = [term("reason", result.stop_reason or "operator")]
    if result.registers is not None and result.registers.new is not None and not result.verified:
        parts.append(say("cli.not_verified"))
    if result.verdict.passed and result.unjudged:
        parts.append(say("advice.not_judged", names=result.unjudged))
    parts += result_notes(result)
    return "; ".join(filter(None, parts))


def _cycle_line(seconds: Mapping[str, float]) -> str:
    """Return the duration of the cycle and of its phases: the stages first, then the other phases by duration."""
    phases = sorted(seconds, key=lambda name: (name != "stage", -seconds[name]))
    parts = [f"{term('cycle', name).lower()} {seconds[name]:.1f} s" for name in phases]
    return say("cli.cycle", seconds=sum(seconds.values()), phases=parts)


def outcome_text(result: Result) -> Text:
    """Return the final sentence of a run: its verdict, and the state of the registers."""
    standard, registers, verdict = result.check_standard, result.registers, result.verdict
    written = registers is not None and registers.new is not None
    if standard is not None and verdict.judged and verdict.passed == standard.passed:
        worst = max(standard.e_n, key=lambda name: abs(standard.e_n[name]), default="")
        return Text.of(
            "outcome.standard_agrees" if standard.passed else "outcome.standard_differs",
            parameter=worst,
            e_n=abs(standard.e_n.get(worst, 0.0)),
            e_n_limit=standard.e_n_limit,
            t_squared=standard.t_squared,
            t_squared_limit=standard.t_squared_limit,
        )
    if verdict is Verdict.FAILED and result.partial:
        left = len(result.not_compared)
        return Text.of("outcome.partial_failed", stages=result.stages, left=left, failure=result.failure)
    if verdict is Verdict.PARTIAL:
        code = "outcome.partial" if written else "outcome.partial_not_written"
        return Text.of(code, stages=result.stages, left=len(result.not_compared))
    unjudged = result.unjudged
    within = Text.of("outcome.within_judged", names=unjudged) if unjudged else Text("outcome.within_every")
    if verdict.passed and not written:
        return Text.of("outcome.not_written", within=within)
    if verdict.passed and registers is not None and registers.proved_on == "read_back":
        return Text.of("outcome.read_back", within=within)
    if verdict is Verdict.STOPPED:
        if result.stop_reason in (None, "", "operator"):
            return Text("outcome.stopped_by_operator")
        return Text.of("outcome.stopped_because", reason=result.stop_reason)
    return Text.of(f"outcome.{verdict}", failure=result.failure, within=within)


class _Display:
    """Shows a bar per stage with the remaining time and the current step, or plain lines without a terminal."""

    def __init__(self, console: Console, options: Mapping[str, str]) -> None:
        self._console = console
        self._options = options  #: Options of commands in remedies.
        self._bars: dict[str, TaskID] = {}
        self.progress = Progress(
            TextColumn("{task.fields[number]:>4}  {task.description:<14}", markup=False),
            BarColumn(30),
            TaskProgressColumn(),
            TextColumn("{task.fields[left]:<12}"),
            TextColumn("{task.fields[now]}", markup=False),
            console=console,
            disable=not console.is_terminal,
        )

    def show(self, event: Event) -> None:
        """Show one event."""
        if isinstance(event, StageStarted):
            number = f"{event.index + 1}/{event.count}"
            self._bars[event.stage] = self.progress.add_task(
                event.stage, total=1.0, number=number, left=_remaining_text(event.duration), now=""
            )
            self._line(say("cli.stage_begins", number=number, stage=event.stage, time=_minutes(event.duration)))
            if event.repeated and sys.stdin.isatty():
                show_line(self._console, say("cli.end_stage", stage=event.stage, key=_END_STAGE))
        elif isinstance(event, StageProgress):
            self._update(event.stage, completed=event.fraction, left=_remaining_text(event.remaining))
        elif isinstance(event, StepStarted):
            self._update(event.stage, now=sentence(step_text(event.kind, event.label)))
        elif isinstance(event, PositionGuided):
            self._update(event.stage, now=_guidance(event))
        elif isinstance(event, StageSolved):
            consistency = say(_CONSISTENCY[event.consistency["passed"]])
            summary = say("cli.stage_solved", count=len(event.parameters), consistency=consistency)
            self._update(event.stage, completed=1.0, left=say("cli.done"), now=summary)
            self._line(_with_slot(event, f"{event.stage}: {summary}"))
        elif isinstance(event, Message):
            text = sentence(event_text(event.id, event.values))
            self._console.print(_with_slot(event, text))
        elif isinstance(event, Fault) and event.slot and event.code:
            values = {**event.values, **self._options, "slot_option": f" --slot {event.slot}"}
            show_line(self._console, _with_slot(event, sentence(Text(event.code, values))))
        elif isinstance(event, StateChanged) and event.state in ("pausing", "paused", "stopping"):
            self._console.print(f"{say(f'state.{event.state}')}.")

    def _update(self, stage: str, **fields: Any) -> None:
        if stage in self._bars:
            self.progress.update(self._bars[stage], **fields)

    def _line(self, text: str) -> None:
        if not self._console.is_terminal:
            self._console.print(text)


def _with_slot(event: Event, text: str) -> str:
    """Return a text with the slot of the unit concerned, if any."""
    return say("cli.of_slot", slot=event.slot, text=text) if event.slot else text


def _guidance(event: PositionGuided) -> str:
    """Return the operator's next task and the state of the current position."""
    task = say("step.carry", outer=degrees(event.outer), inner=degrees(event.inner))
    state = say(f"guided.{event.state}", rest=event.rest, wanted=event.wanted)
    return f"{event.index}/{event.count} {task}: {state}"


def _remaining_text(seconds: float) -> str:
    return say("cli.time_left", time=_minutes(seconds))


def _minutes(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d}"
