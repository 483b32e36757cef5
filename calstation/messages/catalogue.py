"""Reads the catalogue: one TOML file per family, one table per code (``table.no_answer`` is ``[no_answer]`` in
``catalogue/table.toml``)."""

import re
import tomllib
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Literal

Severity = Literal["info", "warning", "error"]


@dataclass(frozen=True)
class Entry:
    """One message."""

    code: str  #: Family and name, ``table.no_answer``.
    text: str  #: What happened, with the names of its values in braces.
    remedy: str = ""  #: What to do; may be empty.
    window: str = ""  #: What to do, where the window offers another way than the command line; empty where it does not.
    zh: str = ""  #: Text in Chinese.
    zh_remedy: str = ""  #: Remedy in Chinese, as the window shows it.
    severity: Severity = "error"
    #: Where the cause is: a code of the family ``source``, such as ``table``, or a value in braces that has one; empty
    #: if it needs no name.
    source: str = ""
    resettable: bool = False  #: Whether an operator may reset the fault on the device.


def families() -> tuple[str, ...]:
    """Names of all families, sorted."""
    files = resources.files("calstation.messages").joinpath("catalogue").iterdir()
    return tuple(sorted(file.name.removesuffix(".toml") for file in files if file.name.endswith(".toml")))


@cache
def family(name: str) -> dict[str, Entry]:
    """All entries of a family by their codes; empty for an unknown family. Raises TypeError for an unknown key.

    A table ``[defaults]`` at the top of the file gives `severity` and `source` for all of its entries. A term may be
    written in one line: ``rate = ["Rate", "速率"]``.
    """
    file = resources.files("calstation.messages").joinpath("catalogue", f"{name}.toml")
    if not name.isidentifier() or not file.is_file():
        return {}
    tables = tomllib.loads(file.read_text(encoding="utf-8"))
    defaults = tables.pop("defaults", {})
    entries = {}
    for key, value in tables.items():
        code = f"{name}.{key}"
        given = {"text": value[0], "zh": value[1]} if isinstance(value, list) else value
        entries[code] = Entry(code=code, **{**defaults, **given})
    return entries


def known(code: str) -> bool:
    """Whether the catalogue has this code."""
    return re.fullmatch(r"[a-z_]+\.\w+", code) is not None and code in family(code.partition(".")[0])


def entry(code: str) -> Entry:
    """The entry of a code. Raises KeyError for an unknown code."""
    return family(code.partition(".")[0])[code]
