"""The engineer's PIN: set, checked, changed, never plain, slower with every wrong one."""

import stat
import sys
from pathlib import Path

import pytest

from calstation.config import access as role
from calstation.errors import ConfigurationError
from tests.helpers import raises_code


class Watch:
    """A wall clock that the test turns."""

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
def watch(monkeypatch: pytest.MonkeyPatch) -> Watch:
    clock = Watch()
    monkeypatch.setattr(role, "time", clock)
    return clock


def test_the_first_pin_is_set_and_only_it_opens() -> None:
    assert not role.has_pin()
    assert not role.check("2468")
    role.set_pin("", "2468")
    assert role.has_pin()
    assert role.check("2468")
    assert not role.check("1357")
    assert not role.check("")
    assert role.check("2468")


def test_a_pin_is_changed_only_by_who_knows_it(home: Path) -> None:
    role.set_pin("", "2468")
    with raises_code(ConfigurationError, "access.wrong_pin"):
        role.set_pin("0000", "1357")
    role.set_pin("2468", "ключ 密码")
    assert role.check("ключ 密码")
    assert not role.check("2468")
    assert [path.name for path in home.iterdir()] == ["engineer.json"]


def test_a_short_pin_is_refused() -> None:
    with raises_code(ConfigurationError, "access.pin_too_short"):
        role.set_pin("", "123")
    assert not role.has_pin()


def test_the_pin_is_nowhere_plain_and_equal_pins_differ(home: Path) -> None:
    role.set_pin("", "24682468")
    first = (home / "engineer.json").read_text("utf-8")
    assert "24682468" not in first
    role.set_pin("24682468", "24682468")
    assert first != (home / "engineer.json").read_text("utf-8")
    if sys.platform != "win32":
        assert stat.S_IMODE((home / "engineer.json").stat().st_mode) == 0o600


def test_wrong_pins_are_answered_ever_later_also_by_a_new_program(watch: Watch) -> None:
    role.set_pin("", "2468")
    delays = []
    for _ in range(14):
        assert not role.check("0000")
        delays.append(role.wait())
        watch.now += role.wait()
    assert delays[:6] == [0.0, 0.0, 1.0, 2.0, 4.0, 8.0]
    assert delays[-1] == 300.0
    assert role.check("2468")
    assert role.wait() == 0.0


def test_while_waiting_the_right_pin_is_not_taken_and_does_not_count(watch: Watch) -> None:
    role.set_pin("", "2468")
    for _ in range(3):
        role.check("0000")
    assert role.wait() == 1.0
    assert not role.check("2468")
    with raises_code(ConfigurationError, "access.wrong_pin_wait") as caught:
        role.set_pin("2468", "1357")
    assert caught.value.values == {"seconds": 1.0}
    watch.now += 1.0
    assert role.check("2468")


def test_a_clock_put_back_costs_one_delay(watch: Watch) -> None:
    role.set_pin("", "2468")
    for _ in range(3):
        role.check("0000")
    watch.now -= 1e7
    assert role.wait() == 1.0


@pytest.mark.parametrize("text", ["", "{", '{"salt": "x"}'])
def test_a_damaged_file_opens_nothing_and_says_so(home: Path, text: str) -> None:
    role.set_pin("", "2468")
    (home / "engineer.json").write_text(text, encoding="utf-8")
    assert role.has_pin()
    with pytest.raises(ConfigurationError, match=r"engineer\.json"):
        role.check("2468")
    with pytest.raises(ConfigurationError, match=r"engineer\.json"):
        role.set_pin("2468", "1357")
