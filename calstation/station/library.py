"""Finds stations, tables, IMUs and products: the site's own folder first, then the shipped defaults."""

import os
import sys
from pathlib import Path

from calstation.errors import ConfigurationError


def site_folder() -> Path:
    """The site's own folder: $CALSTATION_HOME, else the platform's place for configuration."""
    if home := os.environ.get("CALSTATION_HOME"):
        return Path(home)
    if sys.platform == "win32":
        return Path(os.environ.get("APPDATA", Path.home())) / "calstation"
    return Path(os.environ.get("XDG_CONFIG_HOME", Path.home() / ".config")) / "calstation"


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


def names(kind: str) -> list[str]:
    """Names of all profiles of a kind, the site's and the shipped, sorted."""
    found: set[str] = set()
    for folder in (site_folder(), shipped_folder()):
        found.update(path.stem for path in (folder / kind).glob("*.toml"))
    return sorted(found)
