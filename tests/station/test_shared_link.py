"""One link for table and IMU: a run on a system with axes of its own; one port for two others is refused."""

from pathlib import Path
from typing import Any

import pytest
import tomli_w

from calstation.config.request import RunRequest
from calstation.config.resolved import ResolvedConfiguration, prepare_run
from calstation.config.station import StationConfig
from calstation.connection.devices import endpoints
from calstation.connection.link_test import LinkTestRequest, check_imu_link, check_table_link
from calstation.errors import ConfigurationError
from tests.helpers import raises_code
from tests.station.conftest import STATION, Place


@pytest.mark.long
def test_a_stage_runs_on_a_system_with_its_own_axes(place: Place) -> None:
    station = {
        **STATION,
        "table": {"profile": "indexing_unit"},
        "bench": {"seed": 5, "start_deg": [1.0, -1.0]},
    }
    place.station.write_text(tomli_w.dumps(station), encoding="utf-8")
    verdict = place.run("rate", "six_position")
    assert verdict.outcome == "passed"
    assert verdict.result["registers"]["verified"]
    assert "outer_lever_x" not in verdict.result["parameters"], "it turns about its sensing centre"


def test_table_and_imu_of_such_a_system_are_tested_one_by_one() -> None:
    data = {**STATION, "table": {"profile": "indexing_unit"}, "bench": {"seed": 5}}
    order = LinkTestRequest(StationConfig.model_validate(data))
    for test in (check_table_link, check_imu_link):
        report = test(lambda *told, **more: None, order)
        assert "identified" in [finding.id for finding in report.findings]
        assert not [finding for finding in report.findings if finding.state == "wrong"]


def hardware(place: Place, profile: str, table: str, imu: str) -> ResolvedConfiguration:
    station: dict[str, Any] = {**STATION, "table": {"profile": profile, "port": table}, "imu": {"port": imu}}
    place.station.write_text(tomli_w.dumps(station), encoding="utf-8")
    return prepare_run(
        RunRequest("SN-000042", place.station, place.product, ("rate",), place.folder / "runs", "tester")
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
def test_a_port_that_cannot_be_shared_or_must_be_is_told(
    place: Place, profile: str, table: str, imu: str, code: str
) -> None:
    setup = hardware(place, profile, table, imu)
    with raises_code(ConfigurationError, code), endpoints(setup):
        raise AssertionError("never opened")


def test_two_names_of_one_port_are_one_port(place: Place) -> None:
    device, link = place.folder / "ttyX", place.folder / "by-id"
    device.touch()
    link.symlink_to(device)
    with (
        raises_code(ConfigurationError, "connection.same_port"),
        endpoints(hardware(place, "mn_ascii", str(device), str(link))),
    ):
        raise AssertionError("never opened")


def test_such_a_system_takes_the_same_port_twice(place: Place) -> None:
    with endpoints(hardware(place, "indexing_unit", "/dev/ttyNONE7", "/dev/ttyNONE7")) as at:
        assert at.table == at.imu == "/dev/ttyNONE7"


def test_ports_apart_are_left_alone(place: Place, tmp_path: Path) -> None:
    with endpoints(hardware(place, "bench", "tcp://127.0.0.1:502", "/dev/ttyNONE7")) as at:
        assert at.imu == "/dev/ttyNONE7"
