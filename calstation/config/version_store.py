"""Where the versions of a site's files are kept: text and what is known of it, numbered, never changed."""

import hashlib
import json
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

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


def kept(kind: str, name: str) -> tuple[Version, ...]:
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
    found = next((version for version in kept(kind, name) if version.number == number), None)
    try:
        content = path.read_bytes().decode()
    except (OSError, UnicodeDecodeError) as exc:
        raise ConfigurationError(f"{path}: cannot be read ({exc}); choose another version") from exc
    if found is None or sha256(content) != found.sha256:
        raise ConfigurationError(f"{path}: not as it was saved (sha256); choose another version")
    return content


def number_of(kind: str, name: str, content: str) -> int | None:
    """The latest version that has this text, None for a shipped file or one edited by other means."""
    digest = sha256(content)
    return next((version.number for version in kept(kind, name) if version.sha256 == digest), None)


def sha256(content: str) -> str:
    """Digest of a text as it stands in a file."""
    return hashlib.sha256(content.encode()).hexdigest()


def keep(kind: str, name: str, content: str, author: str | None) -> Version:
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


def forget(version: Version) -> None:
    """Take back a version that never came into force."""
    for suffix in (".json", ".toml"):
        with suppress(OSError):
            (_folder(version.kind, version.name) / f"{version.number:04d}{suffix}").unlink()


def _folder(kind: str, name: str) -> Path:
    return library.site_folder() / "versions" / kind / name
