"""The soak test: reproducible plans, every fault in turn, and assessment by the truth of the bench."""

import json
import threading
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from calstation.bench import BenchConfig, BenchReport
from calstation.cli.app import run_app
from calstation.config import RunConfiguration, load_configuration
from calstation.physics import INDEX
from calstation.results import Result
from calstation.simulation import Soak, bench_config
from calstation.simulation.fault_plan import KINDS
from calstation.simulation.soak_judge import (
    RunEvaluation,
    _bench_report,
    _keeps_axes_on,
    _takes_effect,
    _verdict_errors,
)
from calstation.simulation.soak_plan import OTHER_FAULTS, STAGE_FAULTS, PlannedRun, devices, plans, write_request
from tests.check_rows import check_row

pytestmark = pytest.mark.long

GOOD = PlannedRun(0, 5, faulty_unit=False, faults=())


def judged(**changes: Any) -> RunEvaluation:
    """Return a correct run without a fault."""
    run = RunEvaluation(GOOD, "passed", None, (), (), (), unsafe=False, samples=9, samples_lost=0, engine_mb=1.0,
                 parent_mb=1.0, seconds=1.0)  # fmt: skip
    return replace(run, **changes)


def test_plans_are_reproducible_and_use_every_fault_before_any_repeats() -> None:
    assert list(plans(30, 4)) == list(plans(30, 4)) != list(plans(30, 5))
    deck = len(STAGE_FAULTS) + len(OTHER_FAULTS)
    drawn = [fault for planned in plans(200, 4) for fault in planned.faults]
    assert len(drawn) > 2 * deck
    assert set(Counter(drawn[:deck]).values()) == {1}
    from_listener = {"operator_stop", "window_killed"}
    kinds = {kind for kind, _ in (*STAGE_FAULTS, *OTHER_FAULTS)} - from_listener
    assert kinds < set(KINDS)
    not_in_a_soak = {"single_bank_flash", "disk_full", "runs_folder_gone"}
    not_in_a_soak |= {kind for kind in KINDS if "chamber" in kind or kind.startswith("temperature_")}
    assert set(KINDS) - kinds == not_in_a_soak


def test_wrong_lost_unsafe_or_hung_run_fails_the_soak_test() -> None:
    assert Soak([judged()]).passed
    for bad in (
        judged(verdict_errors=("passed with gyro_bias_x off by 7.0 sigma",)),
        judged(record_defects=("no log",)),
        judged(unsafe=True),
        judged(outcome="hung"),
    ):
        soak = Soak([judged(), bad])
        assert not soak.passed
        assert json.loads(json.dumps(soak.counts()))["runs"] == 2
    assert not Soak([judged()], undelivered=1).passed
    counts = Soak([judged(), judged(injected=("jam",), outcome="fault")]).counts()
    assert counts["faults"] == {"jam": {"injected": 1, "recovered": 0, "stopped_safely": 1}}
    assert (counts["recovered"], counts["stopped_safely"]) == (0, 1)


def result_of(outcome: str, **sections: Any) -> Result:
    """Return a result with these sections."""
    needed = {"schema": "calstation.result/1", "unit": {"serial": "SN-1"}, "stages": [], "log": {"file": "a.h5"}}
    return Result.from_json({**needed, "outcome": outcome, "parameters": {}, **sections})


