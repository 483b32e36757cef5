"""Faults of the IMU, its link, mounting and supply: no wrong verdict and no partly written registers."""

from pathlib import Path

import numpy as np
import pytest
from helpers import ignore_progress

from calstation.errors import ConfigurationError
from calstation.records import open_log
from calstation.registers import journal as register_journal
from calstation.results import resolve
from calstation.runs import find_resumable
from calstation.sequencer import Message, StepStarted, Trace
from tests.faults.conftest import SERIAL, FaultRuns, fault
from tests.helpers import error_code, sampled
from tests.site_folder import PRODUCT, QUICK

pytestmark = pytest.mark.long


@pytest.mark.parametrize(
    ("kind", "value", "words"),
    [
        ("silence_imu", 600, ("no data arrive although", "check cable, power")),
        ("garble_imu", 600, ("check baud, parity",)),
        ("saturate_imu", 600, ("saturates", "lower the rate")),
        ("invalid_imu", 600, ("saturates", "lower the rate")),
        ("freeze_channel", 4, ("accel y shows the same value", "switch the unit off and on")),
        ("hang_up_imu", None, ("port", "check cable and power")),
    ],
)
def test_a_fault_of_the_unit_stops_the_run(
    fault_runs: FaultRuns, kind: str, value: float | None, words: tuple[str, ...]
) -> None:
    ran = fault_runs.run(fault(kind, value))
    ran.assert_stopped("IMU: ", *words)
    assert len(ran.repeated) <= 3, "bounded"


@pytest.fixture
def floats(fault_runs: FaultRuns) -> FaultRuns:
    """Runs with a unit that sends float32 without a status: only the values show that they are invalid."""
    loose = {"within": 2e-2, "sigma_below": 1e-2}
    fault_runs.product = {
        **PRODUCT,
        "imu": "vectornav_vn100",
        "bench_grade": "mems",
        "limits": {"gyro_scale": loose, "accel_scale": loose},
    }
    return fault_runs


@pytest.mark.parametrize(
    ("kind", "value", "reason", "words"),
    [
        ("invalid_imu", 600, "invalid", ("non-numeric samples repeatedly", "switch the unit off and on")),
        ("saturate_imu", 600, "saturated", ("saturates", "lower the rate")),
        ("freeze_channel", 4, "", ("accel y shows the same value", "switch the unit off and on")),
    ],
)
def test_invalid_float_output_stops_the_run(
    floats: FaultRuns, kind: str, value: float, reason: str, words: tuple[str, ...]
) -> None:
    ran = floats.run(fault(kind, value))
    ran.assert_stopped("IMU: ", *words)
    assert ran.repeated == ([reason] * 3 if reason else [])


def test_non_numeric_samples_are_marked_and_their_step_is_repeated(floats: FaultRuns) -> None:
    ran = floats.run(fault("invalid_imu", 0.2))
    assert ran.ended.verdict.passed, ran.events[-3:]
    assert ran.repeated == ["invalid"]
    blocks = list(open_log(Path(ran.ended.log)).blocks())
    counts = np.concatenate([block.counts for block in blocks])
    valid = np.concatenate([block.valid for block in blocks])
    spoilt = np.isnan(counts).any(axis=1)
    assert 10 <= spoilt.sum() < 100
    assert not valid[spoilt].any()
    traced = [event.output for event in ran.events if isinstance(event, Trace)]
    assert traced
    assert all(np.isfinite(output).all() for output in traced), "a window draws every trace"


@pytest.mark.parametrize(
    ("kind", "value", "words"),
    [
        ("invalid_imu", 600.0, ("non-numeric samples", "switch the unit off and on")),
        ("saturate_imu", 600.0, ("saturates although the table is at rest", "what shakes the unit")),
    ],
)
def test_invalid_output_is_reported_before_any_motion(
    floats: FaultRuns, kind: str, value: float, words: tuple[str, ...]
) -> None:
    ran = floats.run({"kind": kind, "value": value})
    ran.assert_stopped("IMU: ", *words)
    assert not [event for event in ran.events if isinstance(event, StepStarted)]


