"""Every message that the program can produce is in the catalogue, in both languages, with all its values."""

import ast
import re
import string
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import get_args

import pytest

from calstation.messages import catalogue, entry, known
from calstation.messages.catalogue import Entry
from calstation.messages.rendering import COMMAND_OPTIONS

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[2]

#: Files that choose a code by a computation, all of whose results other tests show.
COMPUTED = {
    "calstation/api.py",
    "calstation/cli/errors.py",
    "calstation/config/site_check.py",
    "calstation/config/station.py",
    "calstation/connection/compatibility.py",
    "calstation/connection/link_test.py",
    "calstation/connection/table_test.py",
    "calstation/database/connect.py",
    "calstation/gui/engineer/schedule_form.py",
    "calstation/gui/operator/next_run.py",
    "calstation/gui/operator/questions.py",
    "calstation/gui/settings/fields.py",
    "calstation/records/csv_logs/csv_table.py",
    "calstation/sequencer/guard.py",
}

#: Files in which codes come from data, which other tests check: the machinery itself, and remarks of solutions.
CODE_FROM_ELSEWHERE = {
    "calstation/database/state.py",
    "calstation/sequencer/events.py",
    "calstation/errors.py",
    "calstation/schema.py",
    "calstation/gui/text/messages.py",
    "calstation/messages/rendering.py",
}

#: Faults that show an exception to those who maintain the program, and the words of a template's compiler.
_INTERNAL = {
    "program.internal",
    "imu.reader_failed",
    "connection.bench_not_started",
    "connection.bench_refused",
    "fleet.solving_failed",
    "label.typst",
    "report.template",
}

#: Base classes of errors, and the family that completes the short id of other messages.
_ERRORS = {"CalstationError", "EntryError"}
_SHORT = {"Message": "event", "Finding": "finding"}


#: Folders of the window and the command line.
INTERFACES = ("calstation/gui/", "calstation/cli/")

#: Functions and classes of the window that take a code without values, and the index of this argument.
TAKES_CODE = {"label": 0, "bind": 1, "button": 1, "Choice": 1, "Column": 0, "JobRow": 2}


@dataclass(frozen=True)
class Site:
    """A call that creates a message; `codes` is empty if the code is not a literal."""

    where: str
    kind: str
    codes: tuple[str, ...]
    names: frozenset[str] | None

    @property
    def package(self) -> str:
        """``calstation/sequencer``, or ``procedures``."""
        path = self.where.split(":")[0]
        parts = path.split("/")
        return "/".join(parts[:2]) if parts[0] == "calstation" else parts[0]


def trees() -> Iterator[tuple[str, ast.Module]]:
    """Return all modules of the product with their path below the root."""
    for folder in ("calstation", "procedures"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            yield path.relative_to(ROOT).as_posix(), ast.parse(path.read_text(encoding="utf-8"))


def error_classes(modules: list[tuple[str, ast.Module]]) -> set[str]:
    """Return the names of all subclasses of the catalogue errors."""
    bases = {
        node.name: {base.id for base in node.bases if isinstance(base, ast.Name)}
        for _, tree in modules
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
    }
    found = set(_ERRORS)
    while True:
        more = {name for name, above in bases.items() if above & found} - found
        if not more:
            return found
        found |= more


def literals(node: ast.expr, function: ast.AST | None = None) -> tuple[str, ...]:
    """Return the possible strings of an expression, () if it is not a literal.

    An f-string stands for all codes with its beginning, a name for all that `function` assigns to it.
    """
    if isinstance(node, ast.JoinedStr) and isinstance(node.values[0], ast.Constant):
        prefix = str(node.values[0].value)
        return tuple(e.code for e in all_entries() if e.code.startswith(prefix)) if "." in prefix else ()
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return (node.value,)
    if isinstance(node, ast.IfExp):
        both = literals(node.body, function), literals(node.orelse, function)
        return both[0] + both[1] if all(both) else ()
    if isinstance(node, ast.Name) and function is not None:
        assigned = [
            literals(found.value)
            for found in ast.walk(function)
            if isinstance(found, ast.Assign) and any(getattr(t, "id", "") == node.id for t in found.targets)
        ]
        return sum(assigned, ()) if assigned and all(assigned) else ()
    return ()


def keywords(call: ast.Call) -> frozenset[str] | None:
    """Return the names of keyword values, None if some are passed with ``**``."""
    names = [keyword.arg for keyword in call.keywords]
    return None if None in names else frozenset(name for name in names if name is not None)


def keys(node: ast.expr | None) -> frozenset[str] | None:
    """Return the keys of a literal dictionary, None for any other expression."""
    if node is None:
        return frozenset()
    if not isinstance(node, ast.Dict) or None in node.keys:
        return None
    return frozenset(str(key.value) for key in node.keys if isinstance(key, ast.Constant))


def calls(tree: ast.AST, function: ast.AST | None = None) -> Iterator[tuple[ast.Call, ast.AST | None]]:
    """Yield every call in a module with its innermost enclosing function."""
    waiting = [(tree, function)]
    while waiting:
        above, function = waiting.pop()
        for node in ast.iter_child_nodes(above):
            if isinstance(node, ast.Call):
                yield node, function
            waiting.append((node, node if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) else function))


