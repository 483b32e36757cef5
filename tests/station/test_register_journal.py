"""The journal of a unit's registers: on disk before it returns, readable whatever tore or spoilt it."""

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calstation.devices.transfer import Closing, Step
from calstation.errors import ConfigurationError
from calstation.station import register_journal as journal

OLD, NEW = {"gyro_bias_x": 1e-6, "gyro_bias_y": float("nan")}, {"gyro_bias_x": 2e-6, "gyro_bias_y": -0.0}


def begin(runs: Path, serial: str = "SN-1") -> journal.Transfer:
    return journal.begin(runs, serial, OLD, NEW, by="wang", why="run", source="a.h5")


def test_a_transfer_is_read_back_with_every_bit(tmp_path: Path) -> None:
    made = begin(tmp_path)
    for step in (Step.WRITTEN, Step.COMMITTING):
        made.note(step)
    (found,) = journal.history(tmp_path, "SN-1")
    assert repr(found) == repr(made)
    assert (found.by, found.why, found.source) == ("wang", "run", "a.h5")
    assert found.cycles == journal.cycles(tmp_path, "SN-1") == 1
    assert repr(journal.interrupted(tmp_path, "SN-1")) == repr(found)
    found.close(Closing.DONE)
    assert journal.interrupted(tmp_path, "SN-1") is None


def test_every_line_is_on_disk_when_it_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[int] = []
    fsync = os.fsync

    def watch(handle: int) -> None:
        fsync(handle)
        synced.append(os.fstat(handle).st_size)

    monkeypatch.setattr(os, "fsync", watch)
    made = begin(tmp_path)
    assert made.path.stat().st_size in synced
    made.note(Step.COMMITTING)
    assert synced[-1] == made.path.stat().st_size


def test_units_do_not_share_a_journal_whatever_their_numbers(tmp_path: Path) -> None:
    names = ["SN-1", "SN/1", "SN%2F1", "../SN", "Ж 1"]
    for name in names:
        begin(tmp_path, name)
    assert journal.serials(tmp_path) == sorted(names)
    for name in names:
        assert [t.serial for t in journal.history(tmp_path, name)] == [name]
    assert all(path.parent == tmp_path / journal.FOLDER for path in tmp_path.rglob("*.jsonl"))


def test_the_latest_intention_is_the_one_that_may_be_open(tmp_path: Path) -> None:
    begin(tmp_path)
    second = begin(tmp_path)
    found = journal.interrupted(tmp_path, "SN-1")
    assert found is not None
    assert found.id == second.id
    second.close(Closing.KEPT)
    assert journal.interrupted(tmp_path, "SN-1") is None


def test_a_journal_that_cannot_be_written_says_so_and_what_to_do(tmp_path: Path) -> None:
    (tmp_path / journal.FOLDER).write_text("in the way", encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"register journal cannot be written.*make room"):
        begin(tmp_path)


@given(data=st.binary(max_size=200), cut=st.integers(0, 400))
def test_what_a_cut_or_a_stranger_left_is_passed_over(
    tmp_path_factory: pytest.TempPathFactory, data: bytes, cut: int
) -> None:
    runs = tmp_path_factory.mktemp("journal")
    first = begin(runs)
    content = first.path.read_bytes()
    first.path.write_bytes(content[:cut] + data)
    journal.history(runs, "SN-1")
    later = begin(runs)
    later.note(Step.WRITTEN)
    found = journal.interrupted(runs, "SN-1")
    assert found is not None
    assert (found.id, found.steps) == (later.id, ["written"])
