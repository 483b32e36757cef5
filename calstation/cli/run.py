"""`run`: shows a run's events as progress bars and messages, and turns Ctrl-C into a safe stop."""

import shlex
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType, TracebackType

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TaskProgressColumn, TextColumn

from calstation.cli.show import check_json, emit_json, result_table
from calstation.cli.usage import as_typed, options, said_as_typed
from calstation.cli.wording import OUTCOMES, READ_BACK, REASONS, STATES, word, word_guided, word_step
from calstation.config.request import RunRequest, computer_user
from calstation.config.resolved import prepare_run
from calstation.config.station import load_station
from calstation.errors import ConfigurationError, StoppedError
from calstation.runs.engine import INTERNAL, Engine
from calstation.runs.resume import filled, serial_of
from calstation.sequencer.control import Command
from calstation.sequencer.events import (
    Event,
    Fault,
    Message,
    PositionGuided,
    StageProgress,
    StageSolved,
    StageStarted,
    StateChanged,
    StepStarted,
    Verdict,
)
from calstation.simulation.hooks import BenchHooks

#: What the virtual bench's unit answers to where no serial number was given.
DEFAULT_SERIAL = "SN-000001"

_EXIT_CODES = {"passed": 0, "failed": 1, "stopped": StoppedError.exit_code}


def run_command(request: RunRequest, json: str | None, *, yes: bool, debug: bool) -> int:
    """Run a calibration; returns the contract's exit code. Raises ConfigurationError for a wrong request."""
    check_json(json)
    setup = prepare_run(filled(request), BenchHooks().adjust)
    _, station = load_station(request.station)
    if station.bench is None and not setup.by_hand and not yes:
        question = f"The table of '{station.name}' is going to move. Is everybody clear of it?"
        if not typer.confirm(question, err=True):
            raise StoppedError("not confirmed; nothing has moved")
    console = Console(stderr=True)
    verdict: Verdict | None = None
    fault: Fault | None = None
    with (
        said_as_typed(request),
        Engine.start(request, BenchHooks) as engine,
        interrupt_stops(engine),
        Display(console) as display,
    ):
        for event in engine.events():
            display.show(event)
            if isinstance(event, Verdict):
                verdict = event
            elif isinstance(event, Fault):
                fault = event
    if verdict is not None:
        _show_verdict(verdict, json, request)
    if fault is not None:
        return complain(fault, request, debug=debug)
    return _EXIT_CODES[verdict.outcome] if verdict is not None else 3


def run_request(
    stages: tuple[str, ...] | None,
    station: Path | None,
    product: Path | None,
    serial: str | None,
    speed: float | None,
    seed: int | None,
    out: Path,
    resume: Path | None = None,
) -> RunRequest:
    """The request of a command line. Raises ConfigurationError where the serial number is missing."""
    path, config = load_station(station)
    if resume is not None:
        if stages is not None or seed is not None:
            raise ConfigurationError(
                "--resume carries its run's own stages and seed on; leave the option out"
            )
        serial = serial or serial_of(resume)
    if serial is None:
        if config.bench is None:
            raise ConfigurationError(
                f"--serial is missing; {path} is hardware, give the unit's serial number"
            )
        serial = str(config.bench.get("serial", DEFAULT_SERIAL))
    return RunRequest(serial, station, product, stages, out, computer_user(), speed, seed, resume=resume)


def complain(fault: Fault, request: RunRequest, *, debug: bool) -> int:
    """Tell what ended the engine's work, with its mend at the request's own station; returns the exit code."""
    text = as_typed(fault.text, request)
    if fault.kind == INTERNAL and not debug:
        text = f"internal error: {text.strip().splitlines()[-1]} (--debug shows where)"
    sys.stderr.write(f"calstation: {text}\n")
    return fault.exit_code


@contextmanager
def interrupt_stops(engine: Engine) -> Iterator[None]:
    """Ctrl-C, however often, asks the engine for a safe stop; the listener goes on listening."""

    def stop(number: int, frame: FrameType | None) -> None:
        engine.send(Command.STOP)

    before = signal.signal(signal.SIGINT, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _show_verdict(verdict: Verdict, json: str | None, request: RunRequest) -> None:
    emit_json(verdict.result, json)
    console = Console(stderr=json == "-")
    if json != "-":
        result_table(console, verdict.result)
    blind = (verdict.result.get("registers") or {}).get("proved_on") == "read_back"
    said = READ_BACK if blind and verdict.outcome == "passed" else OUTCOMES[verdict.outcome]
    if verdict.outcome == "stopped":
        by = verdict.result.get("stop_reason") or "operator"
        said = f"{said} by the operator" if by == "operator" else f"{said}: {REASONS.get(by, by)}"
    console.print(f"{verdict.result['unit']['serial']}: {said}", highlight=False, soft_wrap=True)
    lines = [("log", verdict.log), ("result", verdict.result_file)]
    if verdict.result["advice"] == "resume":
        lines.append(("to carry on", _resuming(verdict.log, request)))
    for label, path in lines:
        console.print(f"{label}: {path}", highlight=False, markup=False, soft_wrap=True)


def _resuming(log: str, request: RunRequest) -> str:
    """The command that carries a run on, at the same station and with the same product."""
    command = shlex.join(["calstation", "run", "--resume", log])
    return f"{command} {options(request.station, request.product)}".rstrip()


class Display:
    """A bar per stage with time left and what happens; plain lines without a terminal."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._bars: dict[str, TaskID] = {}
        self._progress = Progress(
            TextColumn("{task.fields[place]:>4}  {task.description:<14}"),
            BarColumn(30),
            TaskProgressColumn(),
            TextColumn("{task.fields[left]:<12}"),
            TextColumn("{task.fields[now]}"),
            console=console,
            disable=not console.is_terminal,
        )

    def __enter__(self) -> "Display":
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.stop()

    def show(self, event: Event) -> None:
        """Show one event."""
        if isinstance(event, StageStarted):
            place = f"{event.index + 1}/{event.count}"
            self._bars[event.stage] = self._progress.add_task(
                event.stage, total=1.0, place=place, left=_left(event.duration), now=""
            )
            self._line(f"{place} {event.stage}: {_minutes(event.duration)} of device time")
        elif isinstance(event, StageProgress):
            self._update(event.stage, completed=event.fraction, left=_left(event.remaining))
        elif isinstance(event, StepStarted):
            self._update(event.stage, now=word_step(event.kind, event.label))
        elif isinstance(event, PositionGuided):
            self._update(event.stage, now=word_guided(event))
        elif isinstance(event, StageSolved):
            sound = "consistent" if event.consistency["passed"] else "NOT consistent"
            found = f"{len(event.parameters)} parameters, {sound}"
            self._update(event.stage, completed=1.0, left="done", now=found)
            self._line(f"{event.stage}: {found}")
        elif isinstance(event, Message):
            self._console.print(word(event.id, event.values), highlight=False, markup=False)
        elif isinstance(event, StateChanged) and event.state in ("pausing", "paused", "stopping"):
            self._console.print(STATES[event.state].capitalize() + ".", highlight=False)

    def _update(self, stage: str, **fields: object) -> None:
        if stage in self._bars:
            self._progress.update(self._bars[stage], **fields)  # type: ignore[arg-type]

    def _line(self, text: str) -> None:
        if not self._console.is_terminal:
            self._console.print(text, highlight=False, markup=False)


def _left(seconds: float) -> str:
    return f"{_minutes(seconds)} left"


def _minutes(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d}"
