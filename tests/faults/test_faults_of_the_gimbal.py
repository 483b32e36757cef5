"""Faults of the gimbal and its link: the run stops safely with exit code 3, cause and remedy, never a verdict."""

import pytest

from tests.faults.conftest import FaultRuns, fault
from tests.gimbal_site import GIMBAL, PRODUCT

pytestmark = pytest.mark.long


@pytest.fixture
def gimbal_runs(fault_runs: FaultRuns) -> FaultRuns:
    """Empty folder for runs on the gimbal with faults."""
    fault_runs.product, fault_runs.table = PRODUCT, "gimbal"
    fault_runs.site = {"gravity_mps2": 9.79547}
    return fault_runs


@pytest.mark.parametrize(
    ("kind", "value", "code"),
    [
        ("drive_fault", None, "table.latched_drive"),
        pytest.param("interlock", 0, "table.latched_interlock", marks=pytest.mark.exhaustive),
        pytest.param("trip_watchdog", None, "table.latched_watchdog", marks=pytest.mark.exhaustive),
        ("jam", None, "motion.turn_not_made"),
        ("mute_table", 400, "table.line_unanswered"),
        ("freeze_channel", 2, "stream.stuck"),
    ],
)
def test_fault_during_a_rotation_stops_the_run(
    gimbal_runs: FaultRuns, kind: str, value: float | None, code: str
) -> None:
    order = {**fault(kind, value, step=1, time_s=3.2), "stage": "gimbal"}
    ran = gimbal_runs.run(order, stages=("gimbal",), **GIMBAL)
    assert ran.fault.code == code
    assert ran.fault.exit_code == 3
    ran.assert_stopped()


def test_gimbal_does_not_move_with_the_watchdog_disabled(gimbal_runs: FaultRuns) -> None:
    ran = gimbal_runs.run(stages=("gimbal",), watchdog_ms=0, **GIMBAL)
    assert ran.fault.code == "motion.watchdog_off"
    ran.assert_stopped()


def test_rotation_with_lost_samples_is_repeated_from_zero(gimbal_runs: FaultRuns) -> None:
    order = {"kind": "saturate_imu", "stage": "gimbal", "step": 1, "time_s": 0.5, "value": 0.3}
    ran = gimbal_runs.run(order, stages=("gimbal",), **GIMBAL)
    assert ran.repeated == ["saturated"]
    assert ran.ended.verdict.passed
