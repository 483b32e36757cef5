"""Checks of the installation: unchanged files, required versions, and no package loaded from another folder."""

import base64
import csv
import hashlib
import json
import os
import platform
import sys
from collections.abc import Generator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path, PurePosixPath

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

from calstation.messages import Text
from calstation.validation.lines import CheckStopped, Line

ROOT = "calstation"
#: Optional part that only developers install.
_DEVELOPMENT = "dev"


@dataclass
class Package:
    """A required package: its distribution, None if not installed, and the versions that other packages require."""

    installed: Distribution | None
    required: SpecifierSet = field(default_factory=SpecifierSet)

    @property
    def version(self) -> str:
        """Installed version, or "-"."""
        return "-" if self.installed is None else self.installed.version

    @cached_property
    def hashed(self) -> list[tuple[str, Path, str, str]]:
        """Recorded name, path, algorithm and hash of the files; without those that the installer creates.

        The record is read directly, because `Distribution.files` of some versions of Python omits missing files.
        """
        if self.installed is None:
            return []
        rows = csv.reader((self.installed.read_text("RECORD") or "").splitlines())
        return [
            (name, Path(str(self.installed.locate_file(name))), mode, value)
            for name, (mode, _, value) in ((row[0], row[1].partition("=")) for row in rows)
            if value and not name.endswith(".pyc") and ".." not in PurePosixPath(name).parts
        ]

    @property
    def is_source_tree(self) -> bool:
        """Whether the package is used from a folder of sources, whose files have no recorded hashes."""
        origin = json.loads((self.installed and self.installed.read_text("direct_url.json")) or "{}")
        return bool(origin.get("dir_info", {}).get("editable"))

    @property
    def digest(self) -> str:
        """SHA-256 of the recorded names and hashes, which is the same wherever this version is installed."""
        rows = sorted((name, value) for name, _, _, value in self.hashed if ".dist-info" not in name)
        return hashlib.sha256("".join(f"{name} {value}\n" for name, value in rows).encode()).hexdigest()


def packages(extra: str = "") -> dict[str, Package]:
    """Return calstation and all packages that it needs on this computer, or that one of its optional parts needs."""
    packages_by_name = {ROOT: Package(_find(ROOT))}
    pending, done = [(ROOT, extra)], set[tuple[str, str]]()
    while pending:
        name, part = pending.pop()
        installed = packages_by_name[name].installed
        if (name, part) in done or installed is None:
            continue
        done.add((name, part))
        for requirement in map(Requirement, installed.requires or []):
            if requirement.marker is None or requirement.marker.evaluate({"extra": part}):
                needed = canonicalize_name(requirement.name)
                packages_by_name.setdefault(needed, Package(_find(needed))).required &= requirement.specifier
                pending += [(needed, each) for each in ("", *requirement.extras)]
    return packages_by_name


def _find(name: str) -> Distribution | None:
    try:
        return distribution(name)
    except PackageNotFoundError:
        return None


def identity() -> dict[str, str]:
    """Return the versions of Python, calstation and all packages that it needs, by name.

    The version of calstation includes the digest of its files as they were installed.
    """
    installed = packages()
    versions = {name: each.version for name, each in sorted(installed.items())}
    versions[ROOT] = f"{installed[ROOT].version} ({installed[ROOT].digest[:16]})"
    return {"python": platform.python_version(), **versions}


