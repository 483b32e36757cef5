"""The values of the events of the audit trail as text."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from calstation.messages import Language, Text, known, render, term

#: Values that come first, in this order.
_FIRST = ("serial", "certificate", "validation", "verdict", "simulated")
#: Ends of the names of values that a brief text leaves out: digests, versions of all packages, heads of files.
_NOT_BRIEF = ("sha256", "identity", "reports", "trail")
#: Maximum number of parts of a value, such as versions, that are shown.
_MAX_PARTS = 6
#: Value with the changed entries of a file.
_CHANGED = "changed"
#: Families of the terms of the program among the values.
_FAMILIES: dict[str, Callable[[str, Language], str]] = {
    "kind": partial(term, "file_kind"),
    "pin": partial(term, "audit_pin"),
    "what": partial(term, "audit_registers"),
    "verdict": lambda name, language: term(
        "report_verdict" if known(f"report_verdict.{name}") else "badge", name, language
    ),
}


def trail_values(values: Mapping[str, Any], language: Language, *, brief: bool = False) -> list[str]:
    """Return the values of an event, and the entries of a file that changed, each with its name.

    If `brief`, digests and versions are left out, and of a value with parts, such as files, only the names are shown.
    """
    if brief:
        values = {name: value for name, value in values.items() if not name.endswith(_NOT_BRIEF)}
    ordered = {name: values[name] for name in (*_FIRST, *values) if name in values}
    lines = [
        f"{term('audit_value', name, language)} {_value_text(name, value, language, brief=brief)}".rstrip()
        for name, value in ordered.items()
        if name != _CHANGED and value not in (None, "", [])
    ]
    changed = values.get(_CHANGED)
    if isinstance(changed, dict):
        lines += [
            f"{_entry_name(key, language)}: {_changed_text(before, language)} → {_changed_text(after, language)}"
            for key, (before, after) in changed.items()
        ]
    return lines


def _part_text(name: str, part: Any, language: Language) -> str:
    """Return a part of a value with its name, which is a term of the program or for example the name of a file."""
    title = term("audit_value", name, language) if known(f"audit_value.{name}") else name
    return f"{title} {part}".rstrip()


def _entry_name(key: str, language: Language) -> str:
    """Return the name of an entry of a file on the Station page with its key, or only the key."""
    parts = key.split(".")
    # the last part of an entry of a list, such as the product of a slot, has another name elsewhere
    names = ("_".join(parts), *([] if any(part.isdigit() for part in parts) else parts[-1:]))
    name = next((each for each in names if known(f"setting.{each}")), None)
    if name is None:
        return key
    return render("history.audit_entry", {"name": Text(f"setting.{name}"), "key": key}, language).text


def _changed_text(value: Any, language: Language) -> str:
    """Return a value of a file; a missing one is shown as a dash."""
    if isinstance(value, list):
        return _comma(language).join(_changed_text(each, language) for each in value)
    return "–" if value is None else str(value)


def _value_text(name: str, value: Any, language: Language, *, brief: bool) -> str:
    """Return a value of an event, in the language if it is a term of the program; "" for True."""
    if value is True:
        return ""
    if isinstance(value, dict):
        parts = [_part_text(key, "" if brief else part, language) for key, part in list(value.items())[:_MAX_PARTS]]
        return _comma(language).join(parts) + ("…" if len(value) > _MAX_PARTS else "")
    if isinstance(value, list):
        return _comma(language).join(map(str, value))
    return _FAMILIES[name](str(value), language) if name in _FAMILIES else str(value)


def _comma(language: Language) -> str:
    return render("common.comma", {}, language).text
