"""The designer respects the settings of tables and products."""

import numpy as np
import pytest

from calstation.config import RunRequest, library, load_configuration, read_text
from calstation.designer import DesignRequest, design_schedule, designed_product
from calstation.errors import ConfigurationError
from tests.design.test_designer import changed, ignore
from tests.helpers import raises_code


def test_rate_above_the_table_limit_is_refused():
    product = library.find("products", "mems_c")
    with raises_code(ConfigurationError, "motion.rate_outside"):
        design_schedule(ignore, DesignRequest(product=product, rate_dps=500.0, time_limit=1.0))


def test_table_with_insufficient_travel_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path))
    changed(
        tmp_path, "tables", "bench", ("low_deg = -1080.0", "low_deg = -30.0"), ("high_deg = 1080.0", "high_deg = 30.0")
    )
    station = changed(tmp_path, "stations", "virtual_bench", ('profile = "bench"', 'profile = "bench_changed"'))
    with raises_code(ConfigurationError, "design.no_travel"):
        design_schedule(ignore, DesignRequest(station, library.find("products", "mems_c"), time_limit=1.0))


@pytest.mark.parametrize("station", ["virtual_hand", "virtual_gimbal"])
def test_station_without_a_motorised_table_is_refused(station):
    with pytest.raises(ConfigurationError):
        design_schedule(ignore, DesignRequest(library.find("stations", station), time_limit=1.0))


@pytest.mark.long
def test_schedule_is_designed_for_a_table_with_a_fixed_lever_arm(tmp_path, monkeypatch):
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path))
    changed(tmp_path, "tables", "bench", ('outer_lever = "estimated"', 'outer_lever = "fixed"'))
    station = changed(tmp_path, "stations", "virtual_bench", ('profile = "bench"', 'profile = "bench_changed"'))
    product = library.find("products", "mems_c")
    result = design_schedule(ignore, DesignRequest(station, product, time_limit=1.0))
    assert np.isinf(result.limits[-3:]).all()
    assert result.worst <= 0.801


def test_run_uses_the_targets_of_the_design(tmp_path):
    product = changed(
        tmp_path,
        "products",
        "mems_c_fast",
        (
            "[limits.gyro_bias] # rad/s",
            "[limits.gyro_bias_x]\nwithin = 0.005\nsigma_below = 1e-5\n\n[limits.gyro_bias] # rad/s",
        ),
    )
    text = read_text(product)
    product.write_text(f"targets = {{ gyro_scale = 1.0 }}\n{text}", encoding="utf-8")
    setup = load_configuration(RunRequest("M-1", None, product))
    targets = setup.schedules["designed"].model_dump()["targets"]
    assert targets["gyro_bias_x"] == pytest.approx(0.8e-5)
    assert targets["gyro_bias_y"] == pytest.approx(0.8 * 1.9e-5)
    assert targets["gyro_scale_x"] == pytest.approx(0.8 * 3e-4)
    gravity = setup.solve_context().site.relative_gravity_sigma
    assert targets["accel_scale_x"] ** 2 + gravity**2 == pytest.approx((0.8e-4) ** 2)


@pytest.mark.long
def test_designed_product_drops_targets_of_other_stages(tmp_path):
    product = changed(tmp_path, "products", "mems_c", ("stages = ", "targets = { gyro_scale = 1.0 }\nstages = "))
    result = design_schedule(ignore, DesignRequest(product=product, time_limit=1.0))
    assert "gyro_scale = 1.0" not in designed_product(read_text(product), result)
