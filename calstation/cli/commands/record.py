"""`record`: makes a recording on the virtual bench for the methods that need no table."""

from typing import Annotated, cast, get_args

import typer

from calstation.cli.options import LogOutOption, check_choice, command_group
from calstation.cli.show import plain_console, show_line
from calstation.cli.text import say
from calstation.errors import InputError
from calstation.records import SUFFIX, truth_path
from calstation.results import write_json
from calstation.simulation import GradeName, Kind, make_recording

app = command_group()


@app.command()
def record(
    kind: Annotated[str, typer.Argument(metavar="KIND")],
    out: LogOutOption,
    grade: str = "mems",
    seed: Annotated[int, typer.Option(min=0)] = 1,
) -> None:
    """Write a recording as the raw log `out`, and its true values as NAME.truth.json. Raises ConfigurationError."""
    check_choice("KIND", kind, get_args(Kind))
    check_choice("--grade", grade, get_args(GradeName))
    if out.suffix != SUFFIX:
        raise InputError("csv.import_name", file=out, suffix=SUFFIX)
    facts, truth = make_recording(cast(Kind, kind), out, cast(GradeName, grade), seed)
    truth_file = truth_path(out)
    write_json(truth_file, truth)
    show_line(plain_console(stderr=True), say("cli.recorded", file=out, samples=facts.samples, truth=truth_file))
