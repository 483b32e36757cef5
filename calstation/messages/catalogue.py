"""Reader of the catalogue: one TOML file per family and one table per code, and one file per calibration method.

The code ``modbus.no_answer`` is the table ``[no_answer]`` in ``catalogue/modbus.toml``. The texts of a method are in
``catalogue/methods/NAME.toml``, by family: ``step.flip`` is the table ``[step.flip]`` there.
"""

import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any, Literal

Severity = Literal["info", "warning", "error"]


@dataclass(frozen=True)
class Entry:
    """One message of the catalogue."""

    code: str  #: Family and name, such as ``modbus.no_answer``.
    text: str  #: Sentence about the event, with the names of values in braces.
    remedy: str = ""  #: Sentence with an instruction; may be empty.
    window: str = ""  #: Remedy in the window if it differs from the command line's; otherwise empty.
    zh: str = ""  #: Text in Chinese.
    zh_remedy: str = ""  #: Remedy in Chinese, as shown in the window.
    severity: Severity = "error"
    #: Location of the cause: a name of the family ``source``, such as ``table``, or a value in braces that contains
    #: one; empty if no location is shown.
    source: str = ""
    resettable: bool = False  #: Whether an operator may reset the fault on the device.
    engineer: bool = False  #: Whether the remedy is for engineers, since it names entries of a profile or of a file.
    operator: Sequence[str] = ()  #: Text for operators in English and in Chinese, without ports and files.
    values: Sequence[str] = ()  #: Names of the values that follow the name of a step in its label.


_CATALOGUE = resources.files("calstation.messages").joinpath("catalogue")


@cache
def _methods() -> tuple[dict[str, Any], ...]:
    """Return the texts of every method, by family."""
    files = sorted(_CATALOGUE.joinpath("methods").iterdir(), key=lambda file: file.name)
    return tuple(tomllib.loads(file.read_text(encoding="utf-8")) for file in files if file.name.endswith(".toml"))


def families() -> tuple[str, ...]:
    """Return the names of all families, sorted."""
    files = _CATALOGUE.iterdir()
    return tuple(sorted(file.name.removesuffix(".toml") for file in files if file.name.endswith(".toml")))


@cache
def family(name: str) -> dict[str, Entry]:
    """Return all entries of a family by code; empty for an unknown family. Raises TypeError for an unknown key.

    A table ``[defaults]`` at the top of the file sets the default `severity` and `source` of its entries. A term may be
    written on one line: ``rate = ["Rate", "速率"]``.
    """
    file = _CATALOGUE.joinpath(f"{name}.toml")
    if not name.isidentifier() or not file.is_file():
        return {}
    tables = tomllib.loads(file.read_text(encoding="utf-8"))
    defaults = tables.pop("defaults", {})
    entries = {}
    for key, value in (item for texts in (tables, *(m.get(name, {}) for m in _methods())) for item in texts.items()):
        code = f"{name}.{key}"
        fields = {"text": value[0], "zh": value[1]} if isinstance(value, list) else value
        entries[code] = Entry(code=code, **{**defaults, **fields})
    return entries


def known(code: str) -> bool:
    """Return whether the catalogue contains a code."""
    return re.fullmatch(r"[a-z_]+\.\w+", code) is not None and code in family(code.partition(".")[0])


def entry(code: str) -> Entry:
    """Return the entry of a code. Raises KeyError for an unknown code."""
    return family(code.partition(".")[0])[code]
