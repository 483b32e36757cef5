"""Station and product entries for a production line: badges, shifts, labels and pictures."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from calstation.config import (
    SignInSection,
    computer_user,
    editing,
    library,
    load_product,
    versions,
)
from calstation.errors import ConfigurationError
from calstation.runs import run_summary
from tests.prepared import prepare_run
from tests.site_folder import BENCH, PRODUCT, STATION, SiteFolder

BADGES = {"badge_pattern": r"B\d{4}"}
NAMES = {"B1234": "Li Na"}


def use_station(site_folder: SiteFolder, **entries: Any) -> None:
    site = {**STATION["site"], "gravity_mps2": 9.79547}
    text = tomli_w.dumps({**STATION, "site": site, "bench": BENCH, **entries})
    site_folder.station.write_text(text, encoding="utf-8")


def operator(site_folder: SiteFolder, given: str | None) -> str | None:
    """Return the operator stored with a run that is requested with `operator`."""
    return prepare_run(replace(site_folder.request(), operator=given)).request.operator


def test_without_sign_in_the_operator_is_optional(site_folder: SiteFolder) -> None:
    assert operator(site_folder, "Li Na") == "Li Na"
    assert operator(site_folder, None) == computer_user()


def test_with_sign_in_only_a_registered_badge_is_accepted(site_folder: SiteFolder) -> None:
    use_station(site_folder, sign_in=BADGES)
    assert operator(site_folder, "B5678") == "B5678"
    use_station(site_folder, sign_in={**BADGES, "names": NAMES})
    assert operator(site_folder, "B1234") == "Li Na"
    for given in ("B5678", "Li Na", computer_user()):
        with pytest.raises(ConfigurationError, match="is not a badge of this station"):
            operator(site_folder, given)
    for given in (None, ""):
        with pytest.raises(ConfigurationError, match=r"signs in with a badge\. Give the badge with --operator"):
            operator(site_folder, given)
    assert run_summary(site_folder.request()).sign_in == SignInSection(**BADGES, names=NAMES)


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"sign_in": {"badge_pattern": "["}}, "sign_in.badge_pattern: “\\[” is not a regular expression"),
        ({"sign_in": {**BADGES, "names": {"X1": "Li"}}}, "sign_in.names.X1: The badge “X1” does not match"),
        ({"sign_in": {**BADGES, "idle_minutes": 0.0}}, "sign_in.idle_minutes"),
        ({"shift_starts": ["6:00"]}, "shift_starts\\[1\\]: '6:00' does not match"),
        ({"shift_starts": ["24:00"]}, "shift_starts\\[1\\]"),
        ({"shift_starts": []}, "shift_starts"),
        ({"label": {"printer": "192.168.1.40"}}, "label.printer: “192.168.1.40” is not an address. Write tcp://host"),
    ],
    ids=str,
)
def test_invalid_sign_in_entries_of_a_station_are_refused(
    site_folder: SiteFolder, entries: dict[str, Any], message: str
) -> None:
    use_station(site_folder, **entries)
    with pytest.raises(ConfigurationError, match=message):
        prepare_run(site_folder.request())


@pytest.mark.parametrize("entry", ["picture", "label"])
def test_file_named_in_a_product_must_exist(site_folder: SiteFolder, entry: str) -> None:
    name = {"picture": "fixture.png", "label": "small.zpl"}[entry]
    site_folder.write({entry: name})
    message = f"{entry}: There is no file “{name}” next to the product file"
    with pytest.raises(ConfigurationError, match=message):
        load_product(site_folder.product)
    text = site_folder.product.read_text(encoding="utf-8")
    (problem,) = editing.check("products", text, site_folder.product)
    assert message in problem.text
    (site_folder.folder / name).write_bytes(b"")
    load_product(site_folder.product)
    assert editing.check("products", text, site_folder.product) == []
    site_folder.write({entry: f"../{name}"})
    with pytest.raises(ConfigurationError, match="does not match the pattern"):
        load_product(site_folder.product)


def test_copy_of_a_shipped_product_uses_the_shipped_or_its_own_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path))
    shipped = library.find("products", "nav_a")
    for name in ("nav_a", "nav_b"):  # changed under its own name and under another name
        versions.save("products", name, shipped.read_text(encoding="utf-8") + "\n# own\n", "li")
        path, product = load_product(library.find("products", name))
        assert path.is_relative_to(tmp_path)
        assert product.picture is not None
        assert library.find_beside(path, product.picture) == shipped.parent / "unit_on_table.svg"
    own = tmp_path / "products" / "unit_on_table.svg"
    own.write_bytes((shipped.parent / "unit_on_table.svg").read_bytes())
    assert library.find_beside(tmp_path / "products" / "nav_a.toml", "unit_on_table.svg") == own
    assert versions.restore("products", "nav_a", 1, "li").number == 3


def test_a_product_without_a_picture_has_none(site_folder: SiteFolder) -> None:
    assert run_summary(site_folder.request()).picture is None
    assert "picture" not in PRODUCT


@pytest.mark.parametrize(
    ("entered", "recorded"),
    [
        ("B1234", "Li Na (B1234)"),
        ("Li Na", "Li Na (B1234)"),
        ("B9999", "B9999"),
        ("B0001", "Wu Fei (B0001)"),
        ("Wu Fei", "Wu Fei"),
        ("B0003", "B0003"),
        ("Li Na (B1234)", "Li Na (B1234)"),
    ],
)
def test_records_name_a_person_by_name_and_badge(entered: str, recorded: str) -> None:
    names = {"B1234": "Li Na", "B0001": "Wu Fei", "B0002": "Wu Fei", "B0003": "B0003"}
    assert SignInSection(**BADGES, names=names).person(entered) == recorded
