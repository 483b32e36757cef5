"""`[diagnosis]` of a product file: errors over limits, sizes, and known causes only."""

import tomllib

from calstation.config import DetectionSection, ProductConfig, check, library, read_text

TEXT = read_text(library.find("products", "mems_c"))


def test_an_effect_is_required_by_its_error_or_by_its_size():
    text = f"{TEXT}\n[diagnosis]\ngyro_scale_drift = {{ error_over_limit = 1.5 }}\naccel_cubic = 4e-7\n"
    product = ProductConfig.model_validate(tomllib.loads(text))
    required = {"gyro_scale_drift": DetectionSection(error_over_limit=1.5), "accel_cubic": 4e-7}
    assert product.diagnosis == required


def test_wrong_requirements_are_named():
    for line, key_path in (
        ("gyro_scale_drfit = { error_over_limit = 1.5 }", ("diagnosis", "gyro_scale_drfit")),
        ("accel_cubic = { error_over_limit = 0 }", ("diagnosis", "accel_cubic", "error_over_limit")),
        ("accel_cubic = { over = 1.0 }", ("diagnosis", "accel_cubic", "over")),
        ("accel_cubic = -1.0", ("diagnosis", "accel_cubic")),
    ):
        problems = check("products", f"{TEXT}\n[diagnosis]\n{line}\n")
        assert problems[0].key_path == key_path, problems
