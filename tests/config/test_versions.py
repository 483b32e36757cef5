"""Changes to site files are validated, written atomically, numbered, and can be restored."""

import hashlib
from pathlib import Path

import pytest

from calstation.config import library, versions
from calstation.errors import ConfigurationError
from calstation.records import audit_path, files, read_audit
from tests.helpers import raises_code

SHIPPED = (library.shipped_folder() / "products" / "nav_a.toml").read_text("utf-8")
CHANGED = SHIPPED.replace("turns = 2", "turns = 3")


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path))
    return tmp_path


def test_change_creates_a_site_file_and_keeps_the_shipped_file(home: Path) -> None:
    version = versions.save("products", "nav_a", CHANGED, "wang")
    assert library.find("products", "nav_a") == home / "products" / "nav_a.toml"
    assert (home / "products" / "nav_a.toml").read_text("utf-8") == CHANGED
    assert (version.number, version.author) == (2, "wang")
    assert version.sha256 == hashlib.sha256(CHANGED.encode()).hexdigest()
    assert [v.number for v in versions.list_versions("products", "nav_a")] == [2, 1]
    assert versions.list_versions("products", "nav_a")[1].author is None
    assert versions.text("products", "nav_a", 1) == SHIPPED
    assert versions.version_number("products", "nav_a", CHANGED) == 2
    assert versions.version_number("products", "nav_a", CHANGED + "\n") is None


def test_unchanged_text_creates_no_new_version() -> None:
    first = versions.save("products", "nav_a", CHANGED, "wang")
    assert versions.save("products", "nav_a", CHANGED, "li") == first
    assert len(versions.list_versions("products", "nav_a")) == 2


def test_audit_trail_says_which_entries_changed(home: Path) -> None:
    versions.save("products", "nav_a", CHANGED, "wang")
    (home / "products" / "nav_a.toml").write_text(CHANGED.replace("turns = 3", "turns = 9"), encoding="utf-8")
    versions.save("products", "nav_a", SHIPPED, "li")
    changes = [event.values["changed"] for event in read_audit(audit_path(home)).entries]
    assert changes == [
        {"schedule.rate.turns": [2, 3]},
        {"schedule.rate.turns": [3, 9]},
        {"schedule.rate.turns": [9, 2]},
    ]


def test_entries_of_lists_of_tables_are_numbered_and_added_ones_have_no_old_value() -> None:
    before, after = 'a = [1]\n[[i]]\nn = "T"\n', 'a = [1, 2]\n[[i]]\nn = "T"\nd = 2026-01-02\n[[i]]\nn = "U"\n'
    assert versions.changed_entries(before, after) == {
        "a": [[1], [1, 2]], "i.1.d": [None, "2026-01-02"], "i.2.n": [None, "U"],
    }  # fmt: skip


def test_file_that_was_changed_after_it_was_opened_is_not_overwritten(home: Path) -> None:
    versions.save("products", "nav_a", CHANGED, "wang", opened=SHIPPED)
    other = SHIPPED.replace("turns = 2", "turns = 4")
    with raises_code(ConfigurationError, "versions.changed_meanwhile"):
        versions.save("products", "nav_a", other, "li", opened=SHIPPED)
    assert (home / "products" / "nav_a.toml").read_text("utf-8") == CHANGED
    assert len(versions.list_versions("products", "nav_a")) == 2
    versions.save("products", "nav_a", other, "li", opened=CHANGED)


def test_restoring_a_version_creates_a_new_one(home: Path) -> None:
    versions.save("products", "nav_a", CHANGED, "wang")
    version = versions.restore("products", "nav_a", 1, "li")
    assert (version.number, version.author) == (3, "li")
    assert (home / "products" / "nav_a.toml").read_text("utf-8") == SHIPPED


def test_externally_edited_file_is_saved_as_a_version(home: Path) -> None:
    versions.save("products", "nav_a", CHANGED, "wang")
    by_hand = SHIPPED.replace("turns = 2", "turns = 4")
    (home / "products" / "nav_a.toml").write_text(by_hand, encoding="utf-8")
    versions.save("products", "nav_a", SHIPPED, "li")
    assert [(v.number, v.author) for v in versions.list_versions("products", "nav_a")] == [
        (4, "li"), (3, None), (2, "wang"), (1, None),
    ]  # fmt: skip
    assert versions.text("products", "nav_a", 3) == by_hand


