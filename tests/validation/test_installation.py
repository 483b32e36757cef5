"""An altered file and another version of a package are found in an installation."""

import base64
import hashlib
from importlib.metadata import Distribution
from pathlib import Path

import pytest

from calstation.validation.installation import ROOT, Package, _package_lines, identity, installation_lines, packages
from calstation.validation.lines import Line

METADATA = "Metadata-Version: 2.4\nName: {name}\nVersion: {version}\nRequires-Python: >=3.11\n{more}"


def install(folder: Path, name: str, version: str, more: str = "", **files: str) -> None:
    """Write a package with its record of hashes."""
    rows = []
    for module, content in files.items():
        path = folder / name / f"{module}.py"
        path.parent.mkdir(exist_ok=True)
        path.write_text(content, encoding="utf-8")
        digest = base64.urlsafe_b64encode(hashlib.sha256(content.encode()).digest()).rstrip(b"=").decode()
        rows.append(f"{name}/{module}.py,sha256={digest},{len(content)}")
    info = folder / f"{name}-{version}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(METADATA.format(name=name, version=version, more=more), encoding="utf-8")
    (info / "RECORD").write_text("\n".join(rows) + "\n", encoding="utf-8")


@pytest.fixture
def site_packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An installation of a program and one package, which Python finds first."""
    extras = "Provides-Extra: part\nRequires-Dist: wanting~=1.0; extra == 'part'\n"
    install(tmp_path, ROOT, "9.9", f"Requires-Dist: needed~=2.1\n{extras}", some="x = 1\n")
    install(tmp_path, "needed", "2.1.4", more="Requires-Dist: deeper\n", one="y = 1\n", two="z = 1\n")
    install(tmp_path, "deeper", "1", one="y = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("calstation.validation.installation._loaded_elsewhere", lambda package: None)
    monkeypatch.delenv("PYTHONPATH", raising=False)
    return tmp_path


def lines() -> dict[str, Line]:
    return {line.subject or line.check: line for line in installation_lines(lambda: None)}


def test_an_unchanged_installation_is_in_order_and_names_what_is_not_installed(site_packages: Path) -> None:
    found = lines()
    assert {name: line.state for name, line in found.items()} == {
        **dict.fromkeys(("python", "system", "variables", ROOT, "needed", "deeper"), "ok"), "part": "not_checked",
    }  # fmt: skip
    assert found["part"].reason is not None
    assert "wanting" in str(found["part"].reason)
    assert identity()["needed"] == "2.1.4"
    assert identity()[ROOT] == f"9.9 ({packages()[ROOT].digest[:16]})"


def test_an_installed_package_of_an_incomplete_part_is_checked(site_packages: Path) -> None:
    metadata = site_packages / f"{ROOT}-9.9.dist-info" / "METADATA"
    more = "Requires-Dist: present; extra == 'part'\n"
    metadata.write_text(metadata.read_text(encoding="utf-8") + more, encoding="utf-8")
    install(site_packages, "present", "1", one="y = 1\n")
    assert (lines()["present"].state, lines()["part"].state) == ("ok", "not_checked")
    (site_packages / "present" / "one.py").write_text("y = 2\n", encoding="utf-8")
    assert lines()["present"].state == "failed"


@pytest.mark.parametrize("content", ["y = 2\n", None], ids=["altered", "removed"])
def test_a_changed_file_of_a_package_is_found(site_packages: Path, content: str | None) -> None:
    file = site_packages / "needed" / "one.py"
    file.unlink() if content is None else file.write_text(content, encoding="utf-8")
    line = lines()["needed"]
    assert line.state == "failed"
    assert "needed/one.py" in str(line.found)


def test_an_added_file_of_the_program_is_found_but_not_its_compiled_copy(site_packages: Path) -> None:
    (site_packages / ROOT / "__pycache__").mkdir()
    (site_packages / ROOT / "__pycache__" / "some.cpython-311.pyc").write_bytes(b"")
    assert lines()[ROOT].state == "ok"
    (site_packages / ROOT / "other.toml").write_text("", encoding="utf-8")
    assert "other.toml" in str(lines()[ROOT].found)


def test_another_version_than_required_is_found(site_packages: Path) -> None:
    (site_packages / "needed-2.1.4.dist-info" / "METADATA").write_text(
        METADATA.format(name="needed", version="3.0", more=""), encoding="utf-8"
    )
    line = lines()["needed"]
    assert (line.state, str(packages()["needed"].required)) == ("failed", "~=2.1")
    assert "3.0" in str(line.found)


def test_a_missing_package_is_found(site_packages: Path) -> None:
    (site_packages / "deeper-1.dist-info" / "METADATA").unlink()
    (site_packages / "deeper-1.dist-info" / "RECORD").unlink()
    (site_packages / "deeper-1.dist-info").rmdir()
    assert lines()["deeper"].state == "failed"


def test_a_folder_of_sources_is_not_taken_for_an_installation(site_packages: Path) -> None:
    text = '{"dir_info": {"editable": true}, "url": "file:///src"}'
    (site_packages / f"{ROOT}-9.9.dist-info" / "direct_url.json").write_text(text, encoding="utf-8")
    line = lines()[ROOT]
    assert (line.state, line.required) == ("not_checked", True)


def test_a_variable_that_replaces_packages_is_found(site_packages: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", "/elsewhere")
    assert lines()["variables"].state == "failed"


def test_modules_loaded_from_elsewhere_are_found(tmp_path: Path) -> None:
    install(tmp_path, "numpy", "2.4.6", __init__="")
    (line,) = _package_lines("numpy", Package(Distribution.at(tmp_path / "numpy-2.4.6.dist-info")))
    assert (line.state, line.required) == ("not_checked", True)
    assert "numpy" in str(line.reason)
