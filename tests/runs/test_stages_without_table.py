"""Methods that cannot use a rate table are refused before any device is opened; multi_position runs on a table."""

import pytest

from calstation.errors import ConfigurationError
from tests.site_folder import SiteFolder


@pytest.mark.parametrize(
    ("stage", "error"),
    [
        ("gimbal", "stabilises on the corrected rates"),
        ("cross_calibration", "IMUs on one body recorded together"),
    ],
)
def test_stage_that_requires_other_hardware_is_refused_immediately(
    site_folder: SiteFolder, stage: str, error: str
) -> None:
    with pytest.raises(ConfigurationError, match=error):
        site_folder.run(stage)
    assert not (site_folder.folder / "runs").exists()


@pytest.mark.long
def test_multi_position_runs_on_the_table(site_folder: SiteFolder) -> None:
    quick = {
        "step_deg": 90.0,
        "rest_s": 4.0,
        "initial_rest_s": 5.0,
        "rate_dps": 100.0,
        "acceleration_dps2": 100.0,
    }
    site_folder.write({"schedule": {"multi_position": quick}})
    result = site_folder.run("multi_position").result
    assert result["outcome"] == "passed", [c for c in result["checks"] if not c["passed"]]
    assert len(result["parameters"]) == 21
    assert result["details"]["multi_position"]["scatter"] == {"force": 0.0, "rate": 0.0, "turn": 0.0}