def test_file_that_differs_from_its_last_version_in_the_trail_is_found(home: Path) -> None:
    def outside() -> list[str]:
        return versions.changed_outside(read_audit(audit_path(home)).entries)

    file = home / "products" / "nav_a.toml"
    for turns in (3, 4):
        versions.save("products", "nav_a", SHIPPED.replace("turns = 2", f"turns = {turns}"), "wang")
    assert outside() == []
    for text in (SHIPPED.replace("turns = 2", "turns = 5"), CHANGED):  # a new text, and that of an earlier version
        file.write_text(text, encoding="utf-8")
        assert outside() == ["products/nav_a.toml"]
    versions.save("products", "nav_a", SHIPPED.replace("turns = 2", "turns = 6"), "wang")
    assert outside() == []
    file.unlink()
    assert outside() == ["products/nav_a.toml"]


def test_file_that_another_program_created_is_recorded_before_the_first_save(home: Path) -> None:
    file = home / "products" / "by_hand.toml"
    file.parent.mkdir()
    file.write_text(SHIPPED, encoding="utf-8")
    versions.save("products", "by_hand", CHANGED, "wang")
    entries = read_audit(audit_path(home)).entries
    assert [each.event for each in entries] == ["file_changed_outside", "file_saved"]
    assert entries[0].values["sha256"] == versions.sha256(SHIPPED)
    assert versions.text("products", "by_hand", 1) == SHIPPED


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (SHIPPED.replace("turns = 2", "turns = 0"), r"line 19: schedule\.rate\.turns: 0 is out of range"),
        (SHIPPED.replace('imu = "bench_nav"', 'imu = "other"'), "no IMU profile “other”"),
        (SHIPPED.replace("name =", "name", 1), "not valid TOML"),
    ],
)
def test_invalid_text_changes_nothing(home: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        versions.save("products", "nav_a", text, "wang")
    assert list(home.iterdir()) == []
    assert library.find("products", "nav_a").parent.parent == library.shipped_folder()


@pytest.mark.parametrize("name", ["../x", "a/b", "", ".hidden"])
def test_name_cannot_refer_to_another_folder(name: str) -> None:
    with raises_code(ConfigurationError, "configuration.bad_name"):
        versions.save("products", name, SHIPPED, "wang")


def test_saving_under_a_new_name_creates_a_product() -> None:
    assert versions.save("products", "nav_b", SHIPPED, "wang").number == 1
    assert "nav_b" in library.names("products")


def test_a_failed_write_leaves_the_file_unchanged(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    versions.save("products", "nav_a", CHANGED, "wang")

    def full(path: Path, *_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(versions, "write_atomic", full)
    with raises_code(ConfigurationError, "configuration.unwritable"):
        versions.save("products", "nav_a", SHIPPED, "wang")
    monkeypatch.setattr(versions, "write_atomic", files.write_atomic)
    assert (home / "products" / "nav_a.toml").read_text("utf-8") == CHANGED
    assert versions.save("products", "nav_a", SHIPPED, "wang").number == 3


def test_tampered_version_is_not_restored(home: Path) -> None:
    versions.save("products", "nav_a", CHANGED, "wang")
    (home / "versions" / "products" / "nav_a" / "0001.toml").write_text(CHANGED, encoding="utf-8")
    with raises_code(ConfigurationError, "versions.changed"):
        versions.restore("products", "nav_a", 1, "li")


def test_no_file_is_changed_if_the_audit_trail_is_unwritable(home: Path) -> None:
    (home / "audit.jsonl").mkdir(parents=True)
    with raises_code(ConfigurationError, "audit.unwritable"):
        versions.save("products", "nav_a", CHANGED, "wang")
    assert not (home / "products").exists()
    assert [version.author for version in versions.list_versions("products", "nav_a")] == [None]
