"""Comparison of the result file of a run with the result in its log, and of its release with the audit trail.

A result file can be edited with any editor. Certificates, labels, the history and `apply` therefore use the result in
the log; an edited file is refused, or replaced by the result in the log.
"""

import hashlib
import json
import math
import os
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

from calstation.config import site_folder
from calstation.errors import InputError
from calstation.messages import Text
from calstation.records import (
    SUFFIX,
    AuditEvent,
    Verdict,
    audit_path,
    head_file,
    key_file,
    last_result,
    open_log,
    site_events,
    verify_trail,
)
from calstation.results.result import NO_RESULT, Result, read_content, result_from
from calstation.results.sections import Override

#: Entries that are added later to the result file of a run: an override, which must be in the audit trail (see
#: `load_confirmed_result`), and the decision not to resume an interrupted run, which certificates do not state.
ADDED_LATER = ("override", "closed_utc", "closed_by")
#: Codes of the errors about a release that the audit trail does not confirm.
RELEASE_IN_DOUBT = ("result.release_unknown", "result.release_unconfirmed")
#: Maximum length of a value in a message.
_MAX_LENGTH = 30


def load_run_result(path: Path, *, require_log: bool = False) -> Result:
    """Read a result file; compare the file of a run with its log, if the log is next to it or where the run wrote it.

    Raises InputError, also if the file differs from the result in the log, or the log is that of another run. With
    `require_log`, the log must exist and be readable, because nothing else confirms the result.
    """
    content = read_content(path)
    result = result_from(content, path)
    if result.outcome == "resolved":
        return result
    log = run_log(result.log.file, path)
    if log is None:
        if require_log:
            raise InputError("report.no_log", file=path, log=result.log.file)
        return result
    try:
        stored = last_result(log)
    except InputError:
        if require_log:
            raise
        return result
    entry = altered_entry(content, stored)
    if entry is None:
        return result
    if stored is None and open_log(log).outcome is None:
        raise InputError("result.unconfirmed", file=path, log=log)
    require_own_log(stored, log)
    raise InputError("result.altered", file=path, log=log, entry=entry_text(entry, stored, content))


def is_run(result: Result, name: str) -> bool:
    """Return whether a result belongs to the run with this name instead of being a copy or an offline solution."""
    return result.outcome != "resolved" and Path(result.log.file.replace("\\", "/")).stem == name


def require_own_log(stored: Mapping[str, Any] | None, log: Path) -> None:
    """Raise InputError if the result `stored` in a log is that of another run, because the log was exchanged."""
    with suppress(*NO_RESULT):
        other = Result.from_json(stored or {})
        if not is_run(other, log.stem):
            run = Path(other.log.file.replace("\\", "/")).stem
            raise InputError("result.log_of_other", log=log, serial=other.serial, run=run)


def load_confirmed_result(path: Path) -> Result:
    """Read the result file of a run as `load_run_result`; the audit trail must contain its release, if it has one."""
    result = load_run_result(path)
    require_recorded_release(result, path)
    return result


def require_recorded_release(result: Result, path: Path) -> None:
    """Raise InputError if the audit trail of the site was changed, or does not contain the release in a result file."""
    if result.override is None or is_release_recorded(result):
        return
    code = "result.release_unknown" if _releases() is not None else "result.release_unconfirmed"
    raise InputError(code, file=path, by=result.override.by)


def is_release_recorded(result: Result) -> bool:
    """Return whether the site's audit trail is intact and contains the release of a result; may raise InputError."""
    return (result.log.sha256, result.override) in (_releases() or [])


def _releases() -> list[tuple[object, Override]] | None:
    """Return the digest of the log and the release of every event of the site; None if the trail was changed."""
    folder = site_folder()
    files = (audit_path(folder), head_file(folder), key_file(folder))
    stamps = tuple((s.st_mtime_ns, s.st_size) if (s := _status(file)) is not None else None for file in files)
    return _recorded_releases(folder, stamps)


@lru_cache(maxsize=1)  # many results are compared with one trail
def _recorded_releases(folder: Path, stamps: object) -> list[tuple[object, Override]] | None:
    if verify_trail(folder).faults:
        return None
    releases = (event for event in site_events(folder) if event.event == "override")
    return [(event.values.get("log_sha256"), override_of(event)) for event in releases]


def override_of(event: AuditEvent) -> Override:
    """Return the release that an event of the audit trail records."""
    return Override(by=event.by, confirmed_by=event.confirmed_by, why=event.why, utc=event.utc)


