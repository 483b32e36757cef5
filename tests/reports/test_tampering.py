"""Any change of a certificate, of the record of reports or of the audit trail is found, and stops the issue."""

import json
import random
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import pytest
from pypdf import PdfReader

from calstation.cli.app import run_app
from calstation.config import site_folder
from calstation.database.exchange import Exchange
from calstation.errors import InputError
from calstation.records import (
    ChainedFile,
    append_audit,
    audit_path,
    find_heads,
    read_reports,
    restart_trail,
    verify_trail,
)
from calstation.records.evidence.station_key import head_file
from calstation.records.run_index import FILE
from calstation.reports import verify_certificate, verify_reports
from calstation.reports.source import load_source
from calstation.results import History, load_run_result
from tests.helpers import ignore_progress
from tests.reports.certificates import make
from tests.shared_runs import SharedRuns

#: Number of bytes of a file that are changed, one after another.
_TRIALS = 60


@pytest.fixture(scope="module")
def issued(shared_runs: SharedRuns, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a site with two issued certificates of a run, the second a revision."""
    folder = tmp_path_factory.mktemp("issued")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CALSTATION_HOME", str(folder / "home"))
        made = make(shared_runs, folder / "site", "gimbal")
        result = json.loads(made.result_file.read_text(encoding="utf-8"))
        runs = folder / "runs"
        runs.mkdir()
        shutil.copy(made.result_file.with_suffix(".h5"), runs / "run.h5")
        result["log"]["file"] = "run.h5"
        (runs / "run.json").write_text(json.dumps(result), encoding="utf-8")
        report = ["report", str(runs / "run.h5")]
        assert run_app([*report, "-o", str(folder / "first.pdf"), "--dcc", str(folder / "first.xml")]) == 0
        assert run_app([*report, "-o", str(folder / "r1.pdf"), "--revise", "Wrong customer"]) == 0
    return folder


@pytest.fixture
def site(issued: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The only copy of `issued`, under its own path, which the audit trail contains; it is restored afterwards."""
    monkeypatch.setenv("CALSTATION_HOME", str(issued / "home"))
    backup = tmp_path / "backup"
    shutil.copytree(issued, backup)
    yield issued
    shutil.rmtree(issued)
    shutil.copytree(backup, issued)


@pytest.mark.long
def test_intact_evidence_is_confirmed(site: Path) -> None:
    for name in ("first.pdf", "first.xml", "r1.pdf"):
        state = verify_certificate(site / name)
        codes = [each.code for each in state.findings]
        assert (state.intact, codes[0]) == (True, "audit.file_recorded")
        assert calstation("check", site / name) == 0
    # the first certificate precedes the first line of the trail
    assert [find_heads((site / name).read_bytes()) == [] for name in ("first.pdf", "r1.pdf")] == [True, False]
    assert verify_reports(site / "runs").intact
    assert calstation("check", site / "runs" / "reports.jsonl") == 0


@pytest.mark.parametrize("name", ["first", "r1"])
def test_digital_certificate_extracted_from_its_pdf_is_confirmed(site: Path, name: str) -> None:
    """The second certificate was issued without a separate digital certificate."""
    attached = PdfReader(site / f"{name}.pdf").attachments
    ((file, (content,)),) = ((file, parts) for file, parts in attached.items() if file.endswith(".xml"))
    path = site / file
    path.write_bytes(content)
    state = verify_certificate(path)
    assert (state.intact, state.findings[0].code) == (True, "audit.file_recorded")
    path.write_bytes(content.replace(b"SN-", b"SM-", 1))
    assert not verify_certificate(path).intact


@pytest.mark.parametrize("name", ["r1.pdf", "first.xml"])
def test_change_of_a_byte_of_a_certificate_is_found(site: Path, name: str) -> None:
    path = site / name
    content = path.read_bytes()
    for i in range(0, len(content), len(content) // _TRIALS):
        changed = bytearray(content)
        changed[i] ^= 1
        path.write_bytes(bytes(changed))
        assert not verify_certificate(path).intact
    assert calstation("check", path) == 2


@pytest.mark.parametrize("name", ["audit.jsonl", "reports.jsonl"])
def test_change_of_a_byte_of_trail_or_reports_is_found(site: Path, name: str) -> None:
    path = site / "runs" / name if name == "reports.jsonl" else audit_path(site_folder())
    content = path.read_bytes()
    for i in [*range(0, len(content), len(content) // _TRIALS), len(content) - 2]:
        path.write_bytes(_flipped(content, i))
        found = verify_trail(site_folder()).faults if name == "audit.jsonl" else not verify_reports(path.parent).intact
        assert found, i


def test_damaged_record_of_reports_is_not_said_to_lack_certificates(site: Path) -> None:
    path = site / "runs" / "reports.jsonl"
    content = path.read_bytes()
    path.write_bytes(_flipped(content, content.index(b'"issued"') + 4))
    codes = [each.code for each in verify_reports(path.parent).findings]
    assert "report.record_damaged" in codes
    assert "report.not_in_record" not in codes


def _flipped(content: bytes, i: int) -> bytes:
    return content[:i] + bytes([content[i] ^ 1]) + content[i + 1 :]


def _places(log: Path) -> dict[str, list[int]]:
    """Return the positions of the bytes of each dataset of a log, and of the rest of the file."""
    places: dict[str, list[int]] = {}
    with h5py.File(log) as file:
        for name, data in file.items():
            chunks = [data.id.get_chunk_info(i) for i in range(data.id.get_num_chunks())] if data.chunks else []
            parts = [(each.byte_offset, each.size) for each in chunks] or [(data.id.get_offset(), data.nbytes)]
            places[name] = [k for start, size in parts for k in range(start, start + size)][: data.nbytes]
    used = {k for part in places.values() for k in part}
    return {**places, "structure": [k for k in range(log.stat().st_size) if k not in used]}


#: Parts of a log of which every byte is covered. No value and no verdict depends on events, except the registers as
#: found, on the outcome in the closing record, or on the path of the log in its result; the structure of the file also
#: has unused bytes.
COVERED = ("samples", "meta", "stages")


@pytest.mark.parametrize("part", [*COVERED, "results", "closing", "events", "structure"])
def test_change_of_a_byte_of_a_log_is_found_or_changes_no_evidence(site: Path, part: str) -> None:
    log, result = site / "runs" / "run.h5", site / "runs" / "run.json"
    content, places = log.read_bytes(), _places(log)[part]
    original = _evidence(log, result)
    for i in random.Random(34).sample(places, min(12, len(places))):
        log.write_bytes(_flipped(content, i))
        try:
            evidence = _evidence(log, result)
        except InputError:
            continue
        assert part not in COVERED, i
        assert evidence == original, i


def _evidence(log: Path, result: Path) -> tuple[object, ...]:
    """Return what a certificate is made from. Raises InputError if a change is found."""
    source, contents = load_source(ignore_progress, result)
    facts = contents.facts()
    if facts.damaged:
        raise InputError("log.altered", file=log)
    return source.to_json(), facts, contents.meta


def test_a_changed_index_is_believed_by_history_only(site: Path) -> None:
    """Labels, `apply` and certificates read result and log, from which the index is made again."""
    runs = site / "runs"
    History(runs).refresh()
    with sqlite3.connect(runs / FILE) as connection:
        connection.execute("UPDATE runs SET verdict='failed', content=replace(content, '\"passed\"', '\"failed\"')")
    connection.close()
    history = History(runs)
    history.refresh()
    assert [run.verdict for run in history.runs()] == ["failed"]
    assert (load_run_result(runs / "run.json").verdict, verify_reports(runs).intact) == ("passed", True)
    (runs / FILE).unlink()
    History(runs).refresh()
    assert [run.verdict for run in History(runs).runs()] == ["passed"]


def test_reports_that_were_moved_away_are_put_back(site: Path) -> None:
    reports = site / "runs" / "reports.jsonl"
    report = ["report", site / "runs" / "run.h5", "-o", site / "r2.pdf", "--revise", "Once more"]
    reports.rename(site / "reports_2026.jsonl")
    assert calstation(*report) == 2
    (site / "reports_2026.jsonl").rename(reports)
    assert calstation(*report) == 0


def calstation(*arguments: object) -> int:
    return run_app([*map(str, arguments)])


def contents(runs: Path) -> list[bytes | None]:
    """Return the contents of the audit trail and of the record of reports."""
    paths = (audit_path(site_folder()), runs / "reports.jsonl")
    return [path.read_bytes() if path.exists() else None for path in paths]


def _cut(path: Path) -> None:
    path.write_bytes(b"".join(path.read_bytes().splitlines(keepends=True)[:-1]))


def _forge(path: Path, **changes: object) -> None:
    """Append a copy of the last line with changes and a correct chain."""
    last = json.loads(path.read_bytes().splitlines()[-1])
    content = {name: value for name, value in last.items() if name not in ("previous", "digest")}
    ChainedFile[object](path, object).append({**content, **changes})


def _edit(path: Path, old: bytes, new: bytes) -> None:
    content = path.read_bytes()
    assert old in content
    path.write_bytes(content.replace(old, new))


#: What somebody who can write the files, but not read the key, does to trail or reports.
TAMPERING: dict[str, Callable[[Path], object]] = {
    "trail cut": lambda runs: _cut(audit_path(site_folder())),
    "trail removed": lambda runs: audit_path(site_folder()).unlink(),
    "trail forged": lambda runs: _forge(audit_path(site_folder()), by="somebody"),
    "trail edited": lambda runs: _edit(audit_path(site_folder()), b"Wrong customer", b"Wrong weather "),
    "reports cut by two": lambda runs: (_cut(runs / "reports.jsonl"), _cut(runs / "reports.jsonl")),
    "reports removed": lambda runs: (runs / "reports.jsonl").unlink(),
    "reports forged": lambda runs: _forge(runs / "reports.jsonl", revision=2),
    "reports forged without key": lambda runs: _forge(runs / "reports.jsonl", key=None, signature=None),
    "reports edited": lambda runs: _edit(runs / "reports.jsonl", b"Wrong customer", b"Wrong weather "),
}


@pytest.mark.parametrize("kind", TAMPERING)
def test_nothing_is_issued_after_a_change_until_the_trail_is_restarted(
    site: Path, kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = site / "runs"
    TAMPERING[kind](runs)
    assert not verify_reports(runs).intact
    before = [
        path.read_bytes() if path.exists() else None for path in (audit_path(site_folder()), runs / "reports.jsonl")
    ]
    assert calstation("report", runs / "run.h5", "-o", site / "r2.pdf", "--revise", "Once more") == 2
    assert not (site / "r2.pdf").exists()
    assert "calstation audit --restart" in " ".join(capsys.readouterr().err.split())
    after = [
        path.read_bytes() if path.exists() else None for path in (audit_path(site_folder()), runs / "reports.jsonl")
    ]
    assert before == after


@pytest.mark.long
def test_numbers_continue_after_reports_were_removed_and_the_trail_restarted(site: Path) -> None:
    runs = site / "runs"
    (runs / "reports.jsonl").unlink()
    restart_trail(site_folder(), "li", "restored without reports", None)
    assert calstation("report", runs / "run.h5", "-o", site / "r2.pdf", "--revise", "Once more") == 0
    assert [each.revision for each in read_reports(runs)] == [2]
    assert verify_reports(runs).intact
    assert verify_certificate(site / "r1.pdf").intact, "the former trail is named by the new one"


def test_report_missing_after_the_end_of_the_program_is_completed(site: Path) -> None:
    runs = site / "runs"
    lines = (runs / "reports.jsonl").read_bytes()
    _cut(runs / "reports.jsonl")
    assert calstation("report", runs / "run.h5", "-o", site / "r2.pdf", "--revise", "Once more") == 0
    assert (runs / "reports.jsonl").read_bytes().startswith(lines)


def test_trail_of_a_removed_site_contradicts_its_certificates(site: Path) -> None:
    """Without the key, trail and head of a site, its certificates and reports are what remains."""
    shutil.rmtree(site_folder())
    state = verify_certificate(site / "r1.pdf")
    assert not state.intact
    assert "audit.other_trail" in [each.code for each in state.findings]
    assert "report.of_unknown" in [each.code for each in verify_reports(site / "runs").findings]


def test_heads_in_the_shared_database_reveal_a_cut_with_the_station_s_own_key(
    site: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whoever can read the key can sign a shorter trail, but not change what other stations have received."""
    runs, url = site / "runs", f"sqlite:///{site / 'shared.sqlite'}"
    before = {path: path.read_bytes() for path in (audit_path(site_folder()), head_file(site_folder()))}
    append_audit(site_folder(), "override", "li", "to be hidden")
    for folder in (runs, site / "other"):
        folder.mkdir(exist_ok=True)
        exchange = Exchange(folder, url, "line 1")
        exchange.exchange()
        exchange.close()
        assert verify_reports(folder).intact
    for path, content in before.items():
        path.write_bytes(content)
    for _ in range(3):
        append_audit(site_folder(), "override", "li", "harmless")
    assert not verify_trail(site_folder()).faults, "all that the site has itself agrees"
    assert calstation("check") == 2, "the folder that the trail names has heads in the database"
    for folder in (runs, site / "other"):
        assert "audit.contradicts_database" in [each.code for each in verify_reports(folder).findings]
        assert calstation("check", folder) == 2
    assert calstation("report", runs / "run.h5", "-o", site / "r2.pdf", "--revise", "Once more") == 2
    assert "which the shared database has" in " ".join(capsys.readouterr().err.split())
    exchange = Exchange(runs, url, "line 1")
    exchange.exchange()  # the database still has both heads
    exchange.close()
    assert not verify_reports(runs).intact
