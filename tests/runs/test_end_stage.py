"""Unlimited stages repeat until the operator ends them, and are then solved."""

import json
import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from calstation.results import resolve
from calstation.sequencer import Command, Event, StageEnded, StageStarted, StepStarted
from tests.site_folder import PRODUCT, SiteFolder

pytestmark = pytest.mark.long

UNLIMITED = {s: {**PRODUCT["schedule"][s], "rounds": 0} for s in ("excitation", "azimuth_flip")}
SCHEDULE = {**PRODUCT["schedule"], **UNLIMITED}


def test_repeated_stages_end_after_the_current_move_and_are_solved(tmp_path: Path) -> None:
    site_folder = SiteFolder(tmp_path)
    site_folder.write({"schedule": SCHEDULE})
    moves = 0

    def end_each_in_its_second_round(event: Event) -> None:
        nonlocal moves
        if isinstance(event, StageStarted):
            assert event.repeated == (event.stage in UNLIMITED)
            moves = 0
        if isinstance(event, StepStarted) and event.stage in UNLIMITED and event.kind == "move":
            moves += 1
            if moves == {"excitation": 36, "azimuth_flip": 7}[event.stage]:
                site_folder.control.send(Command.END_STAGE)

    ended = site_folder.run(on_event=end_each_in_its_second_round)
    assert ended.verdict.passed, ended.result.get("error")
    stages = {e.stage: (e.reason, e.rounds) for e in site_folder.events if isinstance(e, StageEnded)}
    assert stages["excitation"] == stages["azimuth_flip"] == ("operator", 1)
    assert stages["rate"][0] == "plan"
    steps = [e for e in site_folder.events if isinstance(e, StepStarted) and e.stage == "azimuth_flip"]
    assert [e.kind for e in steps].count("move") == 7
    assert steps[-1].kind == "dwell", "the rest after the move was completed"
    assert resolve(Path(ended.log)).result.to_json()["parameters"] == ended.result["parameters"]
    assert "ended_by_hand" not in ended.result, "the schedule has no end of its own"


def test_stage_that_is_ended_before_its_schedule_is_named_in_the_result_and_repeated(tmp_path: Path) -> None:
    site_folder = SiteFolder(tmp_path)
    flips = {**PRODUCT["schedule"]["azimuth_flip"], "rounds": 50}
    schedule = {**PRODUCT["schedule"], "azimuth_flip": flips}
    site_folder.write({"schedule": schedule, "stages": ["six_position", "azimuth_flip"]}, out_of_limits=True)

    def end_flips(event: Event) -> None:
        if isinstance(event, StageStarted) and event.stage == "azimuth_flip":
            site_folder.control.send(Command.END_STAGE)

    ended = site_folder.run(on_event=end_flips)
    assert (ended.verdict, ended.result["advice"]) == ("failed", "repeat")
    assert ended.result["ended_by_hand"] == ["azimuth_flip"]
    assert resolve(Path(ended.log)).result.ended_by_hand == ["azimuth_flip"]
    assert resolve(Path(ended.log), ("six_position",)).result.ended_by_hand == []


def test_end_requested_as_soon_as_the_stage_has_started_is_not_lost(tmp_path: Path) -> None:
    site_folder = SiteFolder(tmp_path)
    site_folder.write({"schedule": SCHEDULE, "stages": ["azimuth_flip"]})

    def end_at_once(event: Event) -> None:
        if isinstance(event, StageStarted):
            site_folder.control.send(Command.END_STAGE)

    site_folder.run(on_event=end_at_once)
    ended = [e for e in site_folder.events if isinstance(e, StageEnded)]
    assert [(e.reason, e.rounds) for e in ended] == [("operator", 0)]


def test_key_in_the_terminal_ends_a_stage(tmp_path: Path) -> None:
    site_folder = SiteFolder(tmp_path)
    flips = {**PRODUCT["schedule"]["azimuth_flip"], "rounds": 1000}
    site_folder.write({"schedule": {"azimuth_flip": flips}, "stages": ["azimuth_flip"]}, speed=20.0)
    keyboard, terminal = pty.openpty()
    command = [sys.executable, "-m", "calstation", "run", "--station", site_folder.station, "--product"]
    command += [site_folder.product, "--out", tmp_path / "runs", "--json", tmp_path / "result.json"]
    with subprocess.Popen(
        command, stdin=terminal, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as running:
        assert running.stderr is not None
        assert running.stdout is not None
        said = ""
        try:
            for line in running.stderr:
                said += line
                if "to end 'azimuth_flip' after the current move" in said:
                    os.write(keyboard, b"e\n")
                    break
            said += running.stderr.read()
            shown = running.stdout.read()
            running.wait()
        finally:
            running.kill()  # the stage takes hours
    os.close(keyboard)
    os.close(terminal)
    assert running.returncode in (0, 1), said
    assert json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))["stages"] == ["azimuth_flip"]
    assert "Ended by the operator before its schedule was complete: Azimuth flips." in shown
