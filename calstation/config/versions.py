"""Numbered versions of a site's files, which are checked, written atomically and can be restored."""

import hashlib
import json
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

import tomlkit
from pydantic import JsonValue

from calstation.config import editing, library
from calstation.config.request import Confirmation, plain_text
from calstation.errors import ConfigurationError
from calstation.jobs import ProgressCallback
from calstation.messages import os_reason
from calstation.parsing import parse_toml, read_json
from calstation.physics import NOISE_DISPLAY
from calstation.records import AuditEvent, AuditEventName, append_audit, write_atomic


@dataclass(frozen=True)
class Version:
    """A version of a file; `kind` and `name` are as in `library.find`."""

    kind: str
    name: str
    number: int  #: Version number, from 1.
    saved_utc: str  #: ISO 8601 in UTC.
    author: str | None  #: None if the file was changed outside the program.
    sha256: str  #: Digest of the text.
    reason: str = ""  #: Reason that the author gave, which the window requires for a change of `JUDGING`.


#: Entries of a product that decide whether a unit passes, and who must confirm actions with it.
JUDGING = ("stages", "limits", "checks", "conformity", "temperature", "confirmation")


def list_versions(kind: str, name: str) -> tuple[Version, ...]:
    """Return all versions of a file, starting with the latest."""
    versions = []
    for path in _folder(kind, name).glob("*.json"):
        with suppress(OSError, ValueError, TypeError):  # a damaged entry is skipped, but its text still exists
            versions.append(Version(**read_json(path)))
    return tuple(sorted(versions, key=lambda version: version.number, reverse=True))


def text(kind: str, name: str, number: int) -> str:
    """Return the text of a version. Raises ConfigurationError if it is missing or was changed."""
    path = _folder(kind, name) / f"{number:04d}.toml"
    stored = next((version for version in list_versions(kind, name) if version.number == number), None)
    try:
        content = path.read_bytes().decode()
    except OSError as exc:
        raise ConfigurationError("versions.unreadable", file=path, reason=os_reason(exc)) from exc
    except UnicodeDecodeError as exc:
        raise ConfigurationError("versions.changed", file=path) from exc
    if stored is None or sha256(content) != stored.sha256:
        raise ConfigurationError("versions.changed", file=path)
    return content


def version_number(kind: str, name: str, content: str) -> int | None:
    """Return the latest version with this text; None for a shipped file or a file changed outside the program."""
    digest = sha256(content)
    return next((version.number for version in list_versions(kind, name) if version.sha256 == digest), None)


def changed_outside(events: Iterable[AuditEvent]) -> list[str]:
    """Return the files of the site, such as ``products/nav_a.toml``, that differ from their last version in a trail."""
    last: dict[str, JsonValue] = {}
    for values in (each.values for each in events if each.event in ("file_saved", "file_changed_outside")):
        last[f"{values.get('kind')}/{values.get('name')}.toml"] = values.get("sha256")
    return sorted(file for file, digest in last.items() if _digest_of(library.site_folder() / file) != digest)


def _digest_of(path: Path) -> str | None:
    """Return the SHA-256 of a file; None if it is missing or unreadable."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return None


def sha256(content: str) -> str:
    """Return the digest of a file's text."""
    return hashlib.sha256(content.encode()).hexdigest()


def is_current(kind: str, name: str, opened: str) -> bool:
    """Return whether a file still has the text that was opened; True if it is missing."""
    if name not in library.names(kind):
        return True
    with suppress(ConfigurationError):
        return editing.read_text(library.find(kind, name)) == opened
    return not opened  # an unreadable file was opened without its text


def save(
    kind: str, name: str, content: str, author: str | Confirmation, reason: str = "", *, opened: str | None = None
) -> Version:
    """Check a text and save it as a file of the site, unless it equals the current version.

    Every new version is recorded in the audit trail on disk before the file is written. Raises ConfigurationError with
    the first problem of the text, if the file was changed after it was opened, or if the site's folder cannot be
    written.

    Parameters
    ----------
    kind, name : kind and name of the file, as in `library.find`
    content : new text
    author : author of the version, by name only if no PIN was entered
    reason : reason for the change
    opened : text of the file when it was opened; None to replace the file whatever its text
    """
    if kind not in editing.MODELS or not editing.is_name(name):
        raise ConfigurationError("configuration.bad_name", name=name)
    path = library.site_folder() / kind / f"{name}.toml"
    problems = editing.check(kind, content)
    if problems:
        values = {"file": path, "line": problems[0].line, "what": problems[0].as_text}
        if len(problems) > 1:
            raise ConfigurationError("configuration.line_and_more", more=len(problems) - 1, **values)
        raise ConfigurationError("configuration.line", **values)
    if opened is not None and not is_current(kind, name, opened):
        raise ConfigurationError("versions.changed_meanwhile", file=path)
    try:
        _save_present(kind, name, path)
        versions = list_versions(kind, name)
        if versions and _digest_of(path) == versions[0].sha256 == sha256(content):
            return versions[0]
        person = author if isinstance(author, Confirmation) else Confirmation(author)
        version = replace(_next(kind, name, content, person.by), reason=plain_text(reason))
        _audit("file_saved", version, versions, content, pin=person.pin)
        path.parent.mkdir(parents=True, exist_ok=True)
        _add(version, content)
        try:
            write_atomic(path, content)
        except OSError:
            for suffix in (".json", ".toml"):
                with suppress(OSError):
                    (_folder(kind, name) / f"{version.number:04d}{suffix}").unlink()
            raise
    except OSError as exc:
        raise ConfigurationError("configuration.unwritable", file=path, reason=os_reason(exc)) from exc
    return version