@pytest.mark.parametrize(
    ("planned", "words"),
    [
        ({"kind": "wrong_unit"}, ("reports serial number 'sn-000042-other'", "check the unit")),
        ({"kind": "mounted_otherwise"}, ("away from the declared mounting", "check how the unit is mounted")),
        ({"kind": "garble_imu", "value": 600.0}, ("check baud",)),
    ],
)
def test_wrong_unit_mounting_or_baud_rate_is_reported_before_any_stage(
    fault_runs: FaultRuns, planned: dict[str, str], words: tuple[str, ...]
) -> None:
    fault_runs.run(planned).assert_stopped("IMU: ", *words)


@pytest.mark.parametrize(
    ("time_s", "repeated"),
    sampled(
        2, [4.0, 4.7], [("drop_frames", 3, "gap"), ("saturate_imu", 0.1, "saturated"), ("silence_imu", 8.0, "no_data")]
    ),
)
def test_faults_in_the_rest_before_a_repeated_step_are_detected(
    fault_runs: FaultRuns, time_s: float, repeated: tuple[str, float, str]
) -> None:
    kind, value, reason = repeated
    ran = fault_runs.run(fault("drop_frames", 3, step=9), fault(kind, value, step=11, time_s=time_s))
    assert ran.ended.verdict.passed
    assert ran.repeated == ["gap", reason]


def test_brief_line_noise_repeats_one_step(fault_runs: FaultRuns) -> None:
    ran = fault_runs.run(fault("garble_imu", 0.8, step=9))
    assert ran.ended.verdict.passed
    assert len(ran.repeated) == 1


@pytest.mark.exhaustive
def test_reconnected_adapter_works_again(fault_runs: FaultRuns) -> None:
    fault_runs.run(fault("hang_up_imu")).assert_stopped("port")
    assert fault_runs.run().ended.verdict.passed


def test_gyros_detect_a_wrong_latitude_before_any_register_is_written(fault_runs: FaultRuns) -> None:
    rests = {**PRODUCT["schedule"], "six_position": {"dwell_s": 10.0, **QUICK}}
    fault_runs.product = {**PRODUCT, "schedule": rests}
    ran = fault_runs.run({"kind": "wrong_latitude", "value": -2.0}, stages=("rate", "six_position", "azimuth_flip"))
    ran.assert_stopped(
        "site.latitude_deg of the station file is 32.25", "the earth rate of latitude 34.", "correct latitude"
    )
    assert ran.fault.code == "site.latitude_contradicts"
    assert ran.ended.result["stages"] == ["rate", "six_position"]
    assert ran.ended.result["registers"]["new"] is None
    assert [c["name"] for c in ran.ended.result["checks"] if not c["passed"]] == ["latitude"]
    assert not register_journal.history(fault_runs.folder / "runs", SERIAL)
    assert ran.ended.result["advice"] != "resume"
    assert find_resumable(ignore_progress, fault_runs.folder / "runs") == []


def test_the_verification_detects_a_wrong_latitude(fault_runs: FaultRuns) -> None:
    ran = fault_runs.run({"kind": "wrong_latitude", "value": 5.0}, stages=("rate",))
    ran.assert_stopped("vertical earth rate", "old registers were restored", "latitude")
    assert (ran.fault.code, ran.fault.values["check"]) == ("verification.wrong", "earth_rate_up")
    (entry,) = register_journal.history(fault_runs.folder / "runs", SERIAL)
    assert entry.closing == "restored"


def test_inconsistent_stage_without_a_latitude_estimate_mentions_the_latitude(fault_runs: FaultRuns) -> None:
    ran = fault_runs.run({"kind": "wrong_latitude", "value": -24.25}, stages=("azimuth_flip",))
    assert ran.ended.verdict == "failed"
    (unknown,) = [e.values for e in ran.events if isinstance(e, Message) and e.id == "latitude_untold"]
    assert unknown == ran.ended.result["latitude_untold"] == {"stage": "azimuth_flip", "latitude": 10.0}
    assert resolve(Path(ran.ended.log)).messages[-1] == ("latitude_untold", unknown)


