"""A unit restarts unexpectedly, on each protocol: a good unit never fails and its flash is not written again."""

from pathlib import Path
from typing import Any

import pytest

from calstation.bench.imu import UNITS
from calstation.errors import ConfigurationError
from calstation.registers import journal as register_journal
from calstation.sequencer import Message
from calstation.simulation.fault_plan import load_fault_plan
from tests.faults.conftest import SERIAL, FaultRuns, Ran
from tests.helpers import sampled
from tests.registers.operations import RegisterOperations
from tests.runs.test_manual_rig import PRODUCT as BY_HAND
from tests.site_folder import PRODUCT

pytestmark = pytest.mark.long

IMUS = tuple(unit.profile for unit in UNITS.values())
LOOSE = {"within": 2e-2, "sigma_below": 1e-2}


def with_imu(fault_runs: FaultRuns, imu: str) -> FaultRuns:
    """Return runs with a unit of another protocol."""
    limits = {"gyro_scale": LOOSE, "accel_scale": LOOSE}
    fault_runs.product = {**PRODUCT, "imu": imu, "bench_grade": "mems", "limits": limits}
    return fault_runs


def restart(stage: str, *times: float) -> list[dict[str, Any]]:
    """Return the plan of restarts at times after the start of a stage or a capture, s."""
    return [{"kind": "reset_imu", "stage": stage, "time_s": time} for time in times]


def assert_verified(fault_runs: FaultRuns, ran: Ran) -> None:
    """Assert that the unit passed, its registers were verified and its flash written once."""
    assert ran.ended.verdict.passed, ran.events[-3:]
    assert "reset_imu" in ran.bench["executed"]
    registers = ran.ended.result["registers"]
    assert (registers["verified"], registers["proved_on"]) == (True, "corrected_output")
    assert ran.bench["flash_cycles"] == 1
    (entry,) = register_journal.history(fault_runs.folder / "runs", SERIAL)
    assert (entry.closing, entry.cycles) == ("done", 1)


def repeated_captures(ran: Ran) -> int:
    return [event.id for event in ran.events if isinstance(event, Message)].count("look_repeated")


@pytest.mark.parametrize(
    ("imu", "reason"), [("bench_mems", "gap"), ("dsp_modbus", "gap"), ("vectornav_vn100", "no_data")]
)
def test_a_restart_during_a_stage_repeats_the_step(fault_runs: FaultRuns, imu: str, reason: str) -> None:
    ran = with_imu(fault_runs, imu).run(*restart("rate", 6.0))
    assert_verified(fault_runs, ran)
    assert ran.repeated == [reason]
    assert ran.ended.result["log"]["gaps"] == 1


@pytest.mark.parametrize(("imu", "moment"), sampled(9, IMUS, [0.3, 3.0, 8.0, 14.0, 20.0, 26.0]))
def test_a_restart_during_the_verification_repeats_the_capture(fault_runs: FaultRuns, imu: str, moment: float) -> None:
    ran = with_imu(fault_runs, imu).run(*restart("verifying", moment))
    assert_verified(fault_runs, ran)
    assert repeated_captures(ran) <= 1


@pytest.mark.parametrize("imu", sampled(2, IMUS))
def test_a_restart_before_the_write_repeats_the_reference_capture(fault_runs: FaultRuns, imu: str) -> None:
    ran = with_imu(fault_runs, imu).run(*restart("reference", 9.0))
    assert_verified(fault_runs, ran)
    assert repeated_captures(ran) == 1


@pytest.mark.parametrize("imu", sampled(3, IMUS))
def test_repeated_restarts_are_a_fault_and_leave_the_transfer_open(fault_runs: FaultRuns, imu: str) -> None:
    ran = with_imu(fault_runs, imu).run(*restart("verifying", *range(6, 60, 6)))
    ran.assert_stopped("IMU: the unit restarted while its new registers were verified", "check its supply")
    assert ran.bench["flash_cycles"] == 1
    (entry,) = register_journal.history(fault_runs.folder / "runs", SERIAL)
    assert (entry.closing, entry.steps[-1]) == (None, "restarted")
    again = fault_runs.run()
    again.assert_stopped("was interrupted", "registers finish")
    assert fault_runs.run(unfinished="finish").ended.verdict.passed
    first, _ = register_journal.history(fault_runs.folder / "runs", SERIAL)
    assert (first.closing, first.cycles) == ("done", 1)


@pytest.mark.parametrize("imu", sampled(2, IMUS))
def test_a_restart_at_rest_repeats_the_capture(fault_runs: FaultRuns, imu: str) -> None:
    operations = RegisterOperations(with_imu(fault_runs, imu).request(orders=[{"order": "reset_imu", "at": 17.0}]))
    assert operations.write({"accel_bias_x": 5e-3}, at_rest=True).proof == "rest"
    assert Ran(fault_runs.folder).bench["executed"] == ["reset_imu"]
    (entry,) = register_journal.history(fault_runs.folder / "runs", SERIAL)
    assert (entry.closing, entry.cycles) == ("done", 1)


@pytest.mark.parametrize("imu", sampled(2, ["bench_mems", "dsp_modbus"]))
def test_a_restart_on_a_manual_rig_requests_the_position_again(fault_runs: FaultRuns, imu: str) -> None:
    fault_runs.product, fault_runs.table = {**PRODUCT, **BY_HAND, "imu": imu}, "hand_rails"
    fault_runs.site = {"gravity_mps2": 9.79547}
    fault_runs.product["limits"] = {"gyro_scale": LOOSE, "accel_scale": LOOSE}
    ran = fault_runs.run(*restart("verifying", 5.0), stages=("multi_position",))
    assert_verified(fault_runs, ran)


def test_fault_plan_with_steps_of_a_capture_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "plan.toml"
    path.write_text('[[fault]]\nkind = "reset_imu"\nstage = "verifying"\nstep = 2\n', encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"'verifying' has no steps\. Give time_s"):
        load_fault_plan(path)
