"""The documentation names only options that the commands have."""

import re
from pathlib import Path

from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from calstation.cli.app import app

DOCS = Path(__file__).parents[2] / "docs"
PAGES = [DOCS / "tutorial.md", DOCS / "contract.md", *DOCS.glob("how-to/*.md"), *DOCS.glob("reference/*.md")]
#: A command line in a page, or the first cell of a row of the reference.
COMMAND = re.compile(r"^ +calstation ([a-z]+)|`calstation ([a-z]+)")


def options_of(command: TyperCommand | TyperGroup) -> set[str]:
    """Return the options of a command and of its subcommands."""
    found = {option for parameter in command.params for option in parameter.opts}
    below = command.commands.values() if isinstance(command, TyperGroup) else ()
    return found.union({"--help"}, *(options_of(each) for each in below))


def test_documented_options_exist() -> None:
    program = get_command(app)
    known = {name: options_of(each) for name, each in program.commands.items()}
    wrong, checked = [], 0
    for page in PAGES:
        for line in page.read_text(encoding="utf-8").splitlines():
            names = {"".join(found) for found in COMMAND.findall(line)} & known.keys()
            if not names or not line.startswith((" ", "| `calstation ")):
                continue
            options = set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", line.split("| psql")[0]))
            unknown = options.difference(*(known[name] for name in names), program.params[0].opts)
            wrong += [f"{page.name}: calstation {' '.join(sorted(names))}: {option}" for option in sorted(unknown)]
            checked += 1
    assert not wrong, "\n".join(wrong)
    assert checked > 80
