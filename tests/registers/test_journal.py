"""The register journal is on disk before a call returns, and is used only if it reads back undamaged."""

import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calstation.config import load_configuration
from calstation.devices.imu import TransferOutcome, TransferStep
from calstation.errors import ConfigurationError
from calstation.messages import sentence
from calstation.records import ChainedFile
from calstation.registers import journal, run_registers
from calstation.results import SCHEMA, Result
from tests.helpers import raises_code
from tests.site_folder import SiteFolder

NEW_OF_RUN = {"gyro_bias_x": 1.0}
OLD, NEW = {"gyro_bias_x": 1e-6, "gyro_bias_y": float("nan")}, {"gyro_bias_x": 2e-6, "gyro_bias_y": -0.0}


def begin(runs: Path, serial: str = "SN-1") -> journal.Transfer:
    return journal.begin(runs, serial, OLD, NEW, journal.Purpose("wang", "run", "a.h5"))


def test_transfer_is_read_back_bit_identical(tmp_path: Path) -> None:
    made = begin(tmp_path)
    for step in (TransferStep.WRITTEN, TransferStep.COMMITTING):
        made.note(step)
    (transfer,) = journal.history(tmp_path, "SN-1")
    assert repr(transfer) == repr(made)
    assert (transfer.by, transfer.why, transfer.source) == ("wang", "run", "a.h5")
    assert transfer.cycles == journal.cycles(tmp_path, "SN-1") == 1
    assert repr(journal.interrupted(tmp_path, "SN-1")) == repr(transfer)
    transfer.close(TransferOutcome.DONE)
    assert journal.interrupted(tmp_path, "SN-1") is None


def test_every_line_is_on_disk_when_it_is_acknowledged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[int] = []
    fsync = os.fsync

    def watch(handle: int) -> None:
        fsync(handle)
        synced.append(os.fstat(handle).st_size)

    monkeypatch.setattr(os, "fsync", watch)
    made = begin(tmp_path)
    assert made.path.stat().st_size in synced
    made.note(TransferStep.COMMITTING)
    assert synced[-1] == made.path.stat().st_size


def test_a_journal_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    path = begin(tmp_path).path
    path.unlink()
    path.mkdir()
    with raises_code(ConfigurationError, "journal.unreadable"):
        journal.interrupted(tmp_path, "SN-1")


def test_units_never_share_a_journal(tmp_path: Path) -> None:
    names = ["SN-1", "SN/1", "SN%2F1", "../SN", "Ж 1"]
    for name in names:
        begin(tmp_path, name)
    assert journal.serials(tmp_path) == sorted(names)
    for name in names:
        assert [t.serial for t in journal.history(tmp_path, name)] == [name]
    assert all(path.parent == tmp_path / journal.FOLDER for path in tmp_path.rglob("*.jsonl"))


def test_only_the_latest_entry_can_be_open(tmp_path: Path) -> None:
    begin(tmp_path)
    second = begin(tmp_path)
    transfer = journal.interrupted(tmp_path, "SN-1")
    assert transfer is not None
    assert transfer.id == second.id
    second.close(TransferOutcome.KEPT)
    assert journal.interrupted(tmp_path, "SN-1") is None


def test_an_unwritable_journal_is_reported_with_a_remedy(tmp_path: Path) -> None:
    (tmp_path / journal.FOLDER).write_text("in the way", encoding="utf-8")
    with pytest.raises(ConfigurationError) as refused:
        begin(tmp_path)
    assert refused.value.code in ("journal.unreadable", "journal.unwritable")


def begun(runs: Path) -> journal.Transfer:
    """Return a transfer that reached its commit."""
    made = begin(runs)
    for step in (TransferStep.WRITTEN, TransferStep.COMMITTING):
        made.note(step)
    return made


def error_text(runs: Path) -> str:
    """Return the error for a damaged journal, "" for a valid one; all readers agree."""
    messages = set()
    for ask in (journal.history, journal.interrupted, journal.cycles):
        try:
            ask(runs, "SN-1")
        except ConfigurationError as error:
            messages.add(str(error))
        else:
            messages.add("")
    (words,) = messages
    return words


@pytest.mark.parametrize("stride", [11, pytest.param(1, marks=pytest.mark.exhaustive)])
def test_every_wrong_byte_is_detected(tmp_path: Path, stride: int) -> None:
    made = begun(tmp_path)
    whole = made.path.read_bytes()
    for position in range(0, len(whole), stride):
        for wrong in {whole[position] ^ 1, whole[position] ^ 128, 0, ord("\n")} - {whole[position]}:
            made.path.write_bytes(whole[:position] + bytes([wrong]) + whole[position + 1 :])
            line = whole[:position].count(b"\n") + 1
            lines = tuple(f"Data: {made.path}, line {number}: " for number in (line, line + 1))
            assert error_text(tmp_path).startswith(lines), (position, wrong)


