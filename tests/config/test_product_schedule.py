"""A schedule is saved in the product's file as a new version; other entries are unchanged."""

from pathlib import Path

import pytest

from calstation.config import library, versions
from calstation.config.schedules import save_schedule
from calstation.config.station import load_product
from calstation.errors import ConfigurationError
from tests.helpers import complaint, ignore_progress


@pytest.fixture
def shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The shipped navigation product, with a site's folder of its own to keep changes in."""
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


def test_a_value_that_a_file_cannot_leave_out_is_refused(shipped: Path) -> None:
    with pytest.raises(ConfigurationError, match="means 1") as caught:
        save_schedule(ignore_progress, shipped, {"excitation": {"rounds": None}}, "wang")
    assert complaint(caught.value) == "schedule.excitation.rounds product.empty_in_file"


def test_a_check_of_a_stage_that_the_product_lacks_is_refused(shipped: Path, tmp_path: Path) -> None:
    path = tmp_path / "product.toml"
    text = shipped.read_text(encoding="utf-8")
    path.write_text(text.replace('stage = "six_position"', 'stage = "six_positions"'), encoding="utf-8")
    with pytest.raises(ConfigurationError) as caught:
        load_product(path)
    assert complaint(caught.value) == "checks.improvement_at_rest.stage product.check_stage"


def test_a_wrong_value_changes_nothing(shipped: Path) -> None:
    with pytest.raises(ConfigurationError, match="turns"):
        save_schedule(ignore_progress, shipped, {"rate": {"turns": 0}}, "wang")
    assert library.find("products", "nav_a") == shipped
