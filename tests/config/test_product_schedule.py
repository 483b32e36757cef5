"""A schedule is saved in the product file as a new version; other entries are unchanged."""

import re
from pathlib import Path

import pytest

from calstation.config import library, load_product, save_schedule, versions
from calstation.errors import ConfigurationError
from tests.helpers import error_code, ignore_progress


@pytest.fixture
def shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The shipped navigation product, with a temporary site folder for changes."""
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))
    return library.find("products", "nav_a")


def test_a_shipped_product_is_copied_to_the_site_with_the_new_values(shipped: Path, tmp_path: Path) -> None:
    before = shipped.read_text(encoding="utf-8")
    changes = {"rate": {"turns": 3}, "excitation": {"targets": {"gyro_bias": 1e-7}, "rounds": 2}}
    path, version = save_schedule(ignore_progress, shipped, changes, "wang")
    assert path == tmp_path / "home" / "products" / "nav_a.toml"
    assert shipped.read_text(encoding="utf-8") == before
    _, product = load_product(path)
    assert product.schedule["rate"]["turns"] == 3
    assert product.schedule["rate"]["rate_dps"] == 20.0
    assert product.schedule["excitation"]["targets"] == {"gyro_bias": 1e-7}
    assert "# Largest magnitude of a sound unit's values" in path.read_text(encoding="utf-8")
    assert version.author == "wang"
    assert versions.list_versions("products", "nav_a")[0] == version

    again, _ = save_schedule(ignore_progress, path, {"excitation": {"targets": {}, "rounds": 1}}, "wang")
    _, product = load_product(again)
    assert "targets" not in product.schedule["excitation"]


def test_required_value_cannot_be_removed(shipped: Path) -> None:
    with pytest.raises(ConfigurationError, match="means 1") as caught:
        save_schedule(ignore_progress, shipped, {"excitation": {"rounds": None}}, "wang")
    assert error_code(caught.value) == "schedule.excitation.rounds product.empty_in_file"


def test_invalid_value_changes_nothing(shipped: Path) -> None:
    with pytest.raises(ConfigurationError, match="turns"):
        save_schedule(ignore_progress, shipped, {"rate": {"turns": 0}}, "wang")
    assert library.find("products", "nav_a") == shipped


def test_check_for_a_stage_missing_from_the_product_is_refused(shipped: Path, tmp_path: Path) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(shipped.read_text("utf-8").replace('stage = "excitation"', 'stage = "exitation"'), "utf-8")
    with pytest.raises(ConfigurationError, match=r"'exitation' is unknown.*'excitation'") as caught:
        load_product(path)
    assert error_code(caught.value) == "checks.motion_angle.stage entry.unknown_name"


@pytest.mark.parametrize(
    ("pattern", "given", "example"),
    [
        (r"SN-\\d{6}", "", "SN-000123"),
        (r"NAV-\\d{4}", 'serial_example = "NAV-0001"', "NAV-0001"),
        (r"X\\d", "", r"X\d"),
    ],
)
def test_error_for_an_invalid_scan_shows_an_example(tmp_path: Path, pattern: str, given: str, example: str) -> None:
    path = tmp_path / "p.toml"
    path.write_text(f'name = "p"\nimu = "bench_nav"\nserial_pattern = "{pattern}"\n{given}\n', encoding="utf-8")
    assert load_product(path)[1].example == example


def test_serial_number_example_must_match_the_pattern(tmp_path: Path) -> None:
    path = tmp_path / "p.toml"
    path.write_text(
        'name = "p"\nimu = "bench_nav"\nserial_pattern = "X\\\\d"\nserial_example = "Y1"\n', encoding="utf-8"
    )
    with pytest.raises(ConfigurationError) as caught:
        load_product(path)
    assert error_code(caught.value) == "serial_example product.example_unlike"


@pytest.mark.parametrize("name", sorted(library.names("products")))
def test_serial_pattern_of_a_shipped_product_accepts_one_number_only(name: str) -> None:
    pattern = load_product(library.find("products", name))[1].serial_pattern
    for serial in ("SN-000001", "SN-1", "SN-GIMBAL-1", "SN-PAIR-1", "A-2026-0001", "X1"):
        assert re.fullmatch(pattern, serial), serial
        assert not re.fullmatch(pattern, f"{serial}SN-000020"), serial
    for text in ("", "SN 1!", "123456", "-1", "SN-", "https://x/SN-1"):
        assert not re.fullmatch(pattern, text), text
