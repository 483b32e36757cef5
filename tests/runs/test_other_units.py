"""Runs on units with other protocols: the same plan and verdict, and registers written and verified."""

from typing import Any

import pytest

from tests.helpers import sampled
from tests.site_folder import SiteFolder

pytestmark = pytest.mark.long

LIMITS = {
    "gyro_scale": {"within": 2e-2, "sigma_below": 1e-2},
    "accel_scale": {"within": 2e-2, "sigma_below": 1e-2},
}


@pytest.mark.parametrize("imu", sampled(2, ["vectornav_vn100", "dsp_modbus"]))
def test_stages_run_on_a_unit_with_another_protocol(site_folder: SiteFolder, imu: str) -> None:
    product: dict[str, Any] = {"imu": imu, "bench_grade": "mems", "limits": LIMITS}
    site_folder.write(product)
    ended = site_folder.run("rate", "six_position")
    assert ended.verdict.passed, site_folder.events[-3:]
    registers = ended.result["registers"]
    assert registers["verified"]
    found = ended.result["parameters"]["gyro_scale_x"]["value"]
    assert registers["new"]["gyro_scale_x"] == pytest.approx(found, abs=2e-6)
    assert registers["old"]["gyro_scale_x"] == 0.0
