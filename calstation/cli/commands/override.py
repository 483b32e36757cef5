"""`override`: permits the use of a failed unit."""

from pathlib import Path
from typing import Annotated

import typer

from calstation.cli.confirmation import ask_people
from calstation.cli.options import ByOption, ConfirmedByOption, JsonOption, command_group
from calstation.cli.show import emit, ignore_progress
from calstation.cli.text import say
from calstation.config import computer_user
from calstation.results import override_required, override_result

app = command_group()


@app.command()
def override(
    result: Annotated[Path, typer.Argument(metavar="RESULT.json")],
    reason: Annotated[str, typer.Option()],
    by: ByOption = None,
    confirmed_by: ConfirmedByOption = None,
    json: JsonOption = None,
) -> None:
    """Override a failed result after the responsible persons have entered their PINs."""
    override_required(ignore_progress, result)
    first, second = ask_people(by, confirmed_by, computer_user() or "", pin=True, reason=reason)
    overridden = override_result(ignore_progress, result, reason, first, second)
    people = [name for name in (overridden.by, overridden.confirmed_by) if name]
    emit(overridden.model_dump(), json, [say("cli.released", result=result, people=people)])
