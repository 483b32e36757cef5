"""The power of station and unit cut at every byte of a transfer: on the wire, in flash, in the journal."""

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calstation.devices.transfer import Closing, Holds, finish, recognise, restore, transfer
from calstation.errors import CalstationError
from calstation.records import checked_lines
from calstation.station import register_journal
from tests.devices.dsp import MAP, NAMES, SERIAL, Dark, Supply, Unit

pytestmark = pytest.mark.long

FIRST = dict(zip(NAMES, [1e-5, -2e-5, 3e-5, 0.01, -0.02, 0.03], strict=True))
SECOND = dict(zip(NAMES, [-4e-5, 5e-5, -6e-5, -0.04, 0.05, -0.06], strict=True))


class Station:
    """The computer's power, which is the unit's."""

    supply = Supply()


@pytest.fixture(autouse=True)
def _journal_under_power(monkeypatch: pytest.MonkeyPatch) -> None:
    write = checked_lines._write

    def write_while_powered(handle: int, data: bytes) -> None:
        given = Station.supply.take(len(data))
        write(handle, data[:given])
        if given < len(data) or Station.supply.dark:
            raise Dark

    monkeypatch.setattr(checked_lines, "_write", write_while_powered)
    # The cut is at a byte of these files, not of a real disk: nothing need wait for one.
    monkeypatch.setattr("os.fsync", lambda handle: None)


class Factory:
    """A unit, a folder of runs, and a supply for both that may break down at any byte."""

    def __init__(self, folder: Path) -> None:
        self.unit = Unit(folder / "flash.bin")
        self.runs = folder

    def begin(self, old: Mapping[str, float], new: Mapping[str, float]) -> register_journal.Transfer:
        return register_journal.begin(self.runs, SERIAL, old, new, by="wang", why="run", source="a.h5")

    def write(self, values: Mapping[str, float], budget: int | None = None) -> int:
        """A whole transfer with power for so many bytes; how many it took."""
        return self._powered(lambda imu: self._transfer(imu, values), budget)

    def mend(self, choice: str, budget: int | None = None) -> None:
        """What the next start does about an open entry."""
        entry = register_journal.interrupted(self.runs, SERIAL)
        if entry is None:
            return

        def go(imu: Any) -> None:
            if choice == "finish":
                finish(imu, MAP, entry)
                entry.close(Closing.DONE)
            else:
                restore(imu, MAP, entry)

        self._powered(go, budget)

    def _transfer(self, imu: Any, values: Mapping[str, float]) -> None:
        transfer(imu, MAP, SERIAL, values, self.begin).entry.close(Closing.DONE)

    def _powered(self, work: Any, budget: int | None) -> int:
        supply = Station.supply = Supply(budget)
        try:
            with self.unit.directly(supply) as imu:
                work(imu)
        except (Dark, CalstationError):
            if budget is None:
                raise
        Station.supply = Supply()
        return supply.spent

    def check(self, before: Mapping[str, float]) -> None:
        """What must be true after a cut anywhere."""
        entry = register_journal.interrupted(self.runs, SERIAL)
        done = [t for t in register_journal.history(self.runs, SERIAL) if t.closing == "done"]
        if entry is None:
            expected = done[-1].new if done else before
            assert self.unit.flash == rounded(expected)
        else:
            with self.unit.directly(Supply()) as imu:
                assert recognise(imu, entry) in (Holds.OLD, Holds.NEW)
        assert register_journal.cycles(self.runs, SERIAL) >= self.unit.cycles


def rounded(values: Mapping[str, float]) -> dict[str, float]:
    return MAP.rounded(values)


def test_the_power_cut_at_every_byte(tmp_path: Path) -> None:
    start = tmp_path / "start"
    start.mkdir()
    Factory(start).write(FIRST)
    whole = Factory(_copy(start, "whole"))
    length = whole.write(SECOND)
    assert whole.unit.flash == rounded(SECOND)
    assert whole.unit.cycles == register_journal.cycles(whole.runs, SERIAL) == 2
    seen = set()
    for cut in range(length):
        factory = Factory(_copy(start, str(cut)))
        factory.write(SECOND, cut)
        factory.check(FIRST)
        entry = register_journal.interrupted(factory.runs, SERIAL)
        choice = "finish" if cut % 2 else "restore"
        seen.add((choice, entry is not None))
        factory.mend(choice)
        assert register_journal.interrupted(factory.runs, SERIAL) is None
        if entry is not None:
            assert factory.unit.flash == rounded(SECOND if choice == "finish" else FIRST)
    assert seen == {("finish", True), ("finish", False), ("restore", True), ("restore", False)}


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    first=st.integers(0, 2500),
    further=st.lists(st.tuples(st.sampled_from(["finish", "restore"]), st.integers(0, 1500)), max_size=4),
    last=st.sampled_from(["finish", "restore"]),
)
def test_the_power_cut_again_and_again_while_it_is_mended(
    tmp_path_factory: pytest.TempPathFactory, first: int, further: list[tuple[str, int]], last: str
) -> None:
    factory = Factory(tmp_path_factory.mktemp("cuts"))
    factory.write(FIRST)
    factory.write(SECOND, first)
    for choice, budget in further:
        factory.check(FIRST)
        factory.mend(choice, budget)
    factory.check(FIRST)
    factory.mend(last)
    assert register_journal.interrupted(factory.runs, SERIAL) is None
    assert factory.unit.flash in (rounded(FIRST), rounded(SECOND))
    factory.check(FIRST)


def _copy(start: Path, name: str) -> Path:
    return shutil.copytree(start, start.with_name(name))
