"""Changes to a site's files: checked, put in place whole, and taken back; every version is kept."""

import re
import tomllib
from pathlib import Path

from calstation.config import editing as settings
from calstation.config import library
from calstation.config.version_store import Version, forget, keep, kept, number_of, sha256, text
from calstation.errors import ConfigurationError
from calstation.records.atomic import write_atomic

__all__ = ["Version", "list", "number_of", "restore", "save", "text"]

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")

list = kept


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
        versions = kept(kind, name)
        if versions and path.exists() and versions[0].sha256 == sha256(content):
            return versions[0]
        path.parent.mkdir(parents=True, exist_ok=True)
        version = keep(kind, name, content, author)
        try:
            write_atomic(path, content)
        except OSError:
            forget(version)
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
    versions = kept(kind, name)
    if not versions or versions[0].sha256 != sha256(present):
        keep(kind, name, present, None)