@pytest.mark.parametrize(
    ("order", "line"),
    [((0, 2), 2), ((0, 1, 1, 2), 3), ((0, 2, 1), 2), ((1, 2), 1), ((0, 1, 2, 2), 4)],
    ids=["missing", "doubled", "exchanged", "first missing", "last doubled"],
)
def test_reordered_lines_are_detected(tmp_path: Path, order: tuple[int, ...], line: int) -> None:
    made = begun(tmp_path)
    lines = made.path.read_bytes().splitlines(keepends=True)
    assert len(lines) == 3
    made.path.write_bytes(b"".join(lines[i] for i in order))
    assert error_text(tmp_path).startswith(f"Data: {made.path}, line {line}: ")


Damage = Callable[[bytes], bytes]


@pytest.mark.parametrize(
    ("damage", "line"),
    [
        pytest.param(lambda data: b"", 1, id="emptied"),
        pytest.param(lambda data: bytes(len(data)), 1, id="zeroed"),
        pytest.param(lambda data: data[data.index(b"\n") + 1 :], 1, id="without its intention"),
        pytest.param(lambda data: data + b"[" * 100_000 + b"\n", 4, id="deep"),
        pytest.param(lambda data: data + data, 4, id="twice"),
        pytest.param(lambda data: data[:40], 1, id="a torn intention"),
    ],
)
def test_damaged_journal_blocks_its_unit_with_file_line_and_remedy(tmp_path: Path, damage: Damage, line: int) -> None:
    path = begun(tmp_path).path
    path.write_bytes(damage(path.read_bytes()))
    words = error_text(tmp_path)
    assert words.startswith(f"Data: {path}, line {line}: ")
    assert "Compare the unit's registers with those of its last result" in words
    assert "\n" not in words
    with raises_code(ConfigurationError, "journal.damaged"):
        begin(tmp_path)
    path.rename(tmp_path / "away")
    assert journal.interrupted(tmp_path, "SN-1") is None


@pytest.mark.parametrize(
    "content",
    [
        {"event": "closed"},
        {"event": "closed", "closing": "perhaps"},
        {"event": "step", "step": "thought about"},
        {"event": "closed", "closing": "done", "id": "another"},
        {
            "event": "intended",
            "serial": "SN-1",
            "by": None,
            "why": "run",
            "source": "",
            "unit_type": {},
            "old": {},
            "new": {"a": "1e400"},
        },
        {"event": "forgotten"},
        {},
    ],
)
def test_unknown_journal_line_blocks_the_unit(tmp_path: Path, content: dict[str, object]) -> None:
    made = begun(tmp_path)
    ChainedFile[dict[str, object]](made.path, dict).append({"id": made.id, "utc": "", **content})
    assert error_text(tmp_path).startswith(
        f"Data: {made.path}, line 4: the content of the line is unknown to this program"
    )


@pytest.mark.long
def test_a_truncated_last_line_is_ignored_and_reported(tmp_path: Path) -> None:
    made = begun(tmp_path)
    whole = made.path.read_bytes()
    last = whole.rindex(b"\n", 0, -1) + 1
    for cut in range(last + 1, len(whole) - 1):
        for tail in (b"", bytes(30)):  # a file system may have allocated space that it did not fill
            made.path.write_bytes(whole[:cut] + tail)
            assert error_text(tmp_path) == ""
            assert journal.truncated(tmp_path, "SN-1") == made.path
            assert journal.cycles(tmp_path, "SN-1") == 0
    made.path.write_bytes(whole[:-1])
    assert journal.truncated(tmp_path, "SN-1") is None
    assert journal.cycles(tmp_path, "SN-1") == 1, "only its end is missing"


@given(cut=st.integers(0, 10_000))
def test_a_journal_is_continued_after_a_power_cut(tmp_path_factory: pytest.TempPathFactory, cut: int) -> None:
    runs = tmp_path_factory.mktemp("journal")
    first = begun(runs)
    content = first.path.read_bytes()
    least = content.index(b"\n") + 1  # the file is created with its first line
    first.path.write_bytes(content[: least + cut % (len(content) - least)])
    later = begin(runs)
    later.note(TransferStep.WRITTEN)
    transfer = journal.interrupted(runs, "SN-1")
    assert transfer is not None
    assert (transfer.id, transfer.steps) == (later.id, ["written"])
    assert [t.id for t in journal.history(runs, "SN-1")] == [first.id, later.id]


def test_unit_on_hardware_has_one_journal_for_all_runs_folders(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, site_folder: SiteFolder
) -> None:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "site"))
    virtual = load_configuration(site_folder.request()).station
    hardware = virtual.model_copy(update={"bench": None})
    monday, tuesday = tmp_path / "monday", tmp_path / "tuesday"
    made = begin(journal.journal_folder(hardware, monday))
    made.note(TransferStep.COMMITTING)
    assert journal.journal_folder(hardware, tuesday) == tmp_path / "site"
    transfer = journal.interrupted(journal.journal_folder(hardware, tuesday), "SN-1")
    assert transfer is not None
    assert (transfer.id, transfer.cycles) == (made.id, 1)
    assert journal.serials(tmp_path / "site") == ["SN-1"]
    assert journal.history(journal.journal_folder(virtual, monday), "SN-1") == [], "a virtual unit of the same number"


