"""The library of station, table, chamber, IMU and product files: the site's own files and the shipped defaults."""

import os
import sys
from functools import cache
from pathlib import Path

from calstation.errors import ConfigurationError

#: Kinds of files, each with its folder.
KINDS = ("stations", "tables", "chambers", "imus", "products")


def site_folder() -> Path:
    """Return the site's folder: $CALSTATION_HOME, or else the platform's configuration folder.

    Raises ConfigurationError if neither is set and the user has no home folder.
    """
    if home := os.environ.get("CALSTATION_HOME"):
        return Path(home)
    windows = sys.platform == "win32"
    if folder := os.environ.get("APPDATA" if windows else "XDG_CONFIG_HOME"):
        return Path(folder) / "calstation"
    try:
        return (Path.home() if windows else Path.home() / ".config") / "calstation"
    except RuntimeError as exc:
        raise ConfigurationError("configuration.no_home") from exc


def pair_folder() -> Path:
    """Return the folder in which the site stores the calibrations of IMU pairs."""
    return site_folder() / "pairs"


@cache
def shipped_folder() -> Path:
    """Return the folder of the shipped defaults, which is next to the source package or inside the installed one."""
    package = Path(__file__).resolve().parent.parent
    beside = package.parent / "data"
    return beside if (beside / "stations").is_dir() else package / "data"


def manual_folder() -> Path:
    """Return the folder of the manual, which is next to the source package or inside the installed one."""
    package = Path(__file__).resolve().parent.parent
    beside = package.parent / "docs"
    return beside if (beside / "index.md").is_file() else package / "docs"


def fonts_folder() -> Path:
    """Return the folder of the font used by the window, certificates and labels."""
    return shipped_folder() / "fonts"


def names(kind: str) -> list[str]:
    """Return the sorted names of the site's and the shipped files of a kind."""
    folders = (site_folder() / kind, shipped_folder() / kind)
    return sorted({path.stem for folder in folders for path in folder.glob("*.toml")})


def find(kind: str, name: str) -> Path:
    """Return the path of a file by kind and name, e.g. ``find("tables", "bench")``. Raises ConfigurationError."""
    for folder in (site_folder(), shipped_folder()):
        path = folder / kind / f"{name}.toml"
        if path.is_file():
            return path
    raise ConfigurationError("configuration.no_profile", kind=kind, name=name, known=names(kind))


def share_name(kind: str, path: Path, other: Path) -> bool:
    """Return whether two files of the library have the same name, so that `find` returns only one of them."""
    folders = [folder / kind for folder in (site_folder(), shipped_folder())]
    return path.stem == other.stem and path.parent in folders and other.parent in folders


def find_beside(product: Path | None, name: str) -> Path | None:
    """Return a file named by a product file, or None if it does not exist.

    The file is next to the product file or, if that is a copy or a draft, next to the site's or the shipped products.
    """
    folders = [folder / "products" for folder in (site_folder(), shipped_folder())]
    if product is not None:
        folders.insert(0, product.parent)
    return next((folder / name for folder in folders if (folder / name).is_file()), None)


def locate(kind: str, path: Path) -> Path:
    """Return the file of a kind that the user specified by path or by name. Raises ConfigurationError."""
    if _is_path(path):
        return path
    if path.name not in names(kind):
        raise ConfigurationError("configuration.no_file_or_name", kind=kind, name=str(path), known=names(kind))
    return find(kind, path.name)


def locate_any(path: Path) -> Path:
    """Return the file of any kind that the user specified by path or by name. Raises ConfigurationError."""
    if _is_path(path):
        return path
    kinds = [kind for kind in KINDS if path.name in names(kind)]
    if len(kinds) > 1:
        example = find(kinds[0], path.name)
        raise ConfigurationError("configuration.ambiguous_name", name=str(path), kinds=kinds, example=example)
    return find(kinds[0], path.name) if kinds else path


def _is_path(path: Path) -> bool:
    return path.is_file() or path.suffix == ".toml" or path.parent != Path()
