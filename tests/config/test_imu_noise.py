"""Measured noise is stored in an IMU profile as a new version."""

from pathlib import Path

import pytest

from calstation.config import library, save_noise, versions
from calstation.devices.profiles import load_imu_profile
from calstation.errors import ConfigurationError


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A temporary site folder."""
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path))


def no_progress(*_: object, **__: object) -> None:
    """Ignore progress reports."""


def test_measured_noise_is_saved_as_a_new_version_of_the_profile() -> None:
    shipped = load_imu_profile(library.find("imus", "bench_nav"))
    saved = save_noise(no_progress, "bench_nav", {"gyro_arw": 3.14159e-7}, "Allan deviation of SN-1, 60 s", "wang")
    assert (saved.number, saved.author) == (2, "wang")
    path = library.find("imus", "bench_nav")
    noise = load_imu_profile(path).noise
    assert noise == shipped.noise.model_copy(update={"gyro_arw": 3.142e-7})
    assert "gyro_arw = 3.142e-07 # rad/√s, 0.00108 °/√h, Allan deviation of SN-1, 60 s" in path.read_text("utf-8")
    assert versions.list_versions("imus", "bench_nav")[1].author is None  # the shipped text


def test_an_unknown_profile_is_refused() -> None:
    with pytest.raises(ConfigurationError):
        save_noise(no_progress, "none", {"gyro_arw": 1e-7}, "", "wang")
