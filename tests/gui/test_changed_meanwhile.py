"""Files that another program or window changes while the Station page has unsaved changes to them."""

from pathlib import Path
from typing import Any

import pytest
from PySide6.QtWidgets import QLabel
from pytestqt.qtbot import QtBot

from calstation.config import library, versions
from calstation.gui.settings.drafts import Drafts
from calstation.gui.state import AppContext
from calstation.gui.state.engine_link import EngineLink
from calstation.gui.text import language
from calstation.records import audit_path, read_audit
from tests.gui.station_driver import PIN, PageDriver, station_page

PROFILES = 9
SHIPPED = library.shipped_folder() / "stations" / "example_hardware.toml"


@pytest.fixture
def page_driver(app: AppContext, site_folder: Any, qtbot: QtBot) -> PageDriver:
    """The page below its header, in the role of an engineer."""
    driver = station_page(app, site_folder, qtbot, PageDriver)
    driver.app.role.set_first_pin(PIN)
    return driver


def notice(driver: PageDriver) -> str:
    return "\n".join(label.text() for label in driver.page.notice.findChildren(QLabel))


def replace(file: Path, old: str, new: str) -> None:
    """Change a file as an editor does."""
    text = file.read_text("utf-8")
    assert old in text
    file.write_text(text.replace(old, new), "utf-8")


@pytest.mark.parametrize(
    ("code", "words"), [("en", "was changed by another program or window"), ("zh_CN", "被其他程序或窗口改动")]
)
def test_change_of_another_program_is_not_overwritten(
    page_driver: PageDriver, site_folder: Any, code: str, words: str
) -> None:
    language.use(code)
    page_driver.type("name_edit", "line 7")
    replace(site_folder.station, "34.25", "12.5")
    page_driver.press("save_station_button")
    assert words in notice(page_driver)
    assert "12.5" in site_folder.station.read_text("utf-8")
    assert "line 7" not in site_folder.station.read_text("utf-8")
    assert page_driver.page.drafts.station.value(("name",)) == "line 7", "the unsaved entry is kept"
    assert "file_saved" not in [each.event for each in read_audit(audit_path(site_folder.home)).entries]

    page_driver.press("stay_button")
    page_driver.press("save_station_button")
    page_driver.press("read_again_button")
    assert not page_driver.page.notice.asking
    assert page_driver.page.drafts.station.value(("site", "latitude_deg")) == 12.5
    page_driver.type("name_edit", "line 8")
    page_driver.press("save_station_button")
    text = site_folder.station.read_text("utf-8")
    assert "line 8" in text
    assert "12.5" in text
    events = read_audit(audit_path(site_folder.home)).entries
    assert list(next(each for each in events if each.event == "file_saved").values["changed"]) == ["name"]
    language.use("en")


def test_shipped_product_that_another_window_saved_is_neither_overwritten_nor_copied(
    page_driver: PageDriver, site_folder: Any
) -> None:
    page_driver.show_section(PROFILES)
    profiles = page_driver.page.profiles
    profiles.open("products", "nav_a")
    draft = page_driver.page.profiles._draft
    assert draft is not None
    own = site_folder.home / "products" / f"{draft.name}.toml"
    own.unlink(missing_ok=True)
    draft.discard()
    other = draft.saved + "# of another window\n"
    profiles.editor.setPlainText(draft.saved + "# mine\n")
    versions.save("products", draft.name, other, "wang")
    page_driver.press("save_station_button")
    assert own.read_text("utf-8") == other
    assert f"{draft.name}-2" not in library.names("products")
    page_driver.press("read_again_button")
    assert profiles.editor.toPlainText() == other
    profiles.editor.setPlainText(other + "# mine\n")
    page_driver.press("save_station_button")
    assert own.read_text("utf-8") == other + "# mine\n"


def test_nothing_is_saved_if_one_of_the_files_was_changed(page_driver: PageDriver, site_folder: Any) -> None:
    page_driver.show_section(PROFILES)
    page_driver.page.profiles.open("products", "short")
    editor = page_driver.page.profiles.editor
    editor.setPlainText(editor.toPlainText() + "# mine\n")
    page_driver.show_section(0)
    page_driver.type("name_edit", "line 7")
    replace(site_folder.station, "34.25", "12.5")
    page_driver.press("save_station_button")
    assert "# mine" not in site_folder.product.read_text("utf-8")
    page_driver.press("read_again_button")
    assert [draft.name for draft in page_driver.page.drafts.dirty] == ["short"], "only the changed file is read again"