@cache
def sites() -> tuple[Site, ...]:
    """Return every call that creates an error or a message.

    A function that forwards a parameter as the code is not included; its calls are.
    """
    everything = list(trees())
    errors = error_classes(everything)
    modules = [(path, tree) for path, tree in everything if path not in CODE_FROM_ELSEWHERE]
    found: list[Site] = []
    passed: dict[tuple[str, str], int] = {}
    made = [(path, call, function) for path, tree in modules for call, function in calls(tree)]
    for path, call, function in made:
        site = _site(f"{path}:{call.lineno}", call, errors, function)
        if site is None:
            continue
        position = _parameter(call.args[0], function) if not site.codes else None
        if position is None:
            found.append(site)
        elif isinstance(function, ast.FunctionDef):
            passed[path if function.name.startswith("_") else "", function.name] = position
    for path, call, function in made:
        everywhere = passed.get(("", call_name(call))) if isinstance(call.func, ast.Name) else None
        position = passed.get((path, call_name(call)), everywhere)
        if position is not None and position < len(call.args):
            codes = literals(call.args[position], function)
            if codes or _parameter(call.args[position], function) is None:
                found.append(Site(f"{path}:{call.lineno}", call_name(call), codes, None))
    return tuple(found)


def _parameter(node: ast.expr, function: ast.AST | None) -> int | None:
    """Return the index, without ``self``, of the parameter that an expression names, or None."""
    if not isinstance(node, ast.Name) or not isinstance(function, ast.FunctionDef):
        return None
    names = [argument.arg for argument in function.args.args if argument.arg not in ("self", "cls")]
    return names.index(node.id) if node.id in names else None


def call_name(call: ast.Call) -> str:
    """Return the name of the function that is called."""
    function = call.func
    return function.id if isinstance(function, ast.Name) else getattr(function, "attr", "")


def _site(where: str, call: ast.Call, errors: set[str], function: ast.AST | None) -> Site | None:
    name = call_name(call)
    if where.startswith(INTERFACES) and (name in TAKES_CODE or name == "say"):
        code = call.args[index] if (index := TAKES_CODE.get(name, 0)) < len(call.args) else None
        codes = literals(code, function) if code is not None else ()
        return Site(where, name, codes, keywords(call) if name == "say" else frozenset()) if any(codes) else None
    if name not in {*errors, *_SHORT, "of", "Text"} or not call.args or isinstance(call.args[0], ast.Starred):
        return None
    if isinstance(call.args[0], ast.Attribute | ast.Subscript) and name in {*errors, "Text"}:
        return None  # the code of another error
    codes = literals(call.args[0], function)
    second = call.args[1] if len(call.args) > 1 else None
    if name in errors:
        return Site(where, name, codes, keywords(call))
    if name in _SHORT:
        values = next((k.value for k in call.keywords if k.arg == "values"), call.args[-1])
        names = keys(values if len(call.args) > 1 or call.keywords else None)
        return Site(where, name, tuple(f"{_SHORT[name]}.{code}" for code in codes), names)
    if name == "of" and getattr(getattr(call.func, "value", None), "id", "") == "Text":
        return Site(where, "Text", codes, keywords(call))
    if name == "Text" and isinstance(call.func, ast.Name):
        return Site(where, "Text", codes, keys(second))
    return None


def placeholders(text: str) -> set[str]:
    """Return the placeholder names of a text."""
    return {name.split(".")[0].split("[")[0] for _, name, _, _ in string.Formatter().parse(text) if name}


def all_placeholders(found: Entry) -> set[str]:
    """Return the placeholder names of all texts of an entry."""
    texts = (found.text, found.remedy, found.window, found.zh, found.zh_remedy, *found.operator)
    return set().union(*map(placeholders, texts)) - set(COMMAND_OPTIONS)


def all_entries() -> list[Entry]:
    """Return all entries of the catalogue."""
    return [found for name in catalogue.families() for found in catalogue.family(name).values()]


def test_every_message_code_is_in_the_catalogue() -> None:
    outside = [site for site in sites() if not site.codes or not all(map(known, site.codes))]
    assert not [f"{site.where} {site.kind}" for site in outside if site.where.partition(":")[0] not in COMPUTED]


def test_every_message_has_the_values_of_its_placeholders() -> None:
    missing = [
        f"{site.where} {code}: {sorted(all_placeholders(entry(code)) - site.names)}"
        for site in sites()
        for code in site.codes
        if site.names is not None
        and len(site.codes) <= 2
        and known(code)
        and not all_placeholders(entry(code)) <= site.names
    ]
    assert not missing


def test_every_entry_is_in_both_languages() -> None:
    assert not [e.code for e in all_entries() if not e.zh or bool(e.remedy) > bool(e.zh_remedy)]
    assert {len(e.operator) for e in all_entries()} == {0, 2}


def test_chinese_texts_contain_no_english_sentences_or_library_messages() -> None:
    names = re.compile(
        r"Modbus (TCP|RTU)|pip install|mcap recover|calstation [a-z]+( [a-z]+)*( --\w+ [\w.]+)*|--stages [a-z,]+"
    )
    for found in all_entries():
        for text in (found.zh, found.zh_remedy, *found.operator[1:]):
            plain = names.sub("", re.sub(r"\{[^{}]*\}", "", text))
            assert not re.search("[A-Za-z][a-z]+ [A-Za-z]+", plain), found.code
            fields = {name for _, name, _, _ in string.Formatter().parse(text) if name}
            assert "detail" not in fields or found.code in _INTERNAL, found.code


def test_severities_are_the_defined_ones() -> None:
    assert {e.severity for e in all_entries()} == set(get_args(catalogue.Severity))


def test_sources_and_families_referenced_by_entries_exist() -> None:
    families = set(catalogue.families())
    for found in all_entries():
        assert found.source in ("", "{device}") or known(f"source.{found.source}"), found.code
        for text in (found.text, found.remedy, found.zh, found.zh_remedy, *found.operator):
            for _, name, form, _ in string.Formatter().parse(text):
                assert not (name and form and form.startswith("@")) or form[1:] in families, found.code
