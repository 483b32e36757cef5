"""The configuration of a log survives TOML and JSON exactly and is in SI for the solvers."""

import copy
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from records_samples import META

from calstation.errors import ConfigurationError, InputError
from calstation.physics import ALIGNED, COUNT, INDEX, PARAMETERS, group_indices
from calstation.records import LogMeta, context_from_meta, prior_from_meta
from calstation.records.meta import meta_from_json
from calstation.results import with_states
from calstation.schema import load
from tests.helpers import error_code, raises_code


def test_configuration_survives_toml_and_json(meta: LogMeta) -> None:
    assert LogMeta.model_validate(tomllib.loads(meta.to_toml())) == meta
    assert meta_from_json(meta.to_json(), "log") == meta
    assert LogMeta.model_validate(tomllib.loads(meta.to_toml())).to_json() == meta.to_json()


def test_solver_context_is_in_si(meta: LogMeta) -> None:
    context = context_from_meta(meta)
    assert context.site.latitude == np.deg2rad(34.25)
    assert context.site.azimuth == np.deg2rad(12.5)
    assert context.site.gravity is None
    assert context.imu.accel_vrw == 4.9e-05
    assert context.table.encoder_sigma == np.deg2rad(0.03)
    assert context.table.mount_sigma == np.deg2rad(1.0)


def test_prior_is_as_configured_and_wide_by_default(meta: LogMeta) -> None:
    posterior = prior_from_meta(meta)
    assert posterior.mean[INDEX["gyro_bias_x"]] == 1e-7
    assert posterior.sigma[INDEX["gyro_bias_x"]] == pytest.approx(1e-5)
    assert posterior.sigma[INDEX["gyro_bias_y"]] == pytest.approx(PARAMETERS[INDEX["gyro_bias_y"]].prior_sigma)
    assert posterior.covariance.shape == (COUNT, COUNT)


def test_fixed_outer_lever_arm_is_zero_and_exactly_known() -> None:
    data = {
        **META,
        "table": {"outer_lever": "fixed"},
        "prior": {"outer_lever_x": {"value": 1.0, "sigma": 2.0}},
    }
    posterior = prior_from_meta(LogMeta.model_validate(data))
    assert not posterior.sigma[group_indices("outer_lever")].any()
    assert not posterior.mean[group_indices("outer_lever")].any()


def test_only_a_non_default_orientation_is_stored(meta: LogMeta) -> None:
    assert "orientation" not in meta.to_toml()
    assert "orientation" not in meta.to_json()
    assert context_from_meta(meta).table.geometry.orientation == ALIGNED
    turned = LogMeta.model_validate({**META, "table": {"orientation": "-y+z"}})
    assert meta_from_json(turned.to_json(), "log") == turned
    along_x, _, along_z = context_from_meta(turned).table.geometry.orientation
    assert (along_x, along_z) == ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0))


def test_nominal_lever_arm_is_the_prior_mean() -> None:
    meta = LogMeta.model_validate({**META, "prior": {"outer_lever_x": {"value": 0.3}}})
    posterior, plain = prior_from_meta(meta), prior_from_meta(LogMeta.model_validate({**META, "prior": {}}))
    assert posterior.mean[INDEX["outer_lever_x"]] == 0.3
    assert posterior.sigma == pytest.approx(plain.sigma, abs=0.0)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("site.latitude_deg", 91.0, "site.latitude_deg: 91.0 is out of range; it must be at most 90"),
        ("site.latitude_deg", float("nan"), "site.latitude_deg"),
        ("site.latitude_deg", "34", "site.latitude_deg: '34' must be a number"),
        ("imu.sample_rate_hz", 0.0, "must be greater than 0"),
        ("imu.output", "delta", "imu.output: 'delta' is unknown; it must be 'increment' or 'rate'"),
        ("imu.gyro_lbs", 1.0, "imu.gyro_lbs: The entry is unknown."),
        ("table.outer_axis", [1.0, 1.0, 0.0], "Give a unit vector"),
        ("table.orientation", "+x-x", "+x-x is not a right-angled orientation"),
        ("prior.gyro_bais_x", {"sigma": 1.0}, "Did you mean 'gyro_bias_x'?"),
        ("prior.gyro_bias_x", {"sigma": -1.0}, "prior.gyro_bias_x.sigma: -1.0 is out of range"),
        ("product.limits", {"gyro_bia": {"within": 1.0}}, "Did you mean 'gyro_bias'?"),
    ],
)
def test_invalid_field_is_reported_with_file_and_remedy(tmp_path: Path, field: str, value: Any, message: str) -> None:
    data: dict[str, Any] = copy.deepcopy(META)
    section, name = field.split(".")
    data[section][name] = value
    meta_text = _toml(data)
    path = tmp_path / "log.toml"
    path.write_text(meta_text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load(LogMeta, path, InputError)
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    assert message in text
    assert "\n" not in text


def test_missing_fields_and_files_are_reported(tmp_path: Path) -> None:
    path = tmp_path / "log.toml"
    with pytest.raises(InputError, match="No such file"):
        load(LogMeta, path, InputError)
    path.write_text("[site]\nlatitude_deg = 1\nlongitude_deg = 2\nheight_m = 3\n")
    with pytest.raises(InputError, match=r"imu: The entry is missing\. Add it"):
        load(LogMeta, path, InputError)
    path.write_text("[site\n")
    with pytest.raises(InputError, match="Not valid TOML"):
        load(LogMeta, path, InputError)


def _toml(data: dict[str, Any]) -> str:
    import tomli_w

    return tomli_w.dumps(data)


def test_pairs_of_numbers_are_read_from_toml() -> None:
    text = "[table]\naxis_offset_mm = [0.1, -0.2]\n[temperature]\nrange_c = [-40.0, 85.0]\n"
    meta = LogMeta.model_validate({**META, **tomllib.loads(text)})
    assert context_from_meta(meta).table.axis_offset == pytest.approx((1e-4, -2e-4))
    assert meta.temperature.range_c == (-40.0, 85.0)
    assert LogMeta.model_validate(tomllib.loads(meta.to_toml())) == meta


def test_states_of_the_model_are_refused_over_temperature(meta: LogMeta, tmp_path: Path) -> None:
    """The fit over temperature has no states beside the 30 parameters, and would leave them out silently."""
    text = '[model]\nstates = ["g_sensitivity"]\n[temperature]\nrange_c = [-40.0, 85.0]\n'
    path = tmp_path / "log.toml"
    path.write_text(_toml({**META, **tomllib.loads(text)}), encoding="utf-8")
    with pytest.raises(ConfigurationError) as caught:
        load(LogMeta, path)
    assert error_code(caught.value) == "model.states temperature.states"
    over_temperature = LogMeta.model_validate({**META, "temperature": {"range_c": [-40.0, 85.0]}})
    with raises_code(ConfigurationError, "temperature.states"):
        with_states(over_temperature, ("g_sensitivity",))