def restore(kind: str, name: str, number: int, author: str | Confirmation) -> Version:
    """Save the text of an old version as a new version. Raises ConfigurationError as `save` does."""
    return save(kind, name, text(kind, name, number), author)


def save_noise(
    report: ProgressCallback, profile: str, values: Mapping[str, float], source: str, author: str | Confirmation
) -> Version:
    """Job: save entries of `[noise]` as a new version of an IMU profile.

    Raises ConfigurationError if there is no such profile, or if it would be invalid or cannot be written.

    Parameters
    ----------
    report : callback for the progress
    profile : name of the profile
    values : new values by entry, SI
    source : origin of the values, which is added as a comment
    author : author of the new version
    """
    report(0.0)
    document = tomlkit.parse(editing.read_text(library.find("imus", profile)))
    noise = cast(tomlkit.items.Table, document["noise"])
    for name, value in values.items():
        unit, display_unit, size = NOISE_DISPLAY[name]
        noise[name] = float(f"{value:.4g}")
        noise[name].comment(f"{unit}, {value / size:.4g} {display_unit}, {source}")
    return save("imus", profile, tomlkit.dumps(document), author)


def _save_present(kind: str, name: str, path: Path) -> None:
    """Add the current file as a version if it is a shipped default, or was created or changed outside the program."""
    try:
        present = (path if path.exists() else library.find(kind, name)).read_bytes().decode()
        parse_toml(present)
    except (ConfigurationError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return  # there is no file, or it is unreadable
    versions = list_versions(kind, name)
    if not versions or versions[0].sha256 != sha256(present):
        version = _next(kind, name, present, None)
        if versions or path.exists():
            _audit("file_changed_outside", version, versions, present)
        _add(version, present)


def _next(kind: str, name: str, content: str, author: str | None) -> Version:
    """Return the next version of a file for this text."""
    number = 1 + max((int(p.stem) for p in _folder(kind, name).glob("*.toml") if p.stem.isdecimal()), default=0)
    return Version(kind, name, number, datetime.now(UTC).isoformat(timespec="seconds"), author, sha256(content))


def _add(version: Version, content: str) -> None:
    """Add a version; its text is written first, so that every version has a text even after a power failure."""
    folder = _folder(version.kind, version.name)
    folder.mkdir(parents=True, exist_ok=True)
    write_atomic(folder / f"{version.number:04d}.toml", content)
    write_atomic(folder / f"{version.number:04d}.json", json.dumps(asdict(version), ensure_ascii=False) + "\n")


def changed_entries(before: str, after: str) -> dict[str, list[JsonValue]]:
    """Return the entries that differ between two texts of a file: dotted keys with both values, None if missing."""
    old, new = (dict(_entries(tomllib.loads(each))) for each in (before, after))
    keys = [*old, *(key for key in new if key not in old)]
    return {key: [old.get(key), new.get(key)] for key in keys if old.get(key) != new.get(key)}


def _entries(value: Any, key: str = "") -> Iterator[tuple[str, JsonValue]]:
    """Yield the entries below a key of a file; an item of a list of tables has its number, from 1, as a key."""
    if isinstance(value, list) and any(isinstance(each, dict) for each in value):
        value = {str(number): each for number, each in enumerate(value, 1)}
    if not isinstance(value, dict):
        yield key, json.loads(json.dumps(value, default=str), parse_constant=str)
        return
    for name, each in value.items():
        yield from _entries(each, f"{key}.{name}" if key else name)


def _audit(
    event: AuditEventName, version: Version, earlier: Sequence[Version], content: str, **identified: Any
) -> None:
    """Record a version with its text and its differences from the latest earlier version."""
    changed: dict[str, list[JsonValue]] = {}
    with suppress(ConfigurationError, tomllib.TOMLDecodeError):  # a damaged version must not prevent a new one
        if earlier:
            changed = changed_entries(text(version.kind, version.name, earlier[0].number), content)
    append_audit(
        library.site_folder(),
        event,
        version.author or "",
        version.reason,
        kind=version.kind,
        name=version.name,
        version=version.number,
        sha256=version.sha256,
        changed=changed,
        **identified,
    )


def _folder(kind: str, name: str) -> Path:
    return library.site_folder() / "versions" / kind / name
