"""If the product requires two people for a certificate, every copy and export of a run requires them."""

import json
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest
import tomli_w
import typer

from calstation.cli.app import run_app
from calstation.config import ConfirmationRequired, access, site_folder
from calstation.records import audit_path, read_audit
from calstation.reports import issue_state
from calstation.sequencer import Finalized
from tests.helpers import ignore_progress
from tests.shared_runs import SharedRuns
from tests.site_folder import SiteFolder


@pytest.fixture
def result_file(shared_runs: SharedRuns, tmp_path: Path) -> Path:
    """The result of a run with its log in the same folder; its product requires a second person."""

    def make(site: SiteFolder) -> Finalized:
        site.write({"stages": ["six_position"], "confirmation": {"required_for": ["certificate"]}})
        return site.run()

    return Path(shared_runs.copy("certificate-by-two", tmp_path / "site", make).result_file)


def original(result_file: Path) -> Path:
    return result_file


def copy_of_the_result(result_file: Path) -> Path:
    """A copy under another name, whose log is found only by the stored path."""
    result = json.loads(result_file.read_text(encoding="utf-8"))
    result["log"]["file"] = str(result_file.with_suffix(".h5"))
    copy = result_file.with_name("copy.json")
    copy.write_text(json.dumps(result), encoding="utf-8")
    return copy


def exported(result_file: Path) -> Path:
    """Return an export of the log."""
    csv = result_file.with_name("export.csv")
    assert run_app(["export", str(result_file.with_suffix(".h5")), "-o", str(csv)]) == 0
    return csv


def exported_without_files(result_file: Path) -> Path:
    """Return an export without the product file but with its limits."""
    csv = exported(result_file)
    toml = csv.with_suffix(".toml")
    meta = tomllib.loads(toml.read_text(encoding="utf-8"))
    del meta["profiles"]
    toml.write_text(tomli_w.dumps(meta), encoding="utf-8")
    return csv


@pytest.mark.long
@pytest.mark.parametrize(
    ("source", "message"),
    [
        (original, "station 'test bench' names no engineers"),
        (copy_of_the_result, "station 'test bench' names no engineers"),
        (exported, "station 'test bench' names no engineers"),
        (exported_without_files, "it is unknown who may release the unit or issue its certificate"),
    ],
)
def test_every_copy_and_export_requires_the_second_person(
    result_file: Path, source: Callable[[Path], Path], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = result_file.with_name("out.pdf")
    assert run_app(["report", str(source(result_file)), "-o", str(out)]) == 2
    assert message in " ".join(capsys.readouterr().err.split())
    assert not out.exists()


@pytest.mark.long
@pytest.mark.parametrize("source", [original, copy_of_the_result, exported])
def test_window_asks_for_the_second_person_for_every_copy_and_export(
    result_file: Path, source: Callable[[Path], Path]
) -> None:
    assert issue_state(ignore_progress, source(result_file), None, "en").required.second


@pytest.mark.long
def test_recording_without_a_product_requires_no_second_person(result_file: Path) -> None:
    csv = exported_without_files(result_file)
    toml = csv.with_suffix(".toml")
    meta = tomllib.loads(toml.read_text(encoding="utf-8"))
    del meta["product"]
    toml.write_text(tomli_w.dumps(meta), encoding="utf-8")
    nobody = ConfirmationRequired(pin=False, badge=False, second=False)
    assert issue_state(ignore_progress, csv, None, "en").required == nobody
    assert run_app(["report", str(csv), "-o", str(csv.with_suffix(".pdf"))]) == 0


@pytest.mark.long
def test_people_who_print_a_certificate_again_are_recorded(
    shared_runs: SharedRuns, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def make(site: SiteFolder) -> Finalized:
        product = {"stages": ["six_position"], "confirmation": {"required_for": ["certificate"]}}
        site.write(product, {"sign_in": {"badge_pattern": r"B\d{4}|tester", "engineers": ["B0001", "B0002"]}})
        return site.run()

    result_file = shared_runs.copy("certificate-by-engineers", tmp_path / "site", make).result_file
    access.set_pin("", "000000")
    for badge, pin in (("B0001", "111111"), ("B0002", "222222")):
        access.set_pin("000000", pin, badge)
    pins = {"PIN of B0001": "111111", "PIN of B0002": "222222"}
    monkeypatch.setattr(typer, "prompt", lambda question, **_: pins[question])

    def report(name: str, *options: str) -> int:
        return run_app(["report", result_file, "-o", str(tmp_path / name), *options])

    two = ("--by", "B0001", "--confirmed-by", "B0002")
    assert report("first.pdf", *two) == 0
    assert report("zh.pdf", *two, "--language", "zh") == 0
    assert report("one.pdf", "--by", "B0002") == 0
    assert report("program.pdf", "--by", "") == 0
    printed = [e for e in read_audit(audit_path(site_folder())).entries if e.event == "certificate_printed"]
    assert [(e.by, e.confirmed_by, e.values["pin"]) for e in printed] == [
        ("B0001", "B0002", "personal"),
        ("B0002", None, "personal"),
        ("", None, None),
    ]
    pins["PIN of B0002"] = "333333"
    assert report("wrong.pdf", *two) == 2
    assert "PIN of B0002 is wrong" in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "wrong.pdf").exists()
