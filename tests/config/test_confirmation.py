"""Two engineers confirm an action, each with a badge registered at the station and a personal PIN."""

from pathlib import Path
from typing import Any

import pytest

from calstation.config import (
    Action,
    Confirmation,
    Person,
    ProductConfig,
    SignInSection,
    StationConfig,
    access,
    confirm,
    confirmation_required,
    library,
    load_product,
    load_station,
    unlisted_engineer,
)
from calstation.errors import ConfigurationError
from calstation.messages import render, sentence
from calstation.records import audit_path, read_audit
from tests.helpers import raises_code
from tests.site_folder import SiteFolder

LI, WANG, ZHAO = Person("B0001", "111111"), Person("B0002", "222222"), Person("B0003", "333333")


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A site with a site PIN and the personal PINs of two engineers."""
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path))
    access.set_pin("", "000000")
    for person in (LI, WANG):
        access.set_pin("000000", person.pin, person.badge)
    return tmp_path


def product(*actions: str) -> ProductConfig:
    shipped = load_product(library.find("products", "nav_a"))[1].model_dump(exclude_unset=True)
    return ProductConfig.model_validate({**shipped, "confirmation": {"required_for": list(actions)}})


def station(*engineers: str) -> StationConfig:
    shipped = load_station(None)[1]
    return shipped.model_copy(
        update={"sign_in": SignInSection(badge_pattern=r"B\d{4}", engineers=list(engineers))} if engineers else {}
    )


def test_two_engineers_with_their_pins_confirm() -> None:
    both = station("B0001", "B0002")
    assert confirm("override", product("override"), both, LI, WANG) == Confirmation("B0001", "B0002", "personal")
    assert confirmation_required("override", product("override"), both).second


def test_person_who_unlocked_the_engineer_role_is_identified_only_where_no_pin_is_asked_for() -> None:
    both = station("B0001", "B0002")
    li, stranger = Person("B0001", unlocked=True), Person("B0003", unlocked=True)
    assert confirm("certificate", product(), both, li) == Confirmation("B0001", pin="personal")
    assert confirm("certificate", product(), both, stranger) == Confirmation("B0003")
    assert confirm("certificate", product(), station(), li) == Confirmation("B0001")
    with raises_code(ConfigurationError, "confirmation.wrong_pin"):
        confirm("revision", product(), both, li)


@pytest.mark.parametrize(
    ("first", "second", "code"),
    [
        (LI, None, "second_missing"),
        (LI, LI, "same_person"),
        (LI, Person("B0001", "other"), "same_person"),
        (LI, Person("B0002", "111111"), "wrong_pin"),
        (Person("B0001", "222222"), WANG, "wrong_pin"),
        (LI, ZHAO, "no_pin"),
        (LI, Person("B0009", "111111"), "not_engineer"),
        (Person("wang", "000000"), WANG, "not_engineer"),
        (Person(" ", "000000"), WANG, "no_person"),
    ],
)
def test_invalid_pairs_of_people_are_refused(first: Person, second: Person | None, code: str) -> None:
    with raises_code(ConfigurationError, f"confirmation.{code}"):
        confirm("registers", product("registers"), station("B0001", "B0002", "B0003"), first, second)


def test_station_without_engineers_cannot_require_two_confirmations() -> None:
    with raises_code(ConfigurationError, "confirmation.no_engineers"):
        confirm("certificate", product("certificate"), station(), Person("wang", "000000"), Person("li", "000000"))


@pytest.mark.parametrize("action", ["override", "registers", "certificate"])
def test_two_names_with_the_site_pin_do_not_count_as_two_people(action: Any) -> None:
    with raises_code(ConfigurationError, "confirmation.no_engineers"):
        confirm(action, product(), station(), Person("wang", "000000"), Person("li", "000000"))


def test_without_required_confirmations_only_an_override_needs_a_pin() -> None:
    assert confirm("certificate", product(), station(), Person("wang")) == Confirmation("wang")
    assert confirm("registers", product("override"), station("B0001"), Person("wang")) == Confirmation("wang")
    assert confirm("override", product(), station(), Person("wang", "000000")) == Confirmation("wang", pin="site")
    with raises_code(ConfigurationError, "confirmation.wrong_pin"):
        confirm("override", product(), station(), Person("wang", "999999"))
    assert confirm("override", product(), station("B0001"), LI) == Confirmation("B0001", pin="personal")


def test_revision_requires_an_engineer_with_a_pin_where_the_station_lists_engineers() -> None:
    needed = confirmation_required("revision", product(), station("B0001"))
    assert (needed.pin, needed.badge, needed.second) == (True, True, False)
    assert confirmation_required("revision", product("certificate"), station("B0001")).second
    with raises_code(ConfigurationError, "confirmation.not_engineer"):
        confirm("revision", product(), station("B0001"), Person("Dr A. Li", "000000"))
    with raises_code(ConfigurationError, "confirmation.wrong_pin"):
        confirm("revision", product(), station("B0001"), Person("B0001"))
    assert confirm("revision", product(), station("B0001"), LI) == Confirmation("B0001", pin="personal")
    assert confirm("revision", product(), station(), Person("Li Na")) == Confirmation("Li Na")


@pytest.mark.parametrize("names", [{}, {"B0001": "Li Na"}])
def test_typed_badge_must_be_one_of_the_station(names: dict[str, str]) -> None:
    sign_in = SignInSection(badge_pattern=r"B\d{4}", names=names)
    only_badges = station().model_copy(update={"sign_in": sign_in})
    actions: tuple[Action, ...] = ("revision", "override")
    for action in actions:
        with raises_code(ConfigurationError, "confirmation.not_a_badge"):
            confirm(action, product(), only_badges, Person("Dr A. Li", "000000"))
        assert confirm(action, product(), only_badges, Person("B0001", "000000")).by == (
            "Li Na (B0001)" if names else "B0001"
        )


def test_optional_pin_confirms_the_name_or_is_refused() -> None:
    assert confirm("certificate", product(), station("B0001"), LI) == Confirmation("B0001", pin="personal")
    assert confirm("certificate", product(), station(), Person("wang", "000000")) == Confirmation("wang", pin="site")
    with raises_code(ConfigurationError, "confirmation.wrong_pin"):
        confirm("registers", product(), station("B0001"), Person("B0001", "999999"))
    with raises_code(ConfigurationError, "confirmation.not_engineer"):
        confirm("certificate", product(), station("B0001"), Person("Dr A. Example", "000000"))


def test_optional_second_person_is_verified() -> None:
    both = station("B0001", "B0002")
    assert confirm("certificate", product(), both, LI, WANG) == Confirmation("B0001", "B0002", "personal")
    with raises_code(ConfigurationError, "confirmation.wrong_pin"):
        confirm("certificate", product(), both, LI, Person("B0002", "111111"))


def test_error_after_several_wrong_pins_states_the_waiting_time() -> None:
    for code in ("confirmation.wrong_pin", "confirmation.wrong_pin", "confirmation.wrong_pin_wait"):
        with raises_code(ConfigurationError, code):
            confirm("override", product(), station("B0001"), Person("B0001", "999999"))


def test_first_badge_pin_requires_the_site_pin_and_later_ones_the_old_pin(home: Path) -> None:
    with raises_code(ConfigurationError, "access.wrong_pin"):
        access.set_pin("111111", "333333", "B0003")
    access.set_pin("111111", "444444", "B0001")
    assert access.check("444444", "B0001")
    assert not access.check("444444", "B0002")
    assert access.check("000000")
    with raises_code(ConfigurationError, "access.wrong_pin"):
        access.set_pin("000000", "555555", "B0002")
    events = read_audit(audit_path(home)).entries
    assert [(each.event, each.values.get("badge")) for each in events] == [
        ("pin_set", None), ("pin_set", "B0001"), ("pin_set", "B0002"), ("pin_changed", "B0001"),
    ]  # fmt: skip


def test_badge_pin_requires_a_site_pin_to_exist(home: Path) -> None:
    (home / "engineer.json").unlink()
    with raises_code(ConfigurationError, "access.no_site_pin"):
        access.set_pin("", "333333", "B0003")


def test_badge_is_not_used_as_a_file_path(home: Path) -> None:
    access.set_pin("000000", "333333", "../up/x")
    assert access.check("333333", "../up/x")
    assert {path.parent for path in home.rglob("*.json")} == {home, home / "engineers"}


@pytest.mark.parametrize(
    "entries",
    [{"engineers": ["X"]}, {"engineers": ["B0001"], "names": {"B0002": "Li"}}],
)
def test_engineer_must_have_a_badge_of_the_station(entries: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"badge_unlike|engineer_unnamed|badge|names"):
        SignInSection.model_validate({"badge_pattern": r"B\d{4}", **entries})


def test_pin_is_not_in_the_repr() -> None:
    assert "111111" not in repr(LI)


def test_badge_that_no_station_lists_as_engineer_is_named(site_folder: SiteFolder, home: Path) -> None:
    listing = SiteFolder(site_folder.folder, home)
    listing.write(station={"sign_in": {"badge_pattern": r"B\d{4}", "engineers": ["B0001"]}})
    (home / "stations" / "damaged.toml").write_text("name =", encoding="utf-8")
    assert unlisted_engineer("B0001") is None
    unlisted = unlisted_engineer("B9999")
    assert unlisted is not None
    assert "B9999" in sentence(unlisted)
    assert "工牌 B9999" in render(unlisted.code, unlisted.values, "zh_CN").text
