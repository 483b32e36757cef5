"""The test of the link to a chamber, the ports of a station with one, and the limits of all that is in it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from calstation.config import RunRequest, StationConfig, load_configuration
from calstation.config.configuration_checks import check_chamber
from calstation.connection import check_chamber_link
from calstation.connection.devices import endpoints
from calstation.errors import ConfigurationError
from calstation.messages import Report
from calstation.records import TemperatureSection
from calstation.schema import validate
from calstation.sequencer import chamber_limits
from tests.connection.fake_links import NOBODY, SITE, order, server
from tests.devices.scripted import ScriptedDevice
from tests.helpers import error_code, raises_code


def no_progress(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
    """Ignore the progress."""


POLL = [
    (b"99997\xb61\xb61\r", b"1\xb6bench-chamber\r\n"),
    (b"11004\xb61\xb61\r", b"1\xb623.4\r\n"),
    (b"11002\xb61\xb61\r", b"1\xb620.0\r\n"),
]
CLOSED = [
    (b"14003\xb61\xb61\r", b"1\xb61\r\n"),
    (b"10012\xb61\r", b"1\xb63\r\n"),
    (b"15002\xb61\xb61\r", b"1\xb60\r\n"),
]
OPEN = [(b"14003\xb61\xb61\r", b"1\xb60\r\n"), (b"10012\xb61\r", b"1\xb69\r\n"), (b"15002\xb61\xb61\r", b"1\xb61\r\n")]


def chamber_report(pairs: list[tuple[bytes, bytes]]) -> Report:
    device = ScriptedDevice(pairs)
    with server(device.answer, device.connected) as address:
        section = {"profile": "virtual_chamber", "port": f"tcp://{address}", "timeout_s": 0.3}
        return check_chamber_link(no_progress, order(chamber=section))


@pytest.mark.parametrize(
    ("pairs", "found"),
    [
        (POLL + CLOSED, ["connected ok", "chamber_identified ok", "chamber_temperature info"]),
        (
            POLL + OPEN,
            [
                "connected ok",
                "chamber_identified ok",
                "chamber_temperature info",
                "chamber_alarm error",
                "chamber_door_open warning",
            ],
        ),
        ([(POLL[0][0], b"1\xb6other\r\n")], ["connected ok", "wrong_model error"]),
        ([(POLL[0][0], b"")], ["connected ok", "chamber_silent error"]),
    ],
)
def test_the_link_of_a_chamber_is_tested_by_questions(pairs: list[tuple[bytes, bytes]], found: list[str]) -> None:
    report = chamber_report(pairs)
    assert report.device == "chamber"
    assert [f"{finding.id} {finding.state}" for finding in report.findings] == found


def test_a_chamber_that_nothing_serves_is_a_finding() -> None:
    section = {"profile": "simserv", "port": "tcp://127.0.0.1:19", "timeout_s": 0.1}
    report = check_chamber_link(no_progress, order(chamber=section))
    assert [finding.id for finding in report.findings] == ["chamber_silent"]


def test_a_station_without_chamber_has_none_to_test() -> None:
    with raises_code(ConfigurationError, "connection.no_chamber"):
        check_chamber_link(no_progress, order())


@pytest.mark.parametrize(
    ("chamber", "code"),
    [
        ({"profile": "simserv"}, "chamber.port station.port_missing"),
        ({"profile": "simserv", "port": "192.168.0.9:2049"}, "chamber.port station.table_scheme_missing"),
        (
            {"profile": "simserv", "port": NOBODY, "ambient_c": 20.0, "dew_point_c": 20.0},
            "chamber.dew_point_c station.dew_point",
        ),
    ],
)
def test_wrong_sections_are_refused(chamber: dict[str, Any], code: str) -> None:
    data = {
        "name": "x",
        "site": SITE,
        "table": {"profile": "bench", "port": NOBODY},
        "imu": {"port": "/dev/ttyNONE9"},
        "chamber": chamber,
    }
    with pytest.raises(ConfigurationError) as caught:
        validate(StationConfig, data, "test")
    assert error_code(caught.value) == code


def test_the_chamber_has_a_port_of_its_own() -> None:
    request = order(chamber={"profile": "simserv", "port": NOBODY})
    setup = load_configuration(RunRequest("SN-000001"))
    setup = replace(setup, station=request.station)
    with raises_code(ConfigurationError, "connection.same_chamber_port"), endpoints((setup,)):
        pass


def test_the_limits_are_those_of_chamber_table_and_unit() -> None:
    setup = load_configuration(RunRequest("SN-000001", station=Path("data/stations/virtual_chamber.toml")))
    limits = chamber_limits(setup)
    assert limits is not None
    assert limits.ranges == {"chamber": (-70.0, 120.0), "table": (-55.0, 100.0), "unit": (-45.0, 90.0)}
    assert (limits.range, limits.max_rate) == ((-45.0, 90.0), pytest.approx(5.0 / 60.0))
    assert (limits.ambient, limits.dew_point) == (23.0, 18.0)
    without = replace(setup, table=setup.table.model_copy(update={"range_c": None}))
    with raises_code(ConfigurationError, "chamber.no_range") as caught:
        chamber_limits(without)
    assert caught.value.values["device"] == "table"
    assert chamber_limits(load_configuration(RunRequest("SN-000001"))) is None


def test_a_range_that_is_missing_is_found_before_a_device_is_opened() -> None:
    setup = load_configuration(RunRequest("SN-000001", station=Path("data/stations/virtual_chamber.toml")))
    product = setup.product.model_copy(update={"temperature": TemperatureSection(range_c=(0.0, 40.0))})
    setup = replace(setup, product=product, schedules={"temperature": setup.schedules["rate"]})
    check_chamber(setup)
    imu = setup.imu.model_copy(update={"range_c": None})
    with raises_code(ConfigurationError, "chamber.no_range") as caught:
        check_chamber(replace(setup, imu=imu))
    assert caught.value.values["device"] == "unit"
