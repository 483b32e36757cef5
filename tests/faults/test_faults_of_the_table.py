"""Faults of the table and its link: the run stops safely and reports cause and remedy without a verdict."""

import struct
import sys

import pytest

from calstation.devices.links import ModbusLink, ModbusRefusalError
from calstation.devices.profiles import SerialSettings
from calstation.sequencer import StepStarted
from calstation.simulation.soak_plan import devices
from tests.connection.fake_links import server, tcp_pdu
from tests.faults.conftest import FaultRuns, fault
from tests.helpers import sampled

pytestmark = pytest.mark.long


@pytest.mark.parametrize(
    ("kind", "value", "words"),
    [
        pytest.param("stall", None, ("fault 'stall'", "then run calstation table reset"), marks=pytest.mark.exhaustive),
        ("drive_fault", None, ("fault 'drive'", "calstation table reset")),
        pytest.param(
            "limit_fault", None, ("fault 'limit'", "then run calstation table reset"), marks=pytest.mark.exhaustive
        ),
        ("trip_watchdog", None, ("fault 'watchdog'", "run calstation table reset")),
        pytest.param("interlock", 0, ("interlock",), marks=pytest.mark.exhaustive),
        ("jam", None, ("did not reach", "obstacle")),
        pytest.param(
            "overshoot", 2, ("the table is 2.", "° away from outer 360.0°", "encoder"), marks=pytest.mark.exhaustive
        ),
        pytest.param("never_settle", 600, ("does not settle", "tuning"), marks=pytest.mark.exhaustive),
        ("mute_table", 40, ("no response", "check cable, power")),
        ("refuse_table", 4, ("cannot do it in its current state", "drive's display")),
    ],
)
def test_a_fault_of_the_table_stops_the_run(
    fault_runs: FaultRuns, kind: str, value: float | None, words: tuple[str, ...]
) -> None:
    fault_runs.run(fault(kind, value)).assert_stopped("table: ", *words)


@pytest.mark.parametrize(
    ("profile", "stopped"),
    sampled(
        5,
        [name for name, (_, station, _) in devices().items() if "table" in station],
        [
            ("stall", None, ("fault", "then run calstation table reset")),
            ("drive_fault", None, ("fault", "then run calstation table reset")),
            ("limit_fault", None, ("fault", "then run calstation table reset")),
            ("interlock", 0, ("fault", "then run calstation table reset")),
            ("jam", None, ("outer 360.0°", "obstacle")),
            ("overshoot", 2, ("the table is 2.", "° away from outer 360.0°")),
            ("never_settle", 600, ("does not settle", "tuning")),
        ],
    ),
)
def test_a_fault_stops_the_run_on_every_protocol(
    fault_runs: FaultRuns, profile: str, stopped: tuple[str, float | None, tuple[str, ...]]
) -> None:
    kind, value, words = stopped
    fault_runs.table = profile
    ran = fault_runs.run(fault(kind, value))
    ran.assert_stopped("table: ", *words)
    if "fault" in words:
        no_cause = profile == "acutronic_acl"
        assert (ran.fault.code == "table.latched_unknown") == no_cause
        assert ran.fault.code.startswith("table.latched_")


def test_command_rejected_by_one_of_two_drives_stops_the_run(fault_runs: FaultRuns) -> None:
    fault_runs.table = "cia402_drives"
    ran = fault_runs.run(fault("refuse_table", 4))
    ran.assert_stopped("table: ", "cannot do it in its current state", "drive's display")


def test_unresponsive_table_without_a_watchdog_completes_its_move_and_rests(fault_runs: FaultRuns) -> None:
    fault_runs.table = "mn_ascii"
    ran = fault_runs.run(fault("mute_table", 400))
    assert ran.ended.verdict == "fault"
    assert "gets no response" in ran.fault.text
    assert not ran.bench["moving"]
    assert ran.moves_after_fault() == 0


@pytest.mark.parametrize(
    ("planned", "words"),
    [
        ({"kind": "watchdog_off"}, ("watchdog is off", "set its timeout")),
        ({"kind": "interlock_open"}, ("interlock is open", "close the cover")),
        ({"kind": "drive_fault"}, ("fault 'drive'", "calstation table reset")),
    ],
)
def test_a_table_with_a_latched_fault_is_not_moved(
    fault_runs: FaultRuns, planned: dict[str, str], words: tuple[str, ...]
) -> None:
    ran = fault_runs.run(planned)
    ran.assert_stopped("table: ", *words)
    assert not [event for event in ran.events if isinstance(event, StepStarted)]
    assert ran.bench["fault"] == ("DRIVE" if planned["kind"] == "drive_fault" else "NONE"), "it was not reset"


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals exist only on POSIX systems")
def test_requests_with_wrong_checksums_are_repeated(fault_runs: FaultRuns) -> None:
    ran = fault_runs.run(fault("garble_table", 2), stages=("rate",), table_transport="rtu")
    assert ran.ended.verdict.passed
    assert "garble_table" in ran.bench["executed"]


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals exist only on POSIX systems")
def test_line_with_only_wrong_checksums_stops_the_run(fault_runs: FaultRuns) -> None:
    """As at a wrong baud rate, every response of the table is damaged, and its own watchdog stops it."""
    ran = fault_runs.run(fault("garble_table", 100_000), table_transport="rtu", watchdog_ms=1000)
    ran.assert_stopped("Table: ", "cannot be read on", "Check cable, power and unit number")
    assert ran.bench["fault"] == "WATCHDOG"


@pytest.mark.parametrize("code", [1, 2, 3, 4, 5, 6, 7, 8, 10, 11])
def test_every_modbus_exception_has_a_remedy_and_only_busy_is_retried(code: int) -> None:
    asked: list[bytes] = []

    def answer(heard: bytes) -> bytes:
        asked.append(heard)
        return tcp_pdu(heard, bytes([heard[7] | 0x80, code]))

    with server(answer) as address:
        link = ModbusLink(f"tcp://{address}", 1, 1.0, SerialSettings())
        with pytest.raises(ModbusRefusalError) as caught:
            link.read(0, 2)
        assert (caught.value.exception, caught.value.unit) == (code, 1)
        assert caught.value.render().remedy
        assert len(asked) == (3 if code in (5, 6) else 1)
        asked.clear()
        with pytest.raises(ModbusRefusalError):
            link.write(5, [1], repeat=False)
        assert len(asked) == 1, "a command that must not be repeated is sent once"
        link.close()


def test_request_to_a_busy_table_is_repeated() -> None:
    answers = [bytes([0x83, 6]), bytes([3, 2]) + struct.pack(">H", 77)]
    with server(lambda heard: tcp_pdu(heard, answers.pop(0))) as address:
        link = ModbusLink(f"tcp://{address}", 1, 1.0, SerialSettings())
        assert link.read(0, 1) == [77]
        link.close()
