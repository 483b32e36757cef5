"""The record of a validation: signed JSON, entry in the audit trail, comparison with an earlier one."""

import hashlib
import json
from collections.abc import Generator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

from calstation import __version__
from calstation.config import site_folder
from calstation.errors import CalstationError, ConfigurationError, InputError
from calstation.jobs import ProgressCallback
from calstation.messages import Text, os_reason
from calstation.parsing import read_json
from calstation.records import append_audit, is_signed, site_events, verify_trail, write_atomic
from calstation.validation.installation import identity
from calstation.validation.lines import Line, State, Verdict, verdict_of

SCHEMA = "calstation.validation/1"
#: Entries of a line that the comparison with another validation ignores.
_NOT_COMPARED = ("reason", "clause", "required", "measured")


@dataclass(frozen=True)
class Validation:
    """All lines of a validation, and where and when they were checked."""

    computer: str
    system: str
    user: str | None
    software: str
    identity: Mapping[str, str]  #: Versions of Python and all packages, by name.
    started_utc: str
    duration_s: float
    lines: tuple[Line, ...]
    earlier: str = ""  #: Name of the validation with which this one is compared.
    changes: tuple[dict[str, Any], ...] = ()  #: See `differences`.

    @property
    def name(self) -> str:
        """Identification, and name of the files."""
        return f"validation_{self.started_utc[:19].replace('-', '').replace(':', '')}Z"

    @property
    def verdict(self) -> Verdict:
        """Verdict over all lines."""
        return verdict_of(list(self.lines))

    def to_json(self) -> dict[str, Any]:
        """Return the validation as JSON data, without its signature."""
        states = [line.state for line in self.lines]
        data: dict[str, Any] = {"schema": SCHEMA, "name": self.name, "verdict": self.verdict}
        data["counts"] = {state: states.count(state) for state in get_args(State)}
        data |= {**vars(self), "lines": [line.to_json() for line in self.lines]}
        plain: dict[str, Any] = json.loads(json.dumps(data))
        return plain


def begin_record() -> Generator[Line]:
    """Record the start in the audit trail, so that a validation cannot be discarded unnoticed.

    The key of the station is created if there is none.
    """
    append_audit(site_folder(), "validation_begun", "", software=__version__)
    yield Line.compared("rights", "recorded", "", Text("validation.recorded"), Text("validation.recorded"), good=True)


def signed_json(validation: Validation) -> tuple[dict[str, Any], Text | None]:
    """Return the JSON data with the audit trail's head and the station's signature, and why it is unsigned, or None."""
    data: dict[str, Any] = {**validation.to_json(), "trail": None, "key": None, "signature": None}
    try:
        state = verify_trail(site_folder())
        state.require_intact()
        if state.key_error is not None:
            raise state.key_error
    except CalstationError as error:
        return data, error.as_text
    if state.key is None:
        return data, Text("validation.no_key")
    data |= {"trail": str(state.head), "key": state.key.public}
    return {**data, "signature": state.key.sign(_message(data))}, None


def _message(data: Mapping[str, Any]) -> bytes:
    unsigned = {name: value for name, value in data.items() if name != "signature"}
    return json.dumps(unsigned, sort_keys=True, ensure_ascii=False).encode()


def read_validation(path: Path) -> dict[str, Any]:
    """Return the JSON data of a validation whose signature is valid. Raises InputError."""
    try:
        data = read_json(path)
        intact = data["schema"] == SCHEMA and is_signed(str(data["key"]), _message(data), str(data["signature"]))
    except OSError as exc:
        raise InputError("result.unreadable", file=path, reason=os_reason(exc)) from exc
    except (ValueError, KeyError, TypeError) as exc:
        raise InputError("validation.not_a_validation", file=path) from exc
    if not intact:
        raise InputError("validation.altered", file=path)
    return dict(data)


def differences(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return what changed from one validation to another: rows with `area`, `check`, `subject`, `before`, `after`.

    Values that vary by themselves, such as times, count only if the conclusion changed.
    """
    rows: list[dict[str, Any]] = []
    for name in ("computer", "system", "software", "verdict", "key"):
        if before[name] != after[name]:
            rows.append({"area": "", "check": name, "subject": "", "before": before[name], "after": after[name]})
    old, new = ({(x["area"], x["check"], x["subject"]): x for x in each["lines"]} for each in (before, after))
    for key in dict.fromkeys((*old, *new)):
        values = [None if line is None else _compared(line) for line in (old.get(key), new.get(key))]
        if values[0] != values[1]:
            pair = {"before": _shown(old.get(key)), "after": _shown(new.get(key))}
            rows.append({**dict(zip(("area", "check", "subject"), key, strict=True)), **pair})
    return rows


def _compared(line: Mapping[str, Any]) -> Any:
    """Return the entries of a line that are compared."""
    return line["state"] if line["measured"] else {n: v for n, v in line.items() if n not in _NOT_COMPARED}


def _shown(line: Mapping[str, Any] | None) -> dict[str, Any] | None:
    return None if line is None else {name: line[name] for name in ("state", "expected", "found", "reason")}


def compare(validation: Validation, earlier: Path) -> Validation:
    """Return a validation with its differences from an earlier one. Raises InputError if that one was altered."""
    before = read_validation(earlier)
    after, _ = signed_json(validation)
    return replace(validation, earlier=str(before["name"]), changes=tuple(differences(before, after)))


def save_validation(validation: Validation, files: Mapping[str, bytes], folder: Path) -> None:
    """Write the files of a validation, and record their digests in the audit trail.

    Raises ConfigurationError if a file cannot be written, or if the audit trail cannot be written although it could
    at the start.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            write_atomic(folder / name, content)
    except OSError as exc:
        raise ConfigurationError("result.unwritable", file=folder, reason=os_reason(exc)) from exc
    if any(line.check == "recorded" and line.state == "ok" for line in validation.lines):
        digests = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
        append_audit(
            site_folder(),
            "validation",
            "",
            validation=validation.name,
            verdict=validation.verdict,
            identity=dict(validation.identity),
            files=digests,
        )


def find_validation_due(progress: ProgressCallback) -> Text | None:
    """Job: return what `validation_due` returns."""
    return validation_due()


def validation_due() -> Text | None:
    """Return what has changed since the last validation of this site, or that it did not pass; None otherwise.

    There is no reminder for a site that was never validated or whose audit trail cannot be read.
    """
    try:
        last = next((each for each in reversed(site_events(site_folder())) if each.event == "validation"), None)
    except CalstationError:
        return None
    if last is None:
        return None
    now, then = identity(), last.values.get("identity")
    then = then if isinstance(then, dict) else {}
    changed = [name for name in dict.fromkeys((*now, *then)) if now.get(name) != then.get(name)]
    if changed:
        texts = [f"{name} {then.get(name, '–')} → {now.get(name, '–')}" for name in changed]
        return Text.of("validation.due", date=last.utc[:10], changes=texts)
    if last.values.get("verdict") != "passed":
        return Text.of("validation.not_passed", date=last.utc[:10])
    return None
