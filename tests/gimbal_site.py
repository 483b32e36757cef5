"""A folder with the station of the virtual gimbal and a product with short rotations."""

from typing import Any

from tests.site_folder import SiteFolder

SCHEDULE = {"dwell_s": 3.0, "iterations": 3, "threshold_arcsec": 60.0}
PRODUCT: dict[str, Any] = {
    "name": "on a gimbal",
    "imu": "bench_mems",
    "bench_grade": "mems",
    "serial_pattern": "SN-[0-9]+",
    "stages": ["gimbal"],
    "schedule": {"gimbal": SCHEDULE},
    "limits": {"gyro_misalign": {"within": 0.0036, "sigma_below": 1e-3}},
}
#: Settings of the bench that make a good gimbal.
GIMBAL = {"encoder_sigma_deg": 0.002, "homing_rate_deg_s": 20.0}


class GimbalSite(SiteFolder):
    """A site folder with a gimbal."""

    def write(self, product: dict[str, Any] | None = None, station: dict[str, Any] | None = None, **more: Any) -> None:
        gimbal = {"table": {"profile": "gimbal"}, **(station or {})}
        super().write({**PRODUCT, **(product or {})}, gimbal, **{**GIMBAL, **more})
