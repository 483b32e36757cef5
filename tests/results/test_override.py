"""A failed unit is released by name and reason; result, index and audit trail record it, and it stays FAIL."""

import json
from pathlib import Path
from typing import Any

import pytest

from calstation.config import Confirmation, Person, access, confirm, library
from calstation.errors import ConfigurationError, InputError
from calstation.messages import render
from calstation.records import RunFilter, audit_path, read_audit, restart_trail
from calstation.results import (
    History,
    is_release_recorded,
    load_confirmed_result,
    load_result,
    override_required,
    override_result,
)
from calstation.results import override as override_module
from tests.helpers import ignore_progress, raises_code
from tests.results.test_history import write

LI, WANG = Person("B0001", "111111"), Person("B0002", "222222")
NAMES = '{ B0001 = "Li Na", B0002 = "B0002" }'
SIGN_IN = f'\n[sign_in]\nbadge_pattern = "B[0-9]{{4}}"\nengineers = ["B0001", "B0002"]\nnames = {NAMES}\n'
TWO = '\n[confirmation]\nrequired_for = ["override"]\n'


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A site with two engineers, and a product that requires both for a release."""
    home = tmp_path / "home"
    monkeypatch.setenv("CALSTATION_HOME", str(home))
    shipped = library.shipped_folder()
    for kind, name, more in (("stations", "virtual_bench", SIGN_IN), ("products", "nav_a", TWO)):
        text = (shipped / kind / f"{name}.toml").read_text("utf-8")
        (home / kind).mkdir(parents=True)
        (home / kind / f"{name}.toml").write_text(text + more, encoding="utf-8")
    access.set_pin("", "000000")
    for person in (LI, WANG):
        access.set_pin("000000", person.pin, person.badge)
    return home


@pytest.fixture
def failed(home: Path, tmp_path: Path) -> Path:
    """The result of a failed run without its log."""
    runs = tmp_path / "runs"
    runs.mkdir()
    files = {kind: {"name": name, "sha256": ""} for kind, name in (("station", "virtual_bench"), ("product", "nav_a"))}
    return write(runs, "a", "SN-1", "failed", 1, configuration=files, key_of_another_version=7)


def release(path: Path, why: str = "scratched label only", first: Person = LI, second: Person | None = WANG) -> None:
    override_result(ignore_progress, path, why, first, second)


def test_release_is_recorded_in_result_index_and_audit_trail(home: Path, failed: Path) -> None:
    before = json.loads(failed.read_text("utf-8"))
    assert override_required(ignore_progress, failed).second
    release(failed)
    after = json.loads(failed.read_text("utf-8"))
    override = after.pop("override")
    assert after == before
    assert (override["by"], override["confirmed_by"], override["why"]) == (
        *("Li Na (B0001)", "B0002"),
        "scratched label only",
    )
    result = load_result(failed)
    assert (result.outcome, result.verdict, result.released) == ("failed", "failed", True)
    history = History(failed.parent)
    history.refresh()
    (run,) = history.runs(RunFilter(verdict="failed"))
    assert (run.verdict, run.released) == ("failed", True)
    assert history.failures("SN-1", run.product) == 1
    event = read_audit(audit_path(home)).entries[-1]
    assert (event.event, event.by, event.confirmed_by, event.why) == (
        "override", "Li Na (B0001)", "B0002", "scratched label only",
    )  # fmt: skip
    assert (event.values["serial"], event.values["result"]) == ("SN-1", "a.json")


def test_one_person_cannot_release_if_two_are_required(home: Path, failed: Path) -> None:
    before = failed.read_bytes()
    for second in (None, LI, Person("B0002", "wrong")):
        with pytest.raises(ConfigurationError):
            release(failed, second=second)
    assert failed.read_bytes() == before
    assert "override" not in {each.event for each in read_audit(audit_path(home)).entries}


def test_only_a_failed_run_is_released_once_with_a_reason(failed: Path) -> None:
    with raises_code(InputError, "override.no_reason"):
        release(failed, " ")
    release(failed)
    with raises_code(InputError, "override.already"):
        release(failed)
    with raises_code(InputError, "override.not_failed"):
        release(write(failed.parent, "b", "SN-2", "passed", 2))


def test_one_of_two_simultaneous_releases_is_refused(home: Path, failed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second release starts and ends while the PINs of the first are verified."""

    def meanwhile(*people: Any) -> Confirmation:
        monkeypatch.setattr(override_module, "confirm", confirm)
        release(failed, "first")
        return confirm(*people)

    monkeypatch.setattr(override_module, "confirm", meanwhile)
    with raises_code(InputError, "override.already"):
        release(failed, "second")
    override = load_result(failed).override
    assert override is not None
    assert override.why == "first"
    assert [each.why for each in read_audit(audit_path(home)).entries if each.event == "override"] == ["first"]


def test_release_on_a_changed_trail_is_refused_and_an_earlier_one_remains_known_after_a_restart(
    home: Path, failed: Path
) -> None:
    release(failed)
    trail = audit_path(home)
    content = trail.read_bytes()
    trail.write_bytes(b"".join(content.splitlines(keepends=True)[:-1]))
    other = write(
        failed.parent, "b", "SN-2", "failed", 2, configuration=json.loads(failed.read_text())["configuration"]
    )
    with raises_code(ConfigurationError, "audit.broken"):
        release(other)
    assert "override" not in json.loads(other.read_text("utf-8"))
    assert not is_release_recorded(load_result(failed))
    with raises_code(InputError, "result.release_unconfirmed") as caught:
        load_confirmed_result(failed)
    for language, forged in (("en", "remove its entry"), ("zh_CN", "删除其中的 override 项")):
        text = render(caught.value.code, caught.value.values, language)
        assert forged not in text.text + text.remedy
    trail.write_bytes(content)
    assert is_release_recorded(load_result(failed))
    restart_trail(home, "li", "exercise", None)
    assert is_release_recorded(load_result(failed))


def test_release_is_refused_without_log_and_configuration_files(failed: Path) -> None:
    other = write(failed.parent, "c", "SN-3", "failed", 3)
    with raises_code(InputError, "override.no_files"):
        release(other)
