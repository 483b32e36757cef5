"""Runs at a gimbal station: correction, verdict, register write, verification, re-solving, and stops in any state."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar, cast

import numpy as np
import pytest
import tomli_w

from calstation.config import (
    RunRequest,
    check_station,
    library,
    load_station,
    schedule_options,
)
from calstation.connection import Devices, LinkTestRequest, check_table_link
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.messages import Text
from calstation.physics import NAMES, group_indices
from calstation.records import open_log
from calstation.results import compute_preview, resolve
from calstation.runs import run_summary
from calstation.sequencer import Command, GimbalTurned, JointsMoved, StateChanged, StepStarted
from calstation.sequencer.control_loop import ControlLoop
from calstation.sequencer.gimbal import GimbalLoop
from calstation.sequencer.guard import check_joints
from calstation.simulation import BenchHooks
from tests.gimbal_site import SCHEDULE, GimbalSite
from tests.helpers import raises_code
from tests.prepared import prepare_run
from tests.site_folder import STATION

MISALIGNMENTS = [NAMES[i] for i in group_indices("gyro_misalign")]


@pytest.fixture
def site(tmp_path: Path) -> GimbalSite:
    return GimbalSite(tmp_path)


class Recorded(BenchHooks):
    """Hooks that record the calls that move the gimbal or change the unit's registers."""

    calls: ClassVar[list[str]] = []
    written: ClassVar[list[dict[str, float]]] = []

    def connected(self, devices: Devices) -> None:
        super().connected(devices)
        self.calls.clear()
        self.written.clear()
        for name in ("home", "lock", "stabilise", "turn", "stop"):
            setattr(devices.table, name, self.recorded(name, getattr(devices.table, name)))
        for name in ("write_registers", "commit", "reset"):
            setattr(devices.imu, name, self.recorded(name, getattr(devices.imu, name)))

    def recorded(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def recorded(*values: Any) -> Any:
            self.calls.append(name)
            if name == "write_registers":
                self.written.append(dict(values[0]))
            return call(*values)

        return recorded


@pytest.mark.long
def test_run_writes_and_verifies_the_correction_and_re_solves_bit_identically(site: GimbalSite) -> None:
    site.write({"schedule": {"gimbal": {**SCHEDULE, "mount_sigma_deg": 0.05}}})
    site.hooks = Recorded
    ended = site.run()
    result = ended.result
    assert ended.verdict.passed, [c for c in result["checks"] if not c["passed"]]
    registers = result["registers"]
    assert registers["verified"]
    assert [check["name"] for check in registers["proof"]] == [f"gimbal_drift_{a}" for a in "xyz"]
    assert max(check["tolerance"] for check in registers["proof"]) < 6e-4, "the drift does not depend on the mounting"
    moves = ("home", "lock", "stabilise", "turn", "stop")
    for i, name in enumerate(Recorded.calls):
        if name in ("commit", "reset"):
            assert next((c for c in reversed(Recorded.calls[:i]) if c in moves), "lock") in ("home", "lock", "stop")
    last_turn = Recorded.calls.index("commit") - Recorded.calls[: Recorded.calls.index("commit")][::-1].index("turn")
    after = Recorded.calls[last_turn : Recorded.calls.index("commit")]
    assert "stabilise" not in after
    assert after.index("lock") < after.index("write_registers"), "the former values are written to locked joints"
    for name in MISALIGNMENTS:
        assert registers["old"][name] == 0.0
        assert registers["new"][name] == pytest.approx(result["parameters"][name]["value"], abs=1e-8)
    turns = site.events_of(GimbalTurned)
    assert {turn.axis for turn in turns} == {0, 1, 2}
    first, last = (max(np.abs(t.drift).max() for t in turns if t.index == i or (i < 0 and t.complete)) for i in (1, -1))
    assert last < 0.5 * first
    assert len(site.events_of(JointsMoved)) > 10
    log = open_log(Path(ended.log))
    joints = np.concatenate([block.joints for block in log.blocks()])
    assert np.isfinite(joints).all(axis=1).sum() > 50
    again = resolve(Path(ended.log)).result.to_json()
    assert again["parameters"] == result["parameters"]


@pytest.mark.long
def test_solution_agrees_with_the_truth_of_the_bench(site: GimbalSite) -> None:
    site.write(parameters={name: 1e-3 * (i - 2) for i, name in enumerate(MISALIGNMENTS)})
    result = site.run().result
    for i, name in enumerate(MISALIGNMENTS):
        parameter = result["parameters"][name]
        assert abs(parameter["value"] - 1e-3 * (i - 2)) < 4.0 * parameter["sigma"]


@pytest.mark.long
@pytest.mark.parametrize("step", [0, 1, 2])
def test_stop_locks_the_joints_and_restores_the_registers(site: GimbalSite, step: int) -> None:
    site.write(report_file=str(site.folder / "bench.json"))
    stop = site.once(StepStarted, Command.STOP, after=step)
    site.hooks = Recorded
    assert site.run(on_event=stop).verdict == "stopped"
    report = json.loads((site.folder / "bench.json").read_text(encoding="utf-8"))
    assert not report["enabled"]
    assert not report["moving"]
    stopping = next(i for i, e in enumerate(site.events) if isinstance(e, StateChanged) and e.state == "stopping")
    assert not any(isinstance(e, StepStarted) for e in site.events[stopping:])
    if Recorded.written:
        assert set(Recorded.written[-1].values()) == {0.0}


@pytest.mark.long
def test_rotation_is_repeated_from_zero_after_a_pause(site: GimbalSite) -> None:
    pause = site.once(StepStarted, Command.PAUSE, after=2)

    def on_event(event: Any) -> None:
        pause(event)
        if isinstance(event, StateChanged) and event.state == "paused":
            site.control.send(Command.RESUME)

    ended = site.run(on_event=on_event)
    assert ended.verdict.passed
    assert {e.state for e in site.events_of(StateChanged)} >= {"paused"}


def test_table_stages_and_gimbal_stages_require_their_hardware(site: GimbalSite) -> None:
    with raises_code(ConfigurationError, "product.needs_table"):
        prepare_run(site.request("rate"))
    assert schedule_options(site.station, site.product).offered == ("gimbal",)
    table = site.folder / "table.toml"
    table.write_text(tomli_w.dumps({**STATION, "bench": {"seed": 5}}), encoding="utf-8")
    with raises_code(ConfigurationError, "plan.needs_gimbal"):
        prepare_run(RunRequest("SN-000042", table, site.product, None, site.folder / "runs"))


@pytest.mark.parametrize(
    ("changed", "code"),
    [
        ({"order": "xyz"}, "plan.gimbal_order_differs"),
        ({"rate_dps": 90.0}, "plan.gimbal_rate_exceeds_limit"),
    ],
)
def test_schedule_beyond_the_gimbal_limits_is_refused(site: GimbalSite, changed: dict, code: str) -> None:
    site.write({"schedule": {"gimbal": {**SCHEDULE, **changed}}})
    with raises_code(ConfigurationError, code):
        prepare_run(site.request())


def test_unit_without_registers_for_the_correction_is_refused(site: GimbalSite) -> None:
    setup = prepare_run(site.request())
    without = replace(setup, imu=setup.imu.model_copy(update={"registers": []}))
    with raises_code(ConfigurationError, "product.gimbal_needs_registers"):
        check_station(without)


def test_shipped_gimbal_station_is_complete() -> None:
    station, product = library.find("stations", "virtual_gimbal"), library.find("products", "mems_gimbal")
    summary = run_summary(RunRequest("SN-1", station, product))
    assert [stage.name for stage in summary.stages] == ["gimbal"]


class Left(BenchHooks):
    """Hooks that leave a correction in the volatile registers, as a killed run does, and record register reads."""

    found: ClassVar[list[dict[str, float]]] = []

    def connected(self, devices: Devices) -> None:
        super().connected(devices)
        self.found.clear()
        devices.imu.write_registers(dict.fromkeys(MISALIGNMENTS, 1e-3))
        read = devices.imu.read_registers

        def recorded() -> dict[str, float]:
            self.found.append(read())
            return self.found[-1]

        devices.imu.read_registers = recorded  # type: ignore[method-assign]


def test_correction_left_by_a_killed_run_does_not_count_as_old_registers(site: GimbalSite) -> None:
    site.hooks = Left
    assert site.run(on_event=site.once(StateChanged, Command.STOP)).verdict == "stopped"
    assert {Left.found[-1][name] for name in MISALIGNMENTS} == {0.0}


def test_rotation_is_checked_at_the_current_angles_of_the_other_joints(site: GimbalSite) -> None:
    gimbal = prepare_run(site.request()).table.geometry().gimbal
    machine = SimpleNamespace(fault=None, interlock_closed=True, watchdog=1.0, enabled=True, homed=True)
    machine.joints = np.deg2rad([0.0, 86.0, 0.0])
    geometry = SimpleNamespace(task=SimpleNamespace(geometry=SimpleNamespace(gimbal=gimbal)))
    loop = GimbalLoop(cast(ControlLoop, SimpleNamespace(status=machine, context=geometry)))
    with raises_code(DeviceFaultError, "motion.joint_outside") as caught:
        loop._check_turn(0, 0.1)
    assert caught.value.values["axis"] == "y"
    assert machine.joints[0] == 0.0


def test_joint_beyond_its_travel_is_a_fault(site: GimbalSite) -> None:
    gimbal = prepare_run(site.request()).table.geometry().gimbal
    assert gimbal is not None
    check_joints(gimbal, np.deg2rad([84.0, -84.0, 0.0]))
    with raises_code(DeviceFaultError, "motion.joint_outside") as caught:
        check_joints(gimbal, np.deg2rad([0.0, -86.0, 0.0]))
    assert caught.value.values["axis"] == "y"


def test_link_test_shows_joint_angles_and_watchdog(site: GimbalSite) -> None:
    _, station = load_station(site.station)
    report = check_table_link(no_progress, LinkTestRequest(station, site.product))
    found = {f.id: f.state for f in report.findings}
    assert found["identified"] == found["watchdog"] == "ok"
    assert found["joints"] == "info"


def test_preview_gives_the_longest_duration_but_no_sigmas(site: GimbalSite) -> None:
    previewed = compute_preview(no_progress, site.request())
    assert previewed.stages[0].end == pytest.approx(run_summary(site.request()).stages[0].duration)
    assert previewed.stages[0].error == Text("preview.gimbal_motion")
    assert previewed.violations == ()


def no_progress(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
    """Ignore the progress of the preview."""