def test_unsaved_changes_that_another_draft_adopts_are_those_of_the_opened_text(
    page_driver: PageDriver, site_folder: Any
) -> None:
    drafts = Drafts(lambda: page_driver.app.author)
    draft = drafts.open_draft("stations", site_folder.station)
    draft.set({("name",): "line 7"})
    replace(site_folder.station, "34.25", "12.5")
    drafts.switch(drafts.station, site_folder.station)
    assert [each.text for each in drafts.outdated] == [draft.text]


def test_removed_file_is_saved_again_and_an_unreadable_one_is_replaced(
    page_driver: PageDriver, site_folder: Any
) -> None:
    page_driver.type("name_edit", "line 7")
    site_folder.station.unlink()
    page_driver.press("save_station_button")
    text = site_folder.station.read_text("utf-8")
    assert "line 7" in text
    site_folder.station.write_bytes(b"\xff\xfe")
    versions.save("stations", "test", text, "wang", opened="")
    assert site_folder.station.read_text("utf-8") == text


def saved_by_another_window(driver: PageDriver) -> Path:
    """Save the shipped station in the site's folder as another window does, and return the site's file."""
    versions.save(SHIPPED.parent.name, SHIPPED.stem, driver.page.drafts.station.saved + "# of another window\n", "wang")
    return library.find("stations", SHIPPED.stem)


def show_again(driver: PageDriver) -> None:
    driver.root.hide()
    driver.root.show()


def test_site_copy_of_the_shipped_station_is_used_when_the_page_shows_it(page_driver: PageDriver) -> None:
    page_driver.app.set_station(SHIPPED)
    own = saved_by_another_window(page_driver)
    show_again(page_driver)
    assert page_driver.app.station_path == page_driver.page.drafts.station.path == own
    page_driver.type("name_edit", "line 7")
    show_again(page_driver)
    assert page_driver.page.drafts.station.value(("name",)) == "line 7"

    table = page_driver.page.drafts.table
    table.rewrite(table.text + "# mine\n")
    page_driver.press("save_station_button")
    text = own.read_text("utf-8")
    assert "line 7" in text
    assert "# of another window" in text
    assert "example_hardware-2" not in library.names("stations")


def test_station_edited_before_another_window_saved_it_is_kept_and_not_copied(page_driver: PageDriver) -> None:
    page_driver.app.set_station(SHIPPED)
    page_driver.type("name_edit", "line 7")
    own = saved_by_another_window(page_driver)
    page_driver.app.set_station(own)
    assert page_driver.page.drafts.station.value(("name",)) == "line 7"
    page_driver.press("save_station_button")
    assert "line 7" not in own.read_text("utf-8")
    assert "example_hardware-2" not in library.names("stations")
    page_driver.press("read_again_button")
    assert page_driver.app.station_path == page_driver.page.drafts.station.path == own


@pytest.mark.parametrize("leave", [False, True])
def test_discard_uses_the_file_that_the_page_then_shows(page_driver: PageDriver, leave: bool) -> None:
    page_driver.app.set_station(SHIPPED)
    page_driver.type("name_edit", "line 7")
    own = saved_by_another_window(page_driver)
    if leave:
        assert not page_driver.page.may_leave(lambda: None)
    page_driver.press("discard_and_go_button" if leave else "discard_station_button")
    assert page_driver.app.station_path == page_driver.page.drafts.station.path == own


def test_running_station_keeps_its_file_until_the_run_has_ended(
    page_driver: PageDriver, monkeypatch: pytest.MonkeyPatch
) -> None:
    page_driver.app.set_station(SHIPPED)
    own = saved_by_another_window(page_driver)
    with monkeypatch.context() as running:
        running.setattr(EngineLink, "running", property(lambda _: True))
        show_again(page_driver)
        page_driver.type("name_edit", "line 7")
        page_driver.press("discard_station_button")
        assert page_driver.app.station_path == page_driver.page.drafts.station.path == SHIPPED
    show_again(page_driver)
    assert page_driver.app.station_path == page_driver.page.drafts.station.path == own


def test_site_copy_of_the_current_product_is_used_when_the_page_reads_it(page_driver: PageDriver) -> None:
    shipped = library.find("products", "nav_a")
    page_driver.app.set_product(shipped)
    page_driver.show_section(PROFILES)
    page_driver.page.profiles.open("products", "nav_a")
    versions.save("products", "nav_a", shipped.read_text("utf-8") + "# of another window\n", "wang")
    changed: list[Path | None] = []
    page_driver.app.product_changed.connect(lambda: changed.append(page_driver.app.product_path))
    show_again(page_driver)
    own = library.find("products", "nav_a")
    assert own != shipped
    assert page_driver.app.product_path == own
    assert changed == [own]
