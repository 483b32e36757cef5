"""The bill of materials names every package that calstation needs, with its version, and is the same every time."""

import hashlib
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest
from make_sbom import EXTRAS, bill
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]


def test_every_package_is_named_with_its_version() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    texts = [*project["dependencies"], *(t for extra in EXTRAS for t in project["optional-dependencies"][extra])]
    requirements = [r for r in map(Requirement, texts) if r.marker is None or r.marker.evaluate()]
    named = {row["name"]: row["version"] for row in bill()["components"]}
    for requirement in requirements:
        name = canonicalize_name(requirement.name)
        assert named[name] == version(name)
        assert requirement.specifier.contains(named[name]), name
    assert {"pydantic-core", "cryptography", "click"} <= named.keys(), "what these packages need themselves"
    assert not {"ruff", "mypy"} & named.keys(), "tools of development are not delivered"


def test_references_are_unique_and_resolve() -> None:
    document = bill()
    references = [document["metadata"]["component"]["bom-ref"], *(row["bom-ref"] for row in document["components"])]
    assert len(set(references)) == len(references)
    assert [row["ref"] for row in document["dependencies"]] == references
    assert {other for row in document["dependencies"] for other in row["dependsOn"]} <= set(references)


def test_the_same_installation_gives_the_same_bill_with_the_hashes_of_a_release(tmp_path: Path) -> None:
    wheel = tmp_path / "calstation-0.1.0-py3-none-any.whl"
    wheel.write_bytes(b"wheel")
    document = bill([wheel])
    assert document == bill([wheel])
    (reference,) = document["metadata"]["component"]["externalReferences"]
    assert reference["url"] == wheel.name
    assert reference["hashes"] == [{"alg": "SHA-256", "content": hashlib.sha256(b"wheel").hexdigest()}]


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("make_sbom.needed", lambda *_: {"no-such-package": set()})
    with pytest.raises(Exception, match="no-such-package"):
        bill()
