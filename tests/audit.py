"""Compare the packages of an installation with the known vulnerabilities: make audit [ADVISORIES=FOLDER].

FOLDER is a copy of PyPA's advisory database (github.com/pypa/advisory-database), which is read without a network.
Without it, pip-audit asks its service. A package that cannot be compared is an error.
"""

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml
from make_sbom import ROOT, collect
from packaging.version import Version


def is_affected(version: str, affected: dict[str, Any]) -> bool:
    """Return whether a version is in the list or in a range of an entry ``affected`` of the OSV format."""
    if version in affected.get("versions", ()):
        return True
    for part in affected.get("ranges", ()):
        inside = False
        for event in part["events"] if part["type"] == "ECOSYSTEM" else ():
            ((kind, limit),) = event.items()
            if kind == "introduced":
                inside = inside or limit == "0" or Version(version) >= Version(limit)
            elif kind == "fixed":
                inside = inside and Version(version) < Version(limit)
            elif kind == "last_affected":
                inside = inside and Version(version) <= Version(limit)
        if inside:
            return True
    return False


def vulnerabilities(folder: Path, packages: dict[str, str]) -> Iterator[tuple[str, str]]:
    """Yield the name and the identifier of each vulnerability of these packages, versions by name."""
    for name, version in sorted(packages.items()):
        for path in sorted((folder / "vulns" / name).glob("*.yaml")):
            advisory = yaml.load(path.read_text("utf-8"), yaml.CSafeLoader)
            of_package = (each for each in advisory["affected"] if each["package"]["name"].lower() == name)
            if "withdrawn" not in advisory and any(is_affected(version, each) for each in of_package):
                yield name, str(advisory["id"])


def main(arguments: list[str]) -> int:
    """Print the vulnerabilities and return 1 if there are some, 2 if the packages cannot be compared."""
    packages = {name: package.version for name, package in collect()[0].items() if name != ROOT}
    if not arguments:
        with tempfile.TemporaryDirectory() as folder:
            listed = Path(folder, "requirements.txt")
            listed.write_text("".join(f"{name}=={version}\n" for name, version in packages.items()), "utf-8")
            options = ["--strict", "--progress-spinner", "off", "--disable-pip", "--no-deps"]
            return subprocess.call([sys.executable, "-m", "pip_audit", *options, "--requirement", str(listed)])
    folder = Path(arguments[0])
    if not any(folder.glob("vulns/*/*.yaml")):
        sys.stderr.write(f"{folder} contains no advisories (vulns/PACKAGE/ID.yaml)\n")
        return 2
    found = [f"{name} {packages[name]}: {identifier}" for name, identifier in vulnerabilities(folder, packages)]
    sys.stdout.write("\n".join([*found, f"{len(packages)} packages, {len(found)} vulnerabilities\n"]))
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
