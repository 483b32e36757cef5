"""A USB adapter is disconnected during a run and has another port name when it is reconnected."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from serial.tools import list_ports

from calstation.config import RunConfiguration, RunRequest
from calstation.connection import devices as wiring
from calstation.runs import execute
from calstation.sequencer import Control, Event, Fault, Finalized, StageStarted
from tests.faults.conftest import SERIAL, FaultRuns
from tests.site_folder import PRODUCT, QUICK

pytestmark = [pytest.mark.long, pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals")]

ADAPTER = "A9XYZ"


@pytest.fixture
def names(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Port names that the adapter has had; the station identifies it only by its serial number."""
    had: list[str] = []
    endpoints = wiring.endpoints

    def ports() -> list[SimpleNamespace]:
        about = {"description": "UART", "manufacturer": "FTDI", "location": "1-2", "serial_number": ADAPTER}
        return [SimpleNamespace(device=had[-1], name=Path(had[-1]).name, **about)]

    @contextmanager
    def by_adapter(
        setups: tuple[RunConfiguration, ...], check_cancelled: Callable[[], None]
    ) -> Iterator[wiring.Endpoints]:
        with endpoints(setups, check_cancelled) as at:
            had.append(at.imu)
            yield replace(at, imus=(f"usb:{ADAPTER}",))

    monkeypatch.setattr(list_ports, "comports", ports)
    monkeypatch.setattr(wiring, "endpoints", by_adapter)
    return had


def test_disconnected_adapter_is_a_fault_and_the_run_can_be_resumed(fault_runs: FaultRuns, names: list[str]) -> None:
    fault_runs.product = {
        **PRODUCT,
        "schedule": {
            "rate": {"turns": 1, "dwell_s": 2.0, **QUICK},
            "six_position": {"dwell_s": 2.0, **QUICK},
        },
        "limits": {"gyro_scale": {"within": 0.1}},
    }
    pulled = {"kind": "hang_up_imu", "stage": "six_position", "step": 3, "time_s": 0.2}
    ran = fault_runs.run(pulled, stages=("rate", "six_position"), imu_transport="pty")
    ran.assert_stopped("IMU: ", f"port usb:{ADAPTER}", "check cable and power")

    taken = [os.openpty() for _ in range(2)]  # the names that are free now are not the adapter's any more
    events: list[Event] = []
    request = RunRequest(SERIAL, fault_runs.folder / "station.toml", fault_runs.folder / "product.toml")
    try:
        execute(replace(request, resume=Path(ran.ended.log)), events.append, Control())
    finally:
        for end in (end for pair in taken for end in pair):
            os.close(end)
    assert names[0] != names[1]
    assert not [event for event in events if isinstance(event, Fault)]
    assert [event.stage for event in events if isinstance(event, StageStarted)] == ["six_position"]
    ended = events[-1]
    assert isinstance(ended, Finalized)
    assert ended.verdict.passed, ended.result
    assert ended.result["stages"] == ["rate", "six_position"]
