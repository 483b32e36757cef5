"""Values of forms that no device can have are refused with the largest possible value, in both languages."""

import tomllib
from typing import Any

import pytest

from calstation.config import library
from calstation.config.editing import check_data
from calstation.messages import Language, sentence
from calstation.schema import KeyPath

#: A file, an entry of it, the largest value, and one that is too large.
CASES: list[tuple[str, str, KeyPath, float, float]] = [
    ("tables", "bench", ("accuracy", "poll_latency_s"), 1.0, 5.0),
    ("tables", "bench", ("accuracy", "poll_jitter_s"), 1.0, 5.0),
    ("tables", "bench", ("accuracy", "velocity_sigma"), 10.0, 11.0),
    ("tables", "bench", ("accuracy", "velocity_interval_s"), 60.0, 61.0),
    ("tables", "bench", ("accuracy", "encoder_sigma_deg"), 5.0, 50.0),
    ("tables", "bench", ("modbus", "rest_rate_dps"), 10.0, 11.0),
    ("tables", "mn_ascii", ("text", "settled_deg"), 10.0, 11.0),
    ("tables", "bench", ("outer", "max_rate_dps"), 10_000.0, 20_000.0),
    ("tables", "bench", ("inner", "max_acceleration_dps2"), 1e5, 2e5),
    ("imus", "stim300", ("stream", "bandwidth_hz"), 1e5, 2e5),
    ("imus", "stim300", ("noise", "gyro_arw"), 0.0290888, 3e5),
    ("imus", "stim300", ("noise", "accel_vrw"), 0.980665, 1.0),
    ("imus", "stim300", ("noise", "gyro_bias_instability"), 0.4848136811, 1.0),
    ("imus", "stim300", ("noise", "accel_bias_instability"), 9.80665, 10.0),
    ("imus", "stim300", ("stream", "gyro_quantisation"), 1.0, 2.0),
    ("imus", "stim300", ("prior", "gyro_bias", "sigma"), 100.0, 200.0),
    ("stations", "virtual_bench", ("clock_error_ppm",), 10_000.0, 20_000.0),
    ("stations", "virtual_bench", ("sign_in", "idle_minutes"), 1440.0, 1441.0),
]


@pytest.mark.parametrize(("kind", "name", "key_path", "largest", "wrong"), CASES)
def test_an_impossible_value_is_refused(kind: str, name: str, key_path: KeyPath, largest: float, wrong: float) -> None:
    path = library.shipped_folder() / kind / f"{name}.toml"
    data: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
    table = data
    for key in key_path[:-1]:
        table = table.setdefault(str(key), {})
    present = {problem.key_path for problem in check_data(kind, data, path)}
    table[key_path[-1]] = largest
    assert {problem.key_path for problem in check_data(kind, data, path)} <= present
    table[key_path[-1]] = wrong
    (problem,) = (each for each in check_data(kind, data, path) if each.key_path == key_path)
    texts: dict[Language, str] = {"en": "must be at most", "zh_CN": "不得大于"}
    for language, said in texts.items():
        assert said in sentence(problem.as_text, language)
        assert f"{largest:g}" in sentence(problem.as_text, language)
