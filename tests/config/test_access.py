"""The engineer's PIN is set, verified and changed, never stored in plain text; wrong PINs cause growing delays."""

import hashlib
import json
import stat
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from calstation.config import Confirmation, access, computer_user
from calstation.errors import ConfigurationError
from calstation.records import audit_path, read_audit
from tests.helpers import raises_code

#: Cost recommended by OWASP; the fixtures of other tests reduce it.
COST = (2**15, 8, 3)


class Clock:
    """A wall clock that the test sets."""

    def __init__(self) -> None:
        self.now = 1.8e9

    def time(self) -> float:
        return self.now


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "site"
    monkeypatch.setenv("CALSTATION_HOME", str(folder))
    return folder


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(access, "time", clock)
    return clock


def test_only_the_pin_that_was_set_is_accepted() -> None:
    assert not access.has_pin()
    assert not access.check("246813")
    access.set_pin("", "246813")
    assert access.has_pin()
    assert access.check("246813")
    assert not access.check("135792")
    assert not access.check("")
    assert access.check("246813")


def test_changing_a_pin_requires_the_current_pin(home: Path) -> None:
    access.set_pin("", "246813")
    with raises_code(ConfigurationError, "access.wrong_pin"):
        access.set_pin("000000", "135792")
    access.set_pin("246813", "ключ 密码")
    assert access.check("ключ 密码")
    assert not access.check("246813")
    trail = {"audit.jsonl", ".audit.lock", "station.key", "station.head"}
    assert {path.name for path in home.iterdir()} == {"engineer.json", ".pin.lock", *trail}


def test_a_short_pin_is_refused() -> None:
    with raises_code(ConfigurationError, "access.pin_too_short"):
        access.set_pin("", "12345")
    assert not access.has_pin()


def test_pin_of_an_earlier_version_keeps_its_hash_cost_until_changed(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A PIN of an earlier version may have four characters."""
    monkeypatch.setattr(access, "_N", COST[0])
    digest = hashlib.scrypt(b"2468", salt=bytes(16), n=2**13, r=8, p=1, dklen=32)
    stored = {"salt": bytes(16).hex(), "hash": digest.hex(), "n": 2**13, "r": 8, "p": 1}
    home.mkdir(exist_ok=True)
    (home / "engineer.json").write_text(json.dumps(stored), encoding="utf-8")
    assert access.check("2468")
    assert not access.check("2469")
    access.set_pin("2468", "246813")
    changed = json.loads((home / "engineer.json").read_text("utf-8"))
    assert (changed["n"], changed["r"], changed["p"]) == COST
    assert access.check("246813")


def test_pins_are_stored_as_salted_hashes(home: Path) -> None:
    access.set_pin("", "24682468")
    first = (home / "engineer.json").read_text("utf-8")
    assert "24682468" not in first
    access.set_pin("24682468", "24682468")
    assert first != (home / "engineer.json").read_text("utf-8")
    if sys.platform != "win32":
        assert stat.S_IMODE((home / "engineer.json").stat().st_mode) == 0o600


def test_delays_grow_with_wrong_pins_and_survive_a_restart(clock: Clock) -> None:
    access.set_pin("", "246813")
    delays = []
    for _ in range(14):
        assert not access.check("000000")
        delays.append(access.wait())
        clock.now += access.wait()
    assert delays[:6] == [0.0, 0.0, 1.0, 2.0, 4.0, 8.0]
    assert delays[-1] == 300.0
    assert access.check("246813")
    assert access.wait() == 0.0


def test_no_pin_is_accepted_during_the_delay(clock: Clock) -> None:
    access.set_pin("", "246813")
    for _ in range(3):
        access.check("000000")
    assert access.wait() == 1.0
    assert not access.check("246813")
    with raises_code(ConfigurationError, "access.wrong_pin_wait") as caught:
        access.set_pin("246813", "135792")
    assert caught.value.values == {"seconds": 1.0}
    clock.now += 1.0
    assert access.check("246813")


def test_simultaneous_wrong_pins_all_count(home: Path, clock: Clock) -> None:
    access.set_pin("", "246813")
    with ThreadPoolExecutor(8) as pool:
        assert not any(pool.map(access.check, [f"{number:04d}" for number in range(16)]))
    assert json.loads((home / "engineer.json").read_text("utf-8"))["failures"] == 3
    assert access.wait() == 1.0


def test_pin_is_not_set_if_the_audit_trail_is_unwritable(home: Path) -> None:
    access.set_pin("", "246813")
    (home / "audit.jsonl").rename(home / "kept")
    (home / "audit.jsonl").mkdir()
    with raises_code(ConfigurationError, "audit.unwritable"):
        access.set_pin("246813", "135792")
    assert access.check("246813")
    (home / "audit.jsonl").rmdir()
    (home / "kept").rename(home / "audit.jsonl")
    assert [each.event for each in read_audit(audit_path(home)).entries] == ["pin_set"]


def test_clock_set_back_causes_a_single_delay(clock: Clock) -> None:
    access.set_pin("", "246813")
    for _ in range(3):
        access.check("000000")
    clock.now -= 1e7
    assert access.wait() == 1.0


@pytest.mark.parametrize("text", ["", "{", '{"salt": "x"}'])
def test_damaged_pin_file_is_reported(home: Path, text: str) -> None:
    access.set_pin("", "246813")
    (home / "engineer.json").write_text(text, encoding="utf-8")
    assert access.has_pin()
    with pytest.raises(ConfigurationError, match=r"engineer\.json"):
        access.check("246813")
    with pytest.raises(ConfigurationError, match=r"engineer\.json"):
        access.set_pin("246813", "135792")


@pytest.mark.parametrize(
    ("author", "by", "proved"),
    [
        (None, computer_user(), False),
        (Confirmation("Anna Quality"), "Anna Quality", False),
        (Confirmation("Li Na (B0001)", pin="personal"), "Li Na (B0001)", True),
    ],
    ids=["user of the computer", "typed name", "personal PIN"],
)
def test_audit_trail_says_whether_a_pin_proved_who_set_a_pin(
    home: Path, author: Confirmation | None, by: str, proved: bool
) -> None:
    access.set_pin("", "000000", author=author)
    access.set_pin("000000", "111111", author=author)
    events = read_audit(audit_path(home)).entries
    assert [(each.event, each.by, each.unproven) for each in events] == [
        ("pin_set", by, not proved),
        ("pin_changed", by, not proved),
    ]
