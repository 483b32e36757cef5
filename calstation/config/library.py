"""Finds stations, tables, IMUs and products: the site's own folder first, then the shipped defaults."""

import os
import sys
from pathlib import Path

from calstation.errors import ConfigurationError

#: Folders of files.
KINDS = ("stations", "tables", "imus", "products")


def site_folder() -> Path:
    """The site's own folder: $CALSTATION_HOME, else the platform's place for configuration."""
    if home := os.environ.get("CALSTATION_HOME"):
        return Path(home)
    if sys.platform == "win32":
        return Path(os.environ.get("APPDATA", Path.home())) / "calstation"
    return Path(os.environ.get("XDG_CONFIG_HOME", Path.home() / ".config")) / "calstation"


def pair_folder() -> Path:
    """Where the site stores the calibrations of IMU pairs."""
    return site_folder() / "pairs"


def shipped_folder() -> Path:
    """The defaults that came with the program: beside its source tree, or inside the installed package."""
    package = Path(__file__).resolve().parent.parent
    beside = package.parent / "data"
    return beside if (beside / "stations").is_dir() else package / "data"


def find(kind: str, name: str) -> Path:
    """The file of a profile, e.g. ``find("tables", "bench")``.

    Raises ConfigurationError naming the profiles that exist.
    """
    for folder in (site_folder(), shipped_folder()):
        path = folder / kind / f"{name}.toml"
        if path.is_file():
            return path
    known = ", ".join(names(kind)) or "none"
    raise ConfigurationError(f"{kind[:-1]} profile '{name}' does not exist; choose from: {known}")


def locate(kind: str, path: Path) -> Path:
    """The file that a person means by a path, or by the name that a file of the site or a shipped one has.

    Raises ConfigurationError naming the files that exist where it is neither.
    """
    if path.is_file() or path.suffix == ".toml" or path.parent != Path():
        return path
    known = names(kind)
    if path.name not in known:
        raise ConfigurationError(
            f"{kind[:-1]} '{path}' does not exist; give a file's path, or a name of: {', '.join(known)}"
        )
    return find(kind, path.name)


def locate_any(path: Path) -> Path:
    """The same where the kind is not known: a path, or a name that only one kind has. Raises ConfigurationError."""
    if path.is_file() or path.suffix == ".toml" or path.parent != Path():
        return path
    kinds = [kind for kind in KINDS if path.name in names(kind)]
    if len(kinds) > 1:
        raise ConfigurationError(
            f"'{path}' is the name of files in {' and '.join(kinds)}; give the file's path, e.g."
            f" {find(kinds[0], path.name)}"
        )
    return find(kinds[0], path.name) if kinds else path


def names(kind: str) -> list[str]:
    """Names of all profiles of a kind, the site's and the shipped, sorted."""
    found: set[str] = set()
    for folder in (site_folder(), shipped_folder()):
        found.update(path.stem for path in (folder / kind).glob("*.toml"))
    return sorted(found)
