"""The commands and their help: every text is used, and the documentation names only options that exist."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from typer.main import get_command

from calstation.cli.app import app, load_command
from calstation.messages import catalogue

DOCS = Path(__file__).parents[2] / "docs"
PAGES = [DOCS / "tutorial.md", DOCS / "contract.md", *DOCS.glob("how-to/*.md"), *DOCS.glob("reference/*.md")]
#: A command line in a page, or the first cell of a row of the reference.
COMMAND = re.compile(r"^ +calstation ([a-z]+)|`calstation ([a-z]+)")

PROGRAM: Any = get_command(app)
COMMANDS = {name: load_command(name) for name in PROGRAM.commands}


def below(command: Any, *path: str) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield a command and the commands of its group, with the names that select them."""
    yield path, command
    for name, member in getattr(command, "commands", {}).items():
        yield from below(member, *path, name)


def every_command() -> list[tuple[tuple[str, ...], Any]]:
    return [each for name, command in COMMANDS.items() for each in below(command, name)]


def options_of(command: Any) -> set[str]:
    """Return the options of a command and of its subcommands."""
    return {"--help"}.union(*(parameter.opts for _, each in below(command) for parameter in each.params))


def test_every_command_and_option_has_help_and_every_help_is_shown() -> None:
    shown = {PROGRAM.help, PROGRAM.epilog, *(parameter.help for parameter in PROGRAM.params)}
    for _, command in every_command():
        shown |= {command.help, *(parameter.help for parameter in command.params)}
    entries = [entry for family in ("command", "option") for entry in catalogue.family(family).values()]
    assert all(shown)
    assert not [entry.code for entry in entries if entry.text not in shown]


def test_documented_options_exist() -> None:
    known = {name: options_of(each) for name, each in COMMANDS.items()}
    wrong, checked, names = [], 0, set[str]()
    for page in PAGES:
        for line in page.read_text(encoding="utf-8").splitlines():
            if not line.startswith("    ") or not line.lstrip().startswith("[--"):  # the options of the line before
                names = {"".join(found) for found in COMMAND.findall(line)} & known.keys()
            if not names or not line.startswith((" ", "| `calstation ")):
                continue
            options = set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", line.split("| psql")[0]))
            unknown = options.difference(*(known[name] for name in names), PROGRAM.params[0].opts)
            wrong += [f"{page.name}: calstation {' '.join(sorted(names))}: {option}" for option in sorted(unknown)]
            checked += 1
    assert not wrong, "\n".join(wrong)
    assert checked > 90
