"""`resolve`: solves a stored log again and shows the result."""

import sys
from pathlib import Path
from typing import Annotated, cast, get_args

import typer
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from calstation.cli.options import (
    JsonOption,
    ParametersOnlyOption,
    StagesOption,
    check_choice,
    command_group,
    parsed_stages,
)
from calstation.cli.show import emit_json, plain_console, residual_table, result_notes, result_table
from calstation.cli.text import say, sentence
from calstation.errors import ConfigurationError, InsufficientDataError
from calstation.messages import event_text
from calstation.physics import EffectName
from calstation.results import resolve as solve

app = command_group()


@app.command()
def resolve(
    log: Annotated[Path, typer.Argument(metavar="LOG")],
    first: Annotated[int | None, typer.Option("--from", metavar="SEQ")] = None,
    last: Annotated[int | None, typer.Option("--to", metavar="SEQ")] = None,
    stages: StagesOption = None,
    json: JsonOption = None,
    residuals: Annotated[bool, typer.Option("--residuals")] = False,
    states: Annotated[list[str] | None, typer.Option("--state", metavar="NAME")] = None,
    parameters_only: ParametersOnlyOption = False,
) -> int:
    """Solve a log, or some of its stages between two sequence numbers, again, and show the result.

    Returns 1 if the result is outside the limits. If a stage lacks data, raises InsufficientDataError after showing
    the result.
    """
    chosen = parsed_stages(stages)
    if residuals and parameters_only:
        raise ConfigurationError("cli.residuals_without_tests")
    for state in states or ():
        check_choice("--state", state, get_args(EffectName))
    added = cast(tuple[EffectName, ...], tuple(states or ()))
    console = plain_console(stderr=True)
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(say("cli.reading_log", file=log.name))

        def show(stage: str, seq: int, done: float) -> None:
            share = f", {done:.0%}" if done else ""
            bar.update(task, description=say("cli.solving_stage", stage=stage, seq=seq) + share)

        solved = solve(
            log, chosen, first, last, show, residuals=residuals, states=added, diagnostics=not parameters_only
        )
    texts = (sentence(event_text(event_id, values)) for event_id, values in solved.messages)
    for text in dict.fromkeys(texts):  # a stage may repeat the message of another
        console.print(text)
    by_stage = {stage: [row.to_json() for row in rows] for stage, rows in solved.residuals.items()}
    emit_json({**solved.result.to_json(), **({"residuals": by_stage} if residuals else {})}, json)
    passed = solved.result.passed
    if json != "-":
        out = plain_console(file=sys.stdout)
        for stage, rows in solved.residuals.items():
            residual_table(stage, rows)
        result_table(out, solved.result)
        reason = "parameters" if parameters_only else "without_limits"
        without_verdict = "in_part" if solved.missing_data else reason
        unjudged = solved.result.unjudged
        within_limits = "partial" if solved.result.partial else "judged" if unjudged else "passed"
        ending = without_verdict if passed is None else within_limits if passed else "failed"
        values = {"stages": solved.result.stages, "failure": solved.result.failure, "names": unjudged}
        out.print(say(f"cli.resolved_{ending}", **values))
        for note in result_notes(solved.result):
            out.print(note)
    if solved.missing_data:
        raise InsufficientDataError(
            "cli.stages_lacking",
            log=log,
            lacking="; ".join(map(sentence, solved.missing_data)),
            stages=",".join(solved.result.stages),
        )
    return 1 if passed is False else 0
