"""Where the versions of a site's files are kept: text and what is known of it, numbered, never changed."""

import hashlib
import json
import re
import tomllib
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from calstation.config import editing as settings
from calstation.config import library
from calstation.errors import ConfigurationError
from calstation.records.atomic import write_atomic


@dataclass(frozen=True)
class Version:
    """One version of a file.

    Attributes
    ----------
    kind, name : as in `library.find`: stations, products, tables or imus
    number : from 1; saved_utc : ISO 8601
    author : who saved it, None for what was found in the site's folder without having been saved here
    sha256 : of the file's bytes
    """

    kind: str
    name: str
    number: int
    saved_utc: str
    author: str | None
    sha256: str


def list_versions(kind: str, name: str) -> tuple[Version, ...]:
    """All versions of a file, the latest first."""
    versions = []
    for path in _folder(kind, name).glob("*.json"):
        try:
            data: Any = json.loads(path.read_text(encoding="utf-8"))
            versions.append(Version(**data))
        except (OSError, ValueError, TypeError):
            continue  # damaged by other means; its text is still beside it
    return tuple(sorted(versions, key=lambda version: version.number, reverse=True))


def text(kind: str, name: str, number: int) -> str:
    """The text of a version. Raises ConfigurationError where it is not there or not what was saved."""
    path = _folder(kind, name) / f"{number:04d}.toml"
    found = next((version for version in list_versions(kind, name) if version.number == number), None)
    try:
        content = path.read_bytes().decode()
    except (OSError, UnicodeDecodeError) as exc:
        raise ConfigurationError(f"{path}: cannot be read ({exc}); choose another version") from exc
    if found is None or sha256(content) != found.sha256:
        raise ConfigurationError(f"{path}: not as it was saved (sha256); choose another version")
    return content


def version_number(kind: str, name: str, content: str) -> int | None:
    """The latest version that has this text, None for a shipped file or one edited by other means."""
    digest = sha256(content)
    return next((version.number for version in list_versions(kind, name) if version.sha256 == digest), None)


def sha256(content: str) -> str:
    """Digest of a text as it stands in a file."""
    return hashlib.sha256(content.encode()).hexdigest()


def add_version(kind: str, name: str, content: str, author: str | None) -> Version:
    """Add a version. Raises OSError.

    Its text goes first, then what makes it a version: a power cut leaves no version without its text.
    """
    folder = _folder(kind, name)
    folder.mkdir(parents=True, exist_ok=True)
    number = 1 + max((int(path.stem) for path in folder.glob("*.toml") if path.stem.isdecimal()), default=0)
    now = datetime.now(UTC).isoformat(timespec="seconds")
    version = Version(kind, name, number, now, author, sha256(content))
    write_atomic(folder / f"{number:04d}.toml", content)
    write_atomic(folder / f"{number:04d}.json", json.dumps(asdict(version), ensure_ascii=False) + "\n")
    return version


def remove_version(version: Version) -> None:
    """Take back a version that never came into force."""
    for suffix in (".json", ".toml"):
        with suppress(OSError):
            (_folder(version.kind, version.name) / f"{version.number:04d}{suffix}").unlink()


def _folder(kind: str, name: str) -> Path:
    return library.site_folder() / "versions" / kind / name


_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")


def save(kind: str, name: str, content: str, author: str) -> Version:
    """Check `content` and make it the site's file of this name; what was there before is kept as a version.

    A text equal to the present version is saved no second time. Raises ConfigurationError with the first thing
    that is wrong, and where the site's folder cannot be written.
    """
    if kind not in settings.MODELS or not _NAME.fullmatch(name):
        raise ConfigurationError(f"{kind}/{name}: no file of a site; use letters, digits, - and _")
    path = library.site_folder() / kind / f"{name}.toml"
    problems = settings.check(kind, content)
    if problems:
        first = problems[0]
        more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        raise ConfigurationError(f"{path}: line {first.line}: {first.text}{more}")
    try:
        _keep_found(kind, name, path)
        versions = list_versions(kind, name)
        if versions and path.exists() and versions[0].sha256 == sha256(content):
            return versions[0]
        path.parent.mkdir(parents=True, exist_ok=True)
        version = add_version(kind, name, content, author)
        try:
            write_atomic(path, content)
        except OSError:
            remove_version(version)
            raise
    except OSError as exc:
        raise ConfigurationError(
            f"{path}: cannot be written ({exc.strerror or exc}); make the site's folder writable"
        ) from exc
    return version


def restore(kind: str, name: str, number: int, author: str) -> Version:
    """Make an old version the present one again, as a new version. Raises ConfigurationError as `save` does."""
    return save(kind, name, text(kind, name, number), author)


def _keep_found(kind: str, name: str, path: Path) -> None:
    """What is there and was not saved here, a file edited by hand or the shipped default, is kept as well."""
    try:
        present = (path if path.exists() else library.find(kind, name)).read_bytes().decode()
        tomllib.loads(present)
    except (ConfigurationError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return  # nothing there, or nothing that anybody could want back
    versions = list_versions(kind, name)
    if not versions or versions[0].sha256 != sha256(present):
        add_version(kind, name, present, None)
