"""`calstation override`, `pin` and `registers` ask for the PINs of one or two engineers."""

from pathlib import Path

import pytest
import typer

from calstation.config import access
from calstation.records import audit_path, read_audit
from tests.results.test_override import LI, WANG, failed, home

__all__ = ["failed", "home"]


@pytest.fixture
def answers(monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """Set the replies to terminal prompts, by the start of each prompt."""
    replies: dict[str, str] = {f"PIN of {person.badge}": person.pin for person in (LI, WANG)}

    def prompt(question: str, **options: object) -> str:
        assert options["hide_input"]
        assert options["err"]
        return replies[question]

    monkeypatch.setattr(typer, "prompt", prompt)
    return replies


def test_unit_is_released_by_two_engineers(
    calstation, answers: dict[str, str], failed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    alone = calstation("override", failed, "--reason", "scratch", "--by", "B0001")
    assert (alone.code, "a second engineer confirms this" in alone.err) == (2, True)
    with monkeypatch.context() as patch:
        patch.setattr(typer, "prompt", lambda *_, **__: pytest.fail("a PIN was asked"))
        same = calstation("override", failed, "--reason", "scratch", "--by", "B0001", "--confirmed-by", "B0001")
    assert (same.code, "B0001" in same.err) == (2, True)
    done = calstation("override", failed, "--reason", "scratch", "--by", "B0001", "--confirmed-by", "B0002")
    assert (done.code, done.out.strip()) == (0, f"{failed}: FAIL, released by Li Na (B0001), B0002.")
    assert "scratch" in calstation("audit", "--event", "override").out
    assert calstation("override", failed, "--reason", "again", "--by", "B0001").code == 2


def test_reason_that_contains_a_pin_is_refused(calstation, answers: dict[str, str], failed: Path) -> None:
    for person in (WANG, LI):
        people = ("--by", WANG.badge, "--confirmed-by", LI.badge)
        done = calstation("override", failed, "--reason", f"scratch {person.pin}", *people)
        assert (done.code, "The reason contains the PIN" in done.err) == (2, True)
    assert not [each for each in calstation("audit", "--json", "-").json["events"] if each["event"] == "override"]


def test_pins_are_set_and_changed(calstation, answers: dict[str, str], home: Path) -> None:
    answers |= {"The engineer's PIN of this site": "000000", "New PIN": "333333", "Current PIN": "333333"}
    done = calstation("pin", "--badge", "B0003")
    assert (done.code, "No station of this site lists badge B0003" in done.err) == (0, True)
    assert access.check("333333", "B0003")
    answers["New PIN"] = "444444"
    assert calstation("pin", "--badge", "B0003").code == 0
    assert access.check("444444", "B0003")
    assert calstation("pin").code == 2, "the present PIN of the site is another"
    assert [each.event for each in read_audit(audit_path(home)).entries][-2:] == ["pin_set", "pin_changed"]
