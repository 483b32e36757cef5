"""Table and IMU share one link in a system with its own axes; separate devices on one port are refused."""

from pathlib import Path
from typing import Any

import pytest
import tomli_w

from calstation.config import (
    RunConfiguration,
    RunRequest,
    StationConfig,
)
from calstation.connection import LinkTestRequest, check_imu_link, check_table_link
from calstation.connection.devices import endpoints
from calstation.errors import ConfigurationError
from tests.helpers import raises_code
from tests.prepared import prepare_run
from tests.site_folder import STATION, SiteFolder


@pytest.mark.exhaustive
def test_a_stage_runs_on_a_system_with_its_own_axes(site_folder: SiteFolder) -> None:
    station = {
        **STATION,
        "table": {"profile": "indexing_unit"},
        "bench": {"seed": 5, "start_deg": [1.0, -1.0]},
    }
    site_folder.station.write_text(tomli_w.dumps(station), encoding="utf-8")
    ended = site_folder.run("rate", "six_position")
    assert ended.verdict.passed
    assert ended.result["registers"]["verified"]
    assert "outer_lever_x" not in ended.result["parameters"], "it turns about its sensing centre"


def test_table_and_imu_on_one_port_are_tested_separately() -> None:
    data = {**STATION, "table": {"profile": "indexing_unit"}, "bench": {"seed": 5}}
    order = LinkTestRequest(StationConfig.model_validate(data))
    for test in (check_table_link, check_imu_link):
        report = test(lambda *progress, **more: None, order)
        assert "identified" in [finding.id for finding in report.findings]
        assert not [finding for finding in report.findings if finding.state == "error"]


def hardware(site_folder: SiteFolder, profile: str, table: str, imu: str) -> RunConfiguration:
    station: dict[str, Any] = {**STATION, "table": {"profile": profile, "port": table}, "imu": {"port": imu}}
    site_folder.station.write_text(tomli_w.dumps(station), encoding="utf-8")
    return prepare_run(
        RunRequest(
            "SN-000042", site_folder.station, site_folder.product, ("rate",), site_folder.folder / "runs", "tester"
        )
    )


@pytest.mark.parametrize(
    ("profile", "table", "imu", "code"),
    [
        ("mn_ascii", "/dev/ttyNONE7", "/dev/ttyNONE7", "connection.same_port"),
        ("bench", "tcp://127.0.0.1:9", "socket://127.0.0.1:9", "connection.same_port"),
        (
            "indexing_unit",
            "/dev/ttyNONE7",
            "/dev/ttyNONE8",
            "connection.different_ports",
        ),
    ],
)
def test_incorrectly_shared_or_separate_ports_are_reported(
    site_folder: SiteFolder, profile: str, table: str, imu: str, code: str
) -> None:
    setup = hardware(site_folder, profile, table, imu)
    with raises_code(ConfigurationError, code), endpoints((setup,)):
        raise AssertionError("never opened")


def test_two_names_of_one_port_count_as_one_port(site_folder: SiteFolder) -> None:
    device, link = site_folder.folder / "ttyX", site_folder.folder / "by-id"
    device.touch()
    link.symlink_to(device)
    with (
        raises_code(ConfigurationError, "connection.same_port"),
        endpoints((hardware(site_folder, "mn_ascii", str(device), str(link)),)),
    ):
        raise AssertionError("never opened")


def test_imu_with_its_own_axes_shares_one_port(site_folder: SiteFolder) -> None:
    with endpoints((hardware(site_folder, "indexing_unit", "/dev/ttyNONE7", "/dev/ttyNONE7"),)) as at:
        assert at.table == at.imu == "/dev/ttyNONE7"


def test_different_ports_do_not_conflict(site_folder: SiteFolder, tmp_path: Path) -> None:
    with endpoints((hardware(site_folder, "bench", "tcp://127.0.0.1:502", "/dev/ttyNONE7"),)) as at:
        assert at.imu == "/dev/ttyNONE7"
