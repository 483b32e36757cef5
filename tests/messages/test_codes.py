"""Every message that the program can produce is in the catalogue, in both languages, with all its values."""

import ast
import string
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from calstation.messages import catalogue
from calstation.messages.catalogue import Entry, entry, known
from calstation.messages.rendering import COMMAND_OPTIONS

ROOT = Path(__file__).parents[2]

#: Packages whose messages all come from the catalogue; the others are counted and reported.
DONE: tuple[str, ...] = (
    "calstation/devices",
    "calstation/estimation",
    "calstation/physics",
    "procedures",
)

#: Files in which a code is not written at the place where the message is made: it comes from a table or an argument
#: that a test of that module checks.
CODE_FROM_ELSEWHERE = {
    "calstation/errors.py",
    "calstation/schema.py",
    "calstation/messages/rendering.py",
    "calstation/messages/progress.py",
}

#: Base classes of errors, and the family that completes the short id of other messages.
_ERRORS = {"CalstationError", "EntryError"}
_SHORT = {"Message": "event", "Finding": "finding"}


@dataclass(frozen=True)
class Site:
    """A place at which a message is made; `codes` is empty where the code is not written there."""

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
    """All modules of the product with their path below the root."""
    for folder in ("calstation", "procedures"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            yield path.relative_to(ROOT).as_posix(), ast.parse(path.read_text(encoding="utf-8"))


def error_classes(modules: list[tuple[str, ast.Module]]) -> set[str]:
    """Names of all classes that descend from an error of the catalogue."""
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


def literals(node: ast.expr) -> tuple[str, ...]:
    """The strings that an expression may be, () where it is not written out."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return (node.value,)
    if isinstance(node, ast.IfExp):
        both = literals(node.body), literals(node.orelse)
        return both[0] + both[1] if all(both) else ()
    return ()


def keywords(call: ast.Call) -> frozenset[str] | None:
    """Names of the keyword values, None where some are passed on with ``**``."""
    names = [keyword.arg for keyword in call.keywords]
    return None if None in names else frozenset(name for name in names if name is not None)


def keys(node: ast.expr | None) -> frozenset[str] | None:
    """Keys of a dictionary that is written out, None of any other."""
    if node is None:
        return frozenset()
    if not isinstance(node, ast.Dict) or None in node.keys:
        return None
    return frozenset(str(key.value) for key in node.keys if isinstance(key, ast.Constant))


@cache
def sites() -> tuple[Site, ...]:
    """Every place at which an error or a message is made."""
    modules = list(trees())
    errors = error_classes(modules)
    found = []
    for path, tree in modules:
        if path in CODE_FROM_ELSEWHERE:
            continue
        for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
            site = _site(f"{path}:{call.lineno}", call, errors)
            if site is not None:
                found.append(site)
    return tuple(found)


def _site(where: str, call: ast.Call, errors: set[str]) -> Site | None:
    function = call.func
    name = function.id if isinstance(function, ast.Name) else getattr(function, "attr", "")
    if not call.args:
        return None
    codes = literals(call.args[0])
    second = call.args[1] if len(call.args) > 1 else None
    if name in errors:
        return Site(where, name, codes, keywords(call))
    if name in _SHORT:
        values = next((k.value for k in call.keywords if k.arg == "values"), call.args[-1])
        names = keys(values if len(call.args) > 1 or call.keywords else None)
        return Site(where, name, tuple(f"{_SHORT[name]}.{code}" for code in codes), names)
    if name == "of" and isinstance(function, ast.Attribute) and getattr(function.value, "id", "") == "Text":
        return Site(where, "Text", codes, keywords(call))
    if name == "Text" and isinstance(function, ast.Name):
        return Site(where, "Text", codes, keys(second))
    return None


def placeholders(text: str) -> set[str]:
    """Names of the values in a text's braces."""
    return {name.split(".")[0].split("[")[0] for _, name, _, _ in string.Formatter().parse(text) if name}


def all_placeholders(found: Entry) -> set[str]:
    """Names of the values of all texts of an entry."""
    texts = (found.text, found.remedy, found.window, found.zh, found.zh_remedy)
    return set().union(*map(placeholders, texts)) - set(COMMAND_OPTIONS)


def all_entries() -> list[Entry]:
    """The whole catalogue."""
    return [found for name in catalogue.families() for found in catalogue.family(name).values()]


def test_typed_packages_make_no_message_outside_the_catalogue() -> None:
    untyped = [site for site in sites() if not site.codes or not all(map(known, site.codes))]
    left = Counter(site.package for site in untyped)
    print(
        "\nMessages outside the catalogue:", *(f"\n  {count:4} {name}" for name, count in left.most_common())
    )
    assert not [f"{site.where} {site.kind}" for site in untyped if site.package in DONE]


def test_every_message_gets_the_values_that_its_texts_name() -> None:
    missing = [
        f"{site.where} {code}: {sorted(all_placeholders(entry(code)) - site.names)}"
        for site in sites()
        for code in site.codes
        if site.names is not None and known(code) and not all_placeholders(entry(code)) <= site.names
    ]
    assert not missing


def test_every_entry_is_in_both_languages() -> None:
    assert not [e.code for e in all_entries() if not e.zh or bool(e.remedy) > bool(e.zh_remedy)]


def test_every_source_and_family_that_an_entry_names_exists() -> None:
    families = set(catalogue.families())
    for found in all_entries():
        assert found.source in ("", "{device}") or known(f"source.{found.source}"), found.code
        for text in (found.text, found.remedy, found.zh, found.zh_remedy):
            for _, name, form, _ in string.Formatter().parse(text):
                assert not (name and form and form.startswith("@")) or form[1:] in families, found.code