def test_damaged_line_after_an_incomplete_line_is_named_by_its_number(tmp_path: Path) -> None:
    made = begin(tmp_path)
    whole = made.path.read_bytes()
    made.path.write_bytes(whole + whole[:20])  # a power failure during the second line
    made.note(TransferStep.WRITTEN)
    file = ChainedFile[object](made.path, object)
    file.append({"event": "step", "id": "unknown", "step": "written", "utc": "2026-01-01T00:00:00+00:00"})
    with raises_code(ConfigurationError, "journal.damaged") as raised:
        journal.history(tmp_path, "SN-1")
    assert raised.value.values["line"] == 4


def write(
    runs: Path, new: dict[str, float], source: str, closing: TransferOutcome | None = TransferOutcome.DONE
) -> journal.Transfer:
    """Record a complete transfer; one by hand unless it is of the run ``a.h5``."""
    why = "run" if source == "a.h5" else "hand"
    made = journal.begin(runs, "SN-1", {"gyro_bias_x": 0.0}, new, journal.Purpose("wang", why, source))
    made.note(TransferStep.COMMITTING)
    if closing is not None:
        made.close(closing)
    return made


def state(runs: Path, *, verified: bool = True, new: dict[str, float] | None = NEW_OF_RUN) -> str:
    """Return the statement about the registers of the run ``a.h5``, without times; "" if it wrote none."""
    found = run_registers(result_of_run(verified=verified, new=new), runs)
    return "" if found is None else ", ".join(re.sub(r" \d{4}-[^,]*", "", sentence(text)) for text in found.texts)


def result_of_run(*, verified: bool = True, new: dict[str, float] | None = NEW_OF_RUN) -> Result:
    """Return the result of the run ``a.h5``."""
    written = {"verified": True, "written_utc": "2026-11-21T15:04:00+00:00"} if verified else {}
    result = {
        "schema": SCHEMA,
        "unit": {"serial": "SN-1"},
        "stages": [],
        "parameters": {},
        "outcome": "passed",
        "log": {"file": "/gone/a.h5"},
        "registers": {"new": new, **written},
    }
    return Result.from_json(result)


def test_time_of_a_replacement_is_that_of_the_first_transfer_of_other_values(tmp_path: Path) -> None:
    run = write(tmp_path, NEW_OF_RUN, "a.h5")
    write(tmp_path, {"gyro_bias_x": 2.0}, "b.h5")
    write(tmp_path, NEW_OF_RUN, "back")
    other = write(tmp_path, {"gyro_bias_x": 3.0}, "c.h5")
    latest = write(tmp_path, {"gyro_bias_x": 4.0}, "d.h5")
    found = run_registers(result_of_run(), tmp_path)
    assert found is not None
    assert found.transfer is not None
    assert found.later is not None
    assert (found.transfer.id, found.later.id) == (run.id, other.id)
    assert latest.id > other.id


def test_journal_says_whether_the_registers_of_a_run_are_still_in_the_unit(tmp_path: Path) -> None:
    assert state(tmp_path) == "registers written", "without a journal, as the result states"
    write(tmp_path, {"gyro_bias_x": 1.0}, "a.h5")
    assert state(tmp_path) == "registers written"
    write(tmp_path, {"gyro_bias_x": 2.0}, "b.h5", TransferOutcome.RESTORED)
    journal.begin(tmp_path, "SN-1", OLD, NEW, journal.Purpose("wang", "hand", "c.h5")).close(TransferOutcome.KEPT)
    assert state(tmp_path) == "registers written", "the later transfers were reverted"
    write(tmp_path, {"gyro_bias_x": 2.0}, "b.h5")
    assert state(tmp_path) == "registers written, replaced by other values"
    write(tmp_path, {"gyro_bias_x": 1.0}, "a.h5 by hand")
    assert state(tmp_path) == "registers written", "they are in the unit again"
    made = write(tmp_path, {"gyro_bias_x": 3.0}, "d.h5", None)
    assert state(tmp_path) == "registers written, replaced by other values, NOT verified"
    made.close(TransferOutcome.DONE)
    assert state(tmp_path) == "registers written, replaced by other values"


def test_registers_that_a_run_did_not_verify_are_stated_until_the_transfer_ends(tmp_path: Path) -> None:
    assert state(tmp_path, verified=False) == "registers written, NOT verified"
    made = write(tmp_path, {"gyro_bias_x": 1.0}, "a.h5", None)
    assert state(tmp_path, verified=False) == "registers written, NOT verified"
    made.close(TransferOutcome.DONE)
    assert state(tmp_path, verified=False) == "registers written, verified after the run"
    made.close(TransferOutcome.RESTORED)
    assert state(tmp_path, verified=False) == "old registers restored after the run"


def test_interruption_during_the_transfer_is_stated_although_the_result_has_no_new_registers(tmp_path: Path) -> None:
    assert state(tmp_path, verified=False, new=None) == ""
    made = write(tmp_path, NEW_OF_RUN, "a.h5", None)
    assert state(tmp_path, verified=False, new=None) == "writing the registers was interrupted"
    made.close(TransferOutcome.RESTORED)
    assert state(tmp_path, verified=False, new=None) == ""