@pytest.mark.parametrize("degrees", [-10.0, 10.0])
def test_gyros_that_cannot_resolve_earth_rate_need_consistent_gravity_and_latitude(
    fault_runs: FaultRuns, degrees: float
) -> None:
    fault_runs.product = {**PRODUCT, "imu": "bench_mems"}
    with pytest.raises(ConfigurationError, match=r"Add the local gravity") as missing:
        fault_runs.run(stages=("six_position",))
    assert error_code(missing.value) == "site.gravity_mps2 site.gravity_missing"
    fault_runs.site = {"gravity_mps2": 9.79547}
    with pytest.raises(ConfigurationError, match=r"Correct gravity, latitude or height") as contradicting:
        fault_runs.run({"kind": "wrong_latitude", "value": degrees}, stages=("six_position",))
    assert error_code(contradicting.value) == "site.gravity_mps2 site.gravity_contradicts"
    assert not list((fault_runs.folder / "runs").glob("*.h5"))


def test_run_with_wrong_gravity_never_passes(fault_runs: FaultRuns) -> None:
    ran = fault_runs.run({"kind": "wrong_gravity", "value": 0.03}, stages=("six_position",))
    assert ran.ended.verdict == "failed"
    assert ran.ended.result["registers"]["new"] is None
    missed = [check["name"] for check in ran.ended.result["checks"] if not check["passed"]]
    assert {"accel_scale_x within", "accel_scale_y within", "accel_scale_z within"} <= set(missed)


def test_brown_out_during_the_write_is_a_fault_and_keeps_the_registers(fault_runs: FaultRuns) -> None:
    # Behind the mark, the biases and the gyros' matrix, which is then lost.
    ran = fault_runs.run({"kind": "brown_out_write", "value": 75.0})
    ran.assert_stopped(
        "before the commit. The unit was restarted and contains its old registers.", "Check the unit's supply"
    )
    assert ran.bench["flash_cycles"] == 0
    (entry,) = register_journal.history(fault_runs.folder / "runs", SERIAL)
    assert (entry.closing, entry.cycles) == ("kept", 0)
    assert ran.ended.result["registers"]["verified"] is False


def test_register_page_lost_in_a_brown_out_is_reported(fault_runs: FaultRuns) -> None:
    loose = {"within": 2e-2, "sigma_below": 1e-2}
    limits = {"gyro_scale": loose, "accel_scale": loose}
    fault_runs.product = {**PRODUCT, "imu": "dsp_modbus", "bench_grade": "mems", "limits": limits}
    ran = fault_runs.run({"kind": "brown_out_write", "value": 20.0})
    ran.assert_stopped("IMU: Register 118 is refused: no such register", "Check its power supply (a unit that restarts")
    assert ran.bench["flash_cycles"] == 0


@pytest.mark.exhaustive
def test_a_brown_out_during_the_commit_is_recovered_at_the_next_start(fault_runs: FaultRuns) -> None:
    runs = fault_runs.folder / "runs"
    fault_runs.run({"kind": "brown_out_commit", "value": 60.0}).assert_stopped("contains its old registers")
    ran = fault_runs.run({"kind": "brown_out_commit", "value": 128.0})
    ran.assert_stopped("new registers, which are not yet verified")
    assert ran.ended.result["advice"] == "repeat", "a resumed run would be refused because of the new registers"
    assert find_resumable(ignore_progress, runs) == []
    refused = fault_runs.run()
    refused.assert_stopped("was interrupted", "registers finish")
    offers = [e.values["offers"] for e in refused.events if isinstance(e, Message) and e.id == "transfer_open"]
    assert offers == [["finish", "restore"]]
    assert fault_runs.run(unfinished="finish").ended.verdict.passed
    closings = [transfer.closing for transfer in register_journal.history(runs, SERIAL)]
    assert closings == ["kept", "done", "done"]
    flash = Path(fault_runs.folder / "flash.bin").read_bytes()
    assert int.from_bytes(flash[:4], "little") == 3 == register_journal.cycles(runs, SERIAL)
