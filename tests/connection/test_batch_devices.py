"""The devices of a batch: one table and the responding IMUs; all bytes are read before simulated time advances."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calstation.config import (
    RunConfiguration,
    RunRequest,
    SlotSection,
    StationConfig,
    library,
)
from calstation.connection import (
    Devices,
    LinkTestRequest,
    check_imu_link,
    devices,
    link_test_configuration,
    open_devices,
)
from calstation.devices.imu import StreamedImu
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.schema import validate
from tests.helpers import ignore_progress, raises_code
from tests.prepared import prepare_batch
from tests.site_folder import STATION

SERIALS = ("SN-000001", "SN-000002", "SN-000003")


@pytest.fixture
def setups(tmp_path: Path) -> tuple[RunConfiguration, ...]:
    station = library.find("stations", "virtual_batch")
    return prepare_batch(RunRequest(SERIALS[0], station, out=tmp_path, serials=SERIALS))


def answering(open_: Devices) -> list[StreamedImu]:
    """Return the units that respond."""
    return [imu for imu in open_.imus if imu is not None]


def refusing(monkeypatch: pytest.MonkeyPatch, *refused: str) -> None:
    """Make units with these serial numbers fail to open."""
    opened = devices.open_imu

    def open_imu(setup: RunConfiguration, port: str) -> StreamedImu:
        if setup.request.serial in refused:
            raise DeviceFaultError("connection.refused", port=port, unit=1, exception=2)
        return opened(setup, port)

    monkeypatch.setattr(devices, "open_imu", open_imu)


def test_all_units_are_opened_and_all_their_bytes_are_read(setups: tuple[RunConfiguration, ...]) -> None:
    with open_devices(setups) as open_:
        imus = answering(open_)
        assert open_.imu is imus[0]
        assert not open_.failed
        assert tuple(imu.identify().serial for imu in imus) == SERIALS
        open_.clock.sleep(1.0)  # they are silent while they start
        for imu in imus:
            imu.read()
        begin, taken = open_.clock.now(), np.zeros(3)
        for _ in range(10):
            open_.clock.sleep(0.4)
            batches = [imu.read() for imu in imus]
            taken += [len(batch) for batch in batches]
            # nothing is left on the way, whatever the computer is busy with
            assert taken == pytest.approx(200.0 * (open_.clock.now() - begin), abs=1.0)
        assert len({batch.counts.tobytes() for batch in batches}) == 3


@pytest.mark.long
def test_sixteen_units_stay_synchronised_at_full_speed(tmp_path: Path) -> None:
    serials = tuple(f"SN-{number:06d}" for number in range(1, 17))
    station = library.find("stations", "virtual_batch")
    request = RunRequest(serials[0], station, out=tmp_path, serials=serials)
    with open_devices(prepare_batch(request)) as open_:
        open_.clock.sleep(1.0)
        imus = answering(open_)
        ends = np.array([imu.read().seq[-1] for imu in imus])
        for _ in range(5):
            open_.clock.sleep(0.4)
            last = np.array([imu.read().seq[-1] for imu in imus])
            assert last - ends == pytest.approx(80.0, abs=1.0)
            ends = last
        assert tuple(imu.identify().serial for imu in imus) == serials


def test_unresponsive_unit_is_left_out(setups: tuple[RunConfiguration, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    refusing(monkeypatch, SERIALS[1])
    with open_devices(setups) as open_:
        assert {index: fault.code for index, fault in open_.failed.items()} == {1: "connection.refused"}
        assert open_.imus[1] is None
        imus = answering(open_)
        assert [imu.identify().serial for imu in imus] == [SERIALS[0], SERIALS[2]]
        open_.clock.sleep(0.4)
        assert all(len(imu.read()) for imu in imus)


def test_fault_of_each_unit_is_reported_if_no_unit_responds(
    setups: tuple[RunConfiguration, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    refusing(monkeypatch, *SERIALS)
    with open_devices(setups) as open_:
        assert open_.imus == (None, None, None)
        assert {index: fault.code for index, fault in open_.failed.items()} == dict.fromkeys(
            range(3), "connection.refused"
        )
        open_.clock.sleep(0.4)
    with raises_code(DeviceFaultError, "connection.refused"), open_devices(setups[:1]):
        raise AssertionError("the only unit does not answer")


def test_simulated_time_does_not_wait_for_a_closed_link(
    setups: tuple[RunConfiguration, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    with open_devices(setups) as open_:
        open_.clock.sleep(0.4)
        first, left, third = answering(open_)
        left.close()
        open_.clock.sleep(0.4)  # within it, the bench notices that the line is closed
        monkeypatch.setattr("calstation.bench.client._READ_TIMEOUT", np.inf)
        for _ in range(5):
            open_.clock.sleep(0.4)
        assert len(first.read())
        assert len(third.read())


def test_two_slots_on_one_port_are_refused(tmp_path: Path) -> None:
    device, link = tmp_path / "ttyUSB0", tmp_path / "by-name"
    device.write_bytes(b"")
    link.symlink_to(device)
    slots = [{"name": "A", "port": str(device)}, {"name": "B", "port": str(link)}]
    table = {"profile": "bench", "port": "tcp://127.0.0.1:502"}
    station = validate(StationConfig, {**STATION, "table": table, "slots": slots}, "station")
    units = tuple(link_test_configuration(LinkTestRequest(station, slot=name)) for name in "AB")
    assert [unit.station.imu.port for unit in units] == [str(device), str(link)]
    with raises_code(ConfigurationError, "connection.same_imu_port"), devices.endpoints(units):
        raise AssertionError("never opened")


@pytest.mark.parametrize("orientation", ["+x+z", "-y-x"])
def test_link_of_each_slot_is_tested(orientation: str) -> None:
    slots = [{"name": "left"}, {"name": "right", "imu": "bench_mems", "orientation": orientation}]
    data: dict[str, Any] = {**STATION, "bench": {"seed": 5, "grade": "mems"}, "slots": slots}
    station = validate(StationConfig, data, "station")
    request = LinkTestRequest(station, library.find("products", "mems_c"), "right")
    setup = link_test_configuration(request)
    assert isinstance(setup.station.imu, SlotSection)
    assert setup.station.imu.orientation == orientation
    report = check_imu_link(ignore_progress, request)
    assert {"identified", "gravity"} <= {finding.id for finding in report.findings}
    assert not [finding for finding in report.findings if finding.state == "error"]