def installation_lines(check_stopped: CheckStopped) -> Generator[Line]:
    """Compare versions with the released list, and the files of all packages with the hashes in their records."""
    area, root, needed = "installation", ROOT, packages()
    program = needed[root].installed
    required = "" if program is None else (program.metadata.get_all("Requires-Python") or [""])[0]
    version = platform.python_version()
    yield Line.compared(area, "python", "", required, version, bool(required) and version in SpecifierSet(required))
    system = f"{platform.system()} {platform.release()}, {platform.machine()}, {os.cpu_count()} × CPU"
    yield Line(area, "system", "", Text("validation.recorded"), system, "ok")
    variables = [name for name in ("PYTHONPATH", "PYTHONHOME") if os.environ.get(name)]
    shown = ", ".join(variables) or Text("validation.none")
    yield Line.compared(area, "variables", "", Text("validation.none"), shown, not variables)
    for name, package in sorted(needed.items(), key=lambda item: (item[0] != root, item[0])):
        check_stopped()
        yield from _package_lines(name, package)
    extras = [] if program is None else program.metadata.get_all("Provides-Extra") or []
    for extra in (each for each in extras if each != _DEVELOPMENT):
        check_stopped()
        added = {name: package for name, package in packages(extra).items() if name not in needed}
        yield from _extra_lines(extra, added)
        needed |= added


def _extra_lines(extra: str, added: Mapping[str, Package]) -> Generator[Line]:
    """Yield a line for each installed package of an optional part, and one line for those not installed."""
    missing = [name for name, package in added.items() if package.installed is None]
    for name, package in sorted(added.items()):
        if package.installed is not None:
            yield from _package_lines(name, package)
    if missing:
        reason = Text.of("validation.not_installed", names=missing)
        yield Line.unchecked("installation", "extra", extra, "", reason, required=False)


def _package_lines(name: str, package: Package) -> Generator[Line]:
    area, expected = "installation", Text.of("validation.version", required=str(package.required) or "*")
    if name == ROOT:
        expected = Text("validation.files_released")
    if package.installed is None:
        yield Line.compared(area, "package", name, expected, Text("validation.missing"), good=False)
        return
    elsewhere = _loaded_elsewhere(package)
    if package.is_source_tree or elsewhere:
        reason = Text.of("validation.source_tree", folder=elsewhere or "")
        yield Line.unchecked(area, "package", name, expected, reason)
        return
    if not package.hashed:
        yield Line.unchecked(area, "package", name, expected, Text("validation.no_record"))
        return
    altered = altered_files(package)
    values = {"version": package.version, "files": len(package.hashed), "digest": package.digest[:16]}
    found = Text("validation.files", values)
    good = not altered and package.required.contains(package.version, prereleases=True)
    if altered:
        found = Text.of("validation.altered_files", version=package.version, count=len(altered), names=altered[:3])
    yield Line.compared(area, "package", name, expected, found, good)


def altered_files(package: Package) -> list[str]:
    """Return the names of altered and missing files, and of files that were added to calstation's own folders."""
    altered = []
    for name, path, mode, value in sorted(package.hashed):
        try:
            actual = hashlib.new(mode, path.read_bytes()).digest()
        except OSError:
            actual = b""
        if base64.urlsafe_b64encode(actual).rstrip(b"=").decode() != value:
            altered.append(name)
    if package.installed is not None and canonicalize_name(package.installed.name) == ROOT:
        known = {path for _, path, _, _ in package.hashed}
        folders = {Path(str(package.installed.locate_file(PurePosixPath(n).parts[0]))) for n, *_ in package.hashed}
        files = (file for folder in folders if folder.suffix != ".dist-info" for file in folder.rglob("*"))
        added = (file for file in files if file.is_file() and "__pycache__" not in file.parts and file not in known)
        altered += sorted(map(str, added))
    return altered


def _loaded_elsewhere(package: Package) -> str | None:
    """Return the folder of a loaded module with a name of the package, if it is outside its installation; or None."""
    tops = {PurePosixPath(name).parts[0].removesuffix(".py") for name, *_ in package.hashed}
    base = Path(str(package.installed.locate_file("."))).resolve() if package.installed is not None else Path()
    if package.installed is not None and canonicalize_name(package.installed.name) == ROOT:
        tops.add(ROOT)
    for top in tops:
        file = getattr(sys.modules.get(top), "__file__", None)
        if file is not None and not Path(file).resolve().is_relative_to(base):
            return str(Path(file).parent)
    return None
