"""Changes to the configuration of logs: values, factors, and refused changes."""

from pathlib import Path
from typing import Any

import pytest

from calstation.errors import ConfigurationError, InputError
from calstation.fleet.changes import Changes, load_changes
from calstation.records import LogMeta
from tests.helpers import raises_code

IMU = {
    "serial": "SN-1",
    "sample_rate_hz": 200.0,
    "output": "increment",
    "gyro_lsb": 1e-9,
    "accel_lsb": 1e-7,
    "gyro_arw": 1e-6,
    "accel_vrw": 1e-4,
}
SITE = {"latitude_deg": 34.25, "longitude_deg": 109.0, "height_m": 400.0}
LIMITS = {"accel_scale": {"within": 1e-3}, "gyro_scale": {"within": [-2e-3, 1e-3]}}


def meta_of(**more: Any) -> LogMeta:
    """Return the configuration of a log."""
    return LogMeta.model_validate({"site": SITE, "imu": IMU, "product": {"name": "p", "limits": LIMITS}, **more})


def changes_of(tmp_path: Path, content: str) -> Changes:
    """Return the changes in a file."""
    patch = tmp_path / "patch.toml"
    patch.write_text(content)
    return load_changes(patch)


@pytest.mark.parametrize(
    ("content", "code", "expected"),
    [
        ("", "fleet.no_changes", "patch.toml"),
        ("[site]\n[product.limits]\n", "fleet.no_changes", "[site]"),
        ("[scale.site]\n", "fleet.no_changes", ""),
        ("scale = 0.99998\n", "fleet.not_changeable", "[scale.site]"),
        ("[scale.sight]\ngravity_mps2 = 0.99998\n", "fleet.not_changeable", "site"),
        ("[scale.site]\ngravity = 0.99998\n", "entry.in_file", "gravity_mps2"),
        ("[scale.site]\ngravity_mps2 = -1.0\n", "fleet.not_a_factor", "scale.site.gravity_mps2 = -1.0"),
        ("[scale.site]\ngravity_mps2 = true\n", "fleet.not_a_factor", "scale.site.gravity_mps2"),
        ("[scale.table]\norientation = 2.0\n", "fleet.not_scalable", "scale.table.orientation"),
        ("[scale]\nsite = 2.0\n", "fleet.not_scalable", "scale.site"),
        ("[scale.schedule.excitation]\nrounds = 1.5\n", "fleet.not_scalable", "rounds"),
        ("[scale.imu]\nsample_rate_hz = 2.0\n", "fleet.fixed_entry", "scale.imu.sample_rate_hz"),
        ("imu = 3\n", "entry.in_file", "imu"),
        ("[sight]\nlatitude_deg = 1.0\n", "fleet.not_changeable", "site"),
        ("[run]\nstation = 'x'\n", "fleet.not_changeable", ""),
        ("[site]\ngravity = 9.8\n", "entry.in_file", "gravity_mps2"),
        ("[site]\ngravity_mps2 = 'x'\n", "entry.in_file", "a number"),
        ("[imu]\nserial = 'x'\n", "fleet.fixed_entry", "imu.serial"),
        ("[product.limits.accel_scal]\nwithin = 1e-3\n", "entry.in_file", "accel_scale"),
        ("[prior.gyro_bias_q]\nsigma = 1.0\n", "entry.in_file", "gyro_bias_"),
        ("[schedule.excitation]\nround = 1\n", "entry.in_file", "rounds"),
        ("[schedule.excitatio]\nrounds = 1\n", "plan.no_such_stage", "excitation"),
    ],
)
def test_unknown_change_is_refused_with_the_closest_name(
    tmp_path: Path, content: str, code: str, expected: str
) -> None:
    with raises_code(ConfigurationError, code) as caught:
        changes_of(tmp_path, content)
    assert expected in str(caught.value)


def test_factor_multiplies_the_value_of_each_log(tmp_path: Path) -> None:
    changes = changes_of(tmp_path, "[scale.site]\ngravity_mps2 = 0.99998\n[site]\nheight_m = 410.0\n")
    for gravity in (9.7955, 9.8011):
        meta = meta_of(site={**SITE, "gravity_mps2": gravity})
        changed = changes.applied(meta)
        assert changed.site.gravity_mps2 == gravity * 0.99998
        assert changed == meta.model_copy(update={"site": changed.site})
        assert changed.site == meta.site.model_copy(update={"gravity_mps2": gravity * 0.99998, "height_m": 410.0})


def test_computed_gravity_is_not_scaled(tmp_path: Path) -> None:
    meta = meta_of()
    assert changes_of(tmp_path, "[scale.site]\ngravity_mps2 = 0.99998\n").applied(meta) == meta


def test_limits_and_intervals_are_scaled(tmp_path: Path) -> None:
    text = "[scale.product.limits.accel_scale]\nwithin = 2.0\n[scale.product.limits.gyro_scale]\nwithin = 0.5\n"
    product = changes_of(tmp_path, text).applied(meta_of()).product
    assert product is not None
    assert [product.limits[name].within for name in LIMITS] == [2e-3, [-1e-3, 0.5e-3]]


@pytest.mark.parametrize(
    ("content", "entry"),
    [
        ("[scale.prior.gyro_bias_x]\nsigma = 2.0\n", "prior.gyro_bias_x.sigma"),
        ("[scale.site]\nazimuth_deg = 1.1\n", "site.azimuth_deg"),
        ("[scale.product.limits.gyro_bias]\nwithin = 2.0\n", "product.limits.gyro_bias.within"),
    ],
)
def test_scaling_a_missing_value_is_refused(tmp_path: Path, content: str, entry: str) -> None:
    with raises_code(InputError, "fleet.nothing_to_scale") as caught:
        changes_of(tmp_path, content).applied(meta_of())
    assert entry in str(caught.value)


def test_a_scaled_value_must_be_valid_for_the_log(tmp_path: Path) -> None:
    with raises_code(InputError, "entry.in_file") as caught:
        changes_of(tmp_path, "[scale.site]\ngravity_mps2 = 1.1\n").applied(meta_of(site={**SITE, "gravity_mps2": 9.8}))
    assert "gravity_mps2" in str(caught.value)


def test_different_factors_have_different_checksums(tmp_path: Path) -> None:
    texts = ("[scale.site]\ngravity_mps2 = 0.99998\n", "[scale.site]\ngravity_mps2 = 0.99997\n")
    assert len({changes_of(tmp_path, text).sha256 for text in texts}) == 2