def _status(file: Path) -> os.stat_result | None:
    try:
        return file.stat()
    except OSError:
        return None


def was_simulated(result: Result, path: Path) -> bool:
    """Return whether a run was simulated; a result file of an earlier version does not state it, but its log does."""
    log = None if "simulated" in result.model_fields_set else run_log(result.log.file, path)
    with suppress(InputError):
        return result.simulated if log is None else open_log(log).meta.is_simulated
    return False


def run_log(file: str, path: Path) -> Path | None:
    """Return the log of a run: next to its result file, or at the path in it; None if it is missing."""
    return next((each for each in (path.with_suffix(SUFFIX), Path(file)) if each.is_file()), None)


def altered_entry(content: Mapping[str, Any], stored: Mapping[str, Any] | None) -> str | None:
    """Return the first entry of a run's result file that differs from the result in its log; None if they agree.

    A log without a result belongs to a run that did not end normally, so its result file must not state that the unit
    passed. The path of the log is not compared.
    """
    if stored is None:
        return "outcome" if content.get("outcome") == Verdict.PASSED else None
    stated = {key: value for key, value in content.items() if key not in ADDED_LATER}
    return difference(_without_path(stated), _without_path(stored), 0.0)


def entry_text(entry: str, stored: Mapping[str, Any] | None, stated: Mapping[str, Any]) -> Text:
    """Return the name of a differing entry, with its values in the log and in the file if both are short.

    Parameters
    ----------
    entry : name of the entry, as from `difference`
    stored : result in the log; None if it contains none
    stated : content of the result file
    """
    values = [_short_value(content, entry) for content in (stored or {}, stated)]
    if None in values:
        return Text.of("result.entry", entry=entry)
    return Text.of("result.entry_values", entry=entry, stored=values[0], stated=values[1])


def _short_value(content: Any, entry: str) -> str | None:
    """Return the JSON of a short number, text or truth value in a result; None if it is missing or long."""
    for key in entry.split("."):
        if isinstance(content, list) and key.isdecimal() and int(key) < len(content):
            content = content[int(key)]
        elif isinstance(content, dict) and key in content:
            content = content[key]
        else:
            return None
    text = json.dumps(content, ensure_ascii=False)
    return None if isinstance(content, dict | list) or len(text) > _MAX_LENGTH else text


def content_digest(content: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a result without the entries that are added later, and without the path of its log."""
    stated = {key: value for key, value in content.items() if key not in ADDED_LATER}
    return hashlib.sha256(json.dumps(_without_path(stated), sort_keys=True).encode()).hexdigest()


def _without_path(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return a result without the path of its log."""
    log = content.get("log")
    return {**content, "log": {**log, "file": ""}} if isinstance(log, dict) else {**content}


def difference(one: Any, other: Any, rounding: float, scale: float = 0.0) -> str | None:
    """Return the first entry in which two JSON values differ, such as ``checks.2.value``; None if they agree.

    Numbers agree within `rounding` times the `sigma` next to them or, without one, times the largest number of their
    row; whole numbers must be equal.

    Parameters
    ----------
    one, other : JSON values
    rounding : tolerance of numbers, relative to their scale
    scale : scale of numbers without a `sigma`
    """
    if isinstance(one, dict) and isinstance(other, dict):
        pairs = {key: (one.get(key, ...), other.get(key, ...)) for key in (*other, *one)}
        scale = _scale(other) if rounding else 0.0
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        pairs = {str(k): pair for k, pair in enumerate(zip(one, other, strict=True))}
        scale = _scale(dict(enumerate(other))) if rounding else 0.0
    else:
        floats = isinstance(one, float) and isinstance(other, float)
        equal = floats and math.isclose(one, other, rel_tol=0.0, abs_tol=rounding * scale)
        return None if equal or (one == other and type(one) is type(other)) else ""
    for key, (a, b) in pairs.items():
        entry = difference(a, b, rounding, scale)
        if entry is not None:
            return f"{key}.{entry}".removesuffix(".")
    return None


def _scale(row: Mapping[Any, Any]) -> float:
    """Return the scale for the rounding of the numbers of a row."""
    if _is_number(row.get("sigma")):
        return float(row["sigma"])
    numbers = (part for value in row.values() for part in (value if isinstance(value, list) else [value]))
    return max((abs(number) for number in numbers if _is_number(number)), default=0.0)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
