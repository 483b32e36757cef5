"""Write the software bill of materials of the installed calstation (CycloneDX 1.6): make sbom.

It names calstation with its optional parts for sharing and signing, all packages that they need, their exact versions
and licences, and the SHA-256 of the files of a release. The same installation gives the same bytes.
"""

import hashlib
import json
import sys
from collections.abc import Iterable
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = "calstation"
EXTRAS = ("fleet", "signing")


def needed(package: Distribution, extras: Iterable[str]) -> dict[str, set[str]]:
    """Return the packages that a package with extras needs on this computer, with their extras."""
    names: dict[str, set[str]] = {}
    for text in package.requires or []:
        requirement = Requirement(text)
        marker = requirement.marker
        if marker is None or any(marker.evaluate({"extra": extra}) for extra in ("", *extras)):
            names.setdefault(canonicalize_name(requirement.name), set()).update(requirement.extras)
    return names


def collect(root: str = ROOT, extras: Iterable[str] = EXTRAS) -> tuple[dict[str, Distribution], dict[str, set[str]]]:
    """Return all needed packages by name, and what each needs. Raises PackageNotFoundError if one is missing."""
    packages: dict[str, Distribution] = {}
    needs: dict[str, set[str]] = {}
    done: dict[str, set[str]] = {}
    pending = [(root, set(extras))]
    while pending:
        name, wanted = pending.pop()
        if name in done and wanted <= done[name]:
            continue
        done[name] = done.get(name, set()) | wanted
        packages[name] = distribution(name)
        found = needed(packages[name], done[name])
        needs[name] = set(found)
        pending += found.items()
    return packages, needs


def licence(package: Distribution) -> list[dict[str, Any]]:
    """Return the licence of a package as its metadata state it, or nothing."""
    expression = package.metadata.get("License-Expression")
    if expression:
        return [{"expression": expression}]
    classifiers = [c for c in package.metadata.get_all("Classifier") or [] if c.startswith("License ::")]
    names = [c.rpartition(" :: ")[2] for c in classifiers] or [package.metadata.get("License") or ""]
    return [{"license": {"name": name}} for name in names if name and len(name) < 80]


def component(name: str, package: Distribution) -> dict[str, Any]:
    """Return the component of a package; its hash is that of the list of its files, which contains their hashes."""
    purl = f"pkg:pypi/{name}@{package.version}"
    record = package.read_text("RECORD")
    lines = sorted(line for line in (record or "").splitlines() if "sha256=" in line and ".dist-info/" not in line)
    digest = hashlib.sha256("\n".join(lines).encode()).hexdigest()
    row = {"type": "library", "bom-ref": purl, "name": name, "version": package.version, "purl": purl}
    found = licence(package)
    return {
        **row,
        **({"licenses": found} if found else {}),
        **({"properties": [{"name": "calstation:files-sha256", "value": digest}]} if lines else {}),
    }


def bill(artefacts: Iterable[Path] = ()) -> dict[str, Any]:
    """Return the bill of materials; `artefacts` are the files of a release."""
    packages, needs = collect()
    components = {name: component(name, package) for name, package in sorted(packages.items())}
    main = {**components.pop(ROOT), "type": "application"}
    files = [
        {
            "type": "distribution",
            "url": path.name,
            "hashes": [{"alg": "SHA-256", "content": hashlib.sha256(path.read_bytes()).hexdigest()}],
        }
        for path in sorted(artefacts)
    ]
    references = {ROOT: main["bom-ref"], **{name: row["bom-ref"] for name, row in components.items()}}
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": {**main, **({"externalReferences": files} if files else {})}},
        "components": list(components.values()),
        "dependencies": [
            {"ref": reference, "dependsOn": sorted(references[other] for other in needs[name])}
            for name, reference in references.items()
        ],
    }


def write(arguments: list[str]) -> None:
    """Write the bill of materials to the first argument; the others are the files of the release."""
    target, *artefacts = map(Path, arguments)
    try:
        document = bill(artefacts)
    except PackageNotFoundError as error:
        sys.exit(f"{error.name} is not installed; install calstation[{','.join(EXTRAS)}]")
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write(sys.argv[1:])
