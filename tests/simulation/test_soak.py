"""The soak: the same plans for the same seed, every kind in turn, and a judge that knows the truth."""

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from calstation.cli.app import run_app
from calstation.config.resolved import ResolvedConfiguration, resolve_configuration
from calstation.simulation.fault_plan import KINDS
from calstation.simulation.soak_judge import Judged, _left_alone, _set_up, _wrong
from calstation.simulation.soak_plan import DEVICES, OTHER_FAULTS, STAGE_FAULTS, Planned, plans, write_request
from calstation.simulation.soak_series import Soak

pytestmark = pytest.mark.long

GOOD = Planned(0, 5, faulty_unit=False, faults=())


def judged(**changes: Any) -> Judged:
    """A sound run without a fault."""
    run = Judged(GOOD, "passed", None, (), (), (), unsafe=False, samples=9, samples_lost=0, engine_mb=1.0,
                 parent_mb=1.0, seconds=1.0)  # fmt: skip
    return replace(run, **changes)


def test_plans_are_the_same_for_the_same_seed_and_deal_every_kind_in_turn() -> None:
    assert list(plans(30, 4)) == list(plans(30, 4)) != list(plans(30, 5))
    deck = len(STAGE_FAULTS) + len(OTHER_FAULTS)
    dealt = [fault for planned in plans(200, 4) for fault in planned.faults]
    assert len(dealt) > 2 * deck
    assert set(Counter(dealt[:deck]).values()) == {1}
    listened = {"operator_stop", "window_killed"}
    kinds = {kind for kind, _ in (*STAGE_FAULTS, *OTHER_FAULTS)} - listened
    assert kinds < set(KINDS)
    another_unit_or_disk = {"single_bank_flash", "disk_full", "runs_folder_gone"}
    assert set(KINDS) - kinds == another_unit_or_disk


def test_what_is_wrong_lost_unsafe_or_hung_makes_a_soak_unsound() -> None:
    assert Soak([judged()]).sound
    for bad in (
        judged(wrong=("passed with gyro_bias_x off by 7.0 sigma",)),
        judged(lost=("no log",)),
        judged(unsafe=True),
        judged(outcome="hung"),
    ):
        soak = Soak([judged(), bad])
        assert not soak.sound
        assert json.loads(json.dumps(soak.counts()))["runs"] == 2
    assert not Soak([judged()], undelivered=1).sound
    counts = Soak([judged(), judged(injected=("jam",), outcome="fault")]).counts()
    assert counts["faults"] == {"jam": {"injected": 1, "recovered": 0, "stopped_safely": 1}}
    assert (counts["recovered"], counts["stopped_safely"]) == (0, 1)


def test_the_judge_knows_the_truth(tmp_path: Path) -> None:
    from calstation.bench.config import BenchConfig
    from calstation.physics.parameters import INDEX

    request = write_request(GOOD, tmp_path, ("rate", "six_position"))
    setup = resolve_configuration(request)
    truth = BenchConfig.model_validate(setup.bench_config()).truth().imu.parameters
    row = {"value": float(truth[INDEX["accel_bias_x"]]), "sigma": 1e-4}
    check = {"name": "accel_bias_x within", "value": row["value"], "limit": [-0.0074, 0.0074], "unit": "m/s²"}
    check["passed"] = True
    result: dict[str, Any] = {"parameters": {"accel_bias_x": row}, "checks": [check]}
    assert _wrong(GOOD, request, result, "passed", ()) == []
    row["value"] += 7e-4
    (what,) = _wrong(GOOD, request, result, "passed", ())
    assert "accel_bias_x off by 7.0 sigma" in what
    check["limit"], row["value"] = [-1e-9, 1e-9], float(truth[INDEX["accel_bias_x"]])
    (what,) = _wrong(GOOD, request, result, "passed", ())
    assert "outside its limits" in what
    failed = {**result, "checks": [{**check, "passed": False}]}
    assert not _wrong(GOOD, request, failed, "failed", ()), "the truth itself is outside this limit"
    failed = {**result, "checks": [{**check, "limit": [-1.0, 1.0], "passed": False}]}
    assert _wrong(GOOD, request, failed, "failed", ())
    assert _wrong(GOOD, request, failed, "failed", ("jam",))
    assert not _wrong(GOOD, request, failed, "failed", ("wrong_gravity",))
    assert _wrong(GOOD, request, result, "passed", ("wrong_gravity",)) == ["passed with wrong_gravity"]
    assert not _wrong(replace(GOOD, faulty_unit=True), request, failed, "failed", ())
    assert _wrong(GOOD, request, {}, "hung", ())


def test_a_run_that_comes_to_no_verdict_needs_a_reason(tmp_path: Path) -> None:
    request = write_request(GOOD, tmp_path, ("rate",))

    def wrong(*faults: tuple[str, float | None], faulty: bool = False) -> list[str]:
        planned = replace(GOOD, faults=faults, faulty_unit=faulty)
        return _wrong(planned, request, {"error": "table: x"}, "fault", [kind for kind, _ in faults])

    assert wrong() == wrong(("drop_frames", 3)) == ["no verdict without need: table: x"]
    assert not wrong(("silence_imu", 600))
    assert wrong(("silence_imu", 0.4))
    assert not wrong(("silence_imu", 0.4), ("stall", None))
    assert not wrong(faulty=True)


def test_a_short_soak_by_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_app(["soak", "--runs", "2", "--seed", "3", "--keep", str(tmp_path), "--json", "-"]) == 0
    output = capsys.readouterr()
    counts = json.loads(output.out)
    assert counts["runs"] == 2
    assert counts["wrong_verdicts"] == counts["lost_records"] == counts["unsafe"] == 0
    assert counts["samples"] > 5_000
    assert "wrong verdicts" in output.err
    assert len(list((tmp_path / "handover").glob("SN-*.json"))) == 2


@pytest.fixture(scope="module")
def setups(tmp_path_factory: pytest.TempPathFactory) -> dict[str, ResolvedConfiguration]:
    """A run with every choice of devices."""
    return {
        name: resolve_configuration(
            write_request(replace(GOOD, devices=name), tmp_path_factory.mktemp(f"devices{k}"), ("rate",))
        )
        for k, name in enumerate(DEVICES)
    }


def test_only_a_table_without_a_watchdog_may_keep_its_axes_on_when_its_engine_dies(
    setups: dict[str, ResolvedConfiguration],
) -> None:
    alone = {name for name, setup in setups.items() if _left_alone(setup.table)}
    assert alone == {"two drives", "ATL", "ACL", "MN"}


def test_what_a_device_does_not_have_is_no_fault_of_it(setups: dict[str, ResolvedConfiguration]) -> None:
    for kind, without in (
        ("watchdog_off", {"two drives", "ATL", "ACL", "MN"}),
        ("never_ready", {"VN-100"}),
        ("wrong_unit", set()),
    ):
        assert {name for name, setup in setups.items() if not _set_up(kind, setup)} == without, kind
    assert not _set_up("stall", setups["ATL"])
