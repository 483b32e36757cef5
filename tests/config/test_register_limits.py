"""A product is refused if its limits allow values outside the register range."""

import tomllib
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from calstation.config import editing as settings
from calstation.config import library, load_configuration
from calstation.errors import ConfigurationError
from tests.helpers import error_code, raises_code
from tests.site_folder import STATION

NAV = Path(library.shipped_folder()) / "imus" / "bench_nav.toml"


@pytest.fixture
def coarse(site_folder: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Write a changed bench IMU profile to the site folder, and a product that uses it."""
    home = tmp_path / "home"
    (home / "imus").mkdir(parents=True)
    monkeypatch.setenv("CALSTATION_HOME", str(home))

    def write(entry: dict[str, Any], limits: dict[str, Any]) -> None:
        data = tomllib.loads(NAV.read_text(encoding="utf-8"))
        data["registers"][0] |= entry
        (home / "imus" / "coarse.toml").write_text(tomli_w.dumps(data), encoding="utf-8")
        site_folder.write({"imu": "coarse", "limits": limits})

    return write


@pytest.mark.parametrize(
    ("entry", "limit", "found"),
    [
        ({"range": [-1e-4, 1e-4]}, {"within": 2e-4, "sigma_below": 1e-5}, "within product.beyond_register"),
        ({"range": [-1e-4, 1e-4]}, {"within": [-1e-5, 3e-4]}, "within product.beyond_register"),
        (
            {"type": "i16", "scale": 1e-5, "range": [-0.1, 0.1]},
            {"within": 1e-3, "sigma_below": 1e-6},
            "sigma_below product.finer_than_step",
        ),
        ({"tolerance": 1e-4}, {"sigma_below": 1e-6}, "sigma_below product.finer_than_tolerance"),
    ],
)
def test_limits_outside_the_register_range_are_refused(
    site_folder: Any, coarse: Any, entry: dict[str, Any], limit: dict[str, Any], found: str
) -> None:
    coarse(entry, {"gyro_bias": limit})
    with raises_code(ConfigurationError, "entry.in_file") as caught:
        load_configuration(site_folder.request("rate"))
    assert error_code(caught.value) == f"limits.gyro_bias.{found}"
    values = caught.value.values["what"].values["what"].values
    assert (values["parameter"], values["register"]) == ("gyro_bias_x", 0)
    (problem,) = settings.check("products", site_folder.product.read_text(encoding="utf-8"))
    assert f"{site_folder.product}: {problem.text}" == str(caught.value)
    assert problem.line > 1


def test_matrix_register_range_is_compared_with_parameter_limits(site_folder: Any) -> None:
    site_folder.write({"imu": "vectornav_vn100", "limits": {"gyro_scale": {"within": 0.9}}})
    with pytest.raises(ConfigurationError, match=r"gyro_matrix_xx from -0\.35 to 2\.35, but register 84"):
        load_configuration(site_folder.request("rate"))


@pytest.mark.parametrize("port", ["/dev/ttyUSB0", "socket://127.0.0.1:5000"])
def test_station_baud_rate_must_be_sufficient_for_the_stream(site_folder: Any, port: str) -> None:
    hardware = {**STATION, "table": {"profile": "bench", "port": "tcp://127.0.0.1:502"}}
    hardware["imu"] = {"port": port, "serial": {"baud": 19200}}
    site_folder.station.write_text(tomli_w.dumps(hardware), encoding="utf-8")
    if port.startswith("socket"):  # the baud rate behind a socket is unknown
        load_configuration(site_folder.request("rate"))
        return
    with raises_code(ConfigurationError, "entry.in_file") as caught:
        load_configuration(site_folder.request("rate"))
    assert error_code(caught.value) == "imu.serial.baud profile.baud_too_low"


def test_station_baud_rate_must_be_sufficient_for_the_corrected_stream(
    site_folder: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = tomllib.loads(NAV.read_text(encoding="utf-8"))
    spare = [{"name": f"spare{i}", "type": "u64"} for i in range(30)]
    own = {**data["frame"], "fields": [*spare, *data["frame"]["fields"]]}
    data["corrected"] = {**data["corrected"], "frame": own}
    (tmp_path / "home" / "imus").mkdir(parents=True)
    (tmp_path / "home" / "imus" / "long.toml").write_text(tomli_w.dumps(data), encoding="utf-8")
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))
    site_folder.write({"imu": "long"})
    hardware = {**STATION, "table": {"profile": "bench", "port": "tcp://127.0.0.1:502"}}
    hardware["imu"] = {"port": "/dev/ttyUSB0", "serial": {"baud": 115200}}
    site_folder.station.write_text(tomli_w.dumps(hardware), encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"imu\.serial\.baud: 115200 is too low .* of 274 bytes"):
        load_configuration(site_folder.request("rate"))