def test_verdicts_are_assessed_by_the_truth(tmp_path: Path) -> None:
    request = write_request(GOOD, tmp_path, ("rate", "six_position"))
    setup = load_configuration(request)
    truth = float(BenchConfig.model_validate(bench_config(setup)).truth().parameters[INDEX["accel_bias_x"]])

    def verdict_errors(
        happened: tuple[str, ...] = (), *, error: float = 0.0, limit: float = 0.0074, failed: bool = False, faulty=False
    ) -> list[str]:
        row = {"value": truth + error, "sigma": 1e-4}
        check = check_row("within", "accel_bias_x", row["value"], [-limit, limit], passed=not failed, unit="m/s²")
        outcome = "failed" if failed else "passed"
        result = result_of(outcome, parameters={"accel_bias_x": row}, checks=[check])
        return _verdict_errors(replace(GOOD, faulty_unit=faulty), request, result, outcome, happened)

    assert verdict_errors() == []
    assert verdict_errors(error=7e-4) == ["passed with accel_bias_x off by 7.0 sigma"]
    assert verdict_errors(limit=1e-9) == ["passed with accel_bias_x outside its limits"]
    assert not verdict_errors(limit=1e-9, failed=True), "the truth itself is outside this limit"
    assert verdict_errors(limit=1.0, failed=True)
    assert verdict_errors(("jam",), limit=1.0, failed=True)
    assert not verdict_errors(("wrong_gravity",), limit=1.0, failed=True)
    assert verdict_errors(("wrong_gravity",)) == ["passed with wrong_gravity"]
    assert not verdict_errors(limit=1.0, failed=True, faulty=True)
    assert _verdict_errors(GOOD, request, None, "hung", ())


def test_soak_test_waits_for_a_report_that_is_being_written(tmp_path: Path) -> None:
    report = BenchReport(enabled=False, moving=False, fault="NONE", executed=(), samples=1, time=1.0, flash_cycles=0)
    path = tmp_path / "report.json"
    path.write_text("{", encoding="utf-8")
    writing = threading.Timer(0.3, lambda: path.write_text(report.model_dump_json(), encoding="utf-8"))
    writing.start()
    assert _bench_report(path) == report
    writing.join()


def test_run_without_a_verdict_requires_a_reason(tmp_path: Path) -> None:
    request = write_request(GOOD, tmp_path, ("rate",))

    def verdict_errors(*faults: tuple[str, float | None], faulty: bool = False) -> list[str]:
        planned = replace(GOOD, faults=faults, faulty_unit=faulty)
        return _verdict_errors(
            planned, request, result_of("fault", error="table: x"), "fault", [kind for kind, _ in faults]
        )

    assert verdict_errors() == verdict_errors(("drop_frames", 3)) == ["no verdict without need: table: x"]
    assert not verdict_errors(("silence_imu", 600))
    assert verdict_errors(("silence_imu", 0.4))
    assert not verdict_errors(("silence_imu", 0.4), ("stall", None))
    assert not verdict_errors(faulty=True)


def test_short_soak_test_passes_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_app(["soak", "--runs", "2", "--seed", "3", "--keep", str(tmp_path), "--json", "-"]) == 0
    output = capsys.readouterr()
    counts = json.loads(output.out)
    assert counts["runs"] == 2
    assert counts["wrong_verdicts"] == counts["lost_records"] == counts["unsafe"] == 0
    assert counts["samples"] > 5_000
    assert "wrong verdicts" in output.err
    assert len(list((tmp_path / "handover").glob("SN-*.json"))) == 2


@pytest.fixture(scope="module")
def setups(tmp_path_factory: pytest.TempPathFactory) -> dict[str, RunConfiguration]:
    """Configurations of runs with every choice of devices."""
    return {
        name: load_configuration(
            write_request(replace(GOOD, devices=name), tmp_path_factory.mktemp(f"devices{k}"), ("rate",))
        )
        for k, name in enumerate(devices())
    }


def test_only_tables_without_a_watchdog_may_keep_axes_on_after_a_killed_engine(
    setups: dict[str, RunConfiguration],
) -> None:
    kept_on = {name for name, setup in setups.items() if _keeps_axes_on(setup.table)}
    assert kept_on == {"cia402_drives", "aerosmith_atl", "acutronic_acl", "mn_ascii"}


def test_fault_that_a_device_cannot_have_is_not_counted(setups: dict[str, RunConfiguration]) -> None:
    for kind, without in (
        ("watchdog_off", {"cia402_drives", "aerosmith_atl", "acutronic_acl", "mn_ascii"}),
        ("never_ready", {"vectornav_vn100"}),
        ("wrong_unit", set()),
    ):
        assert {name for name, setup in setups.items() if not _takes_effect(kind, setup)} == without, kind
    assert not _takes_effect("stall", setups["aerosmith_atl"])
