"""Runs on the real bench process: verdicts, pause, stop, faults, registers, and the same bits offline."""

import json
import sys
from pathlib import Path

import pytest

from calstation.errors import ConfigurationError
from calstation.records.convert import export_csv, import_csv
from calstation.records.log import open_log
from calstation.sequencer.control import Command
from calstation.sequencer.events import Message, StageSolved, StateChanged, StepStarted
from calstation.station import library
from calstation.station.resolve import resolve
from tests.station.conftest import Place


def test_a_short_full_run_passes_and_solves_again_to_the_same_bits(place: Place) -> None:
    verdict = place.run()
    result = verdict.result
    assert verdict.outcome == "passed", [c for c in result["checks"] if not c["passed"]]
    assert result["stages"] == ["rate", "six_position", "excitation", "azimuth_flip"]
    assert len(result["parameters"]) == 30
    assert result["registers"]["verified"] is True
    assert result["attempt"] == 1
    assert result["operator"] == "tester"
    assert json.loads(Path(verdict.result_file).read_text(encoding="utf-8")) == result
    log = open_log(Path(verdict.log))
    assert log.outcome == "passed"
    assert log.results == [result]
    assert any(event["event"] == "OldRegisters" for event in log.events)

    again = resolve(Path(verdict.log)).result
    assert again["parameters"] == result["parameters"]
    assert again["consistency"] == result["consistency"]
    assert again["log"]["sha256"] == result["log"]["sha256"]
    assert again["outcome"] == "resolved"
    assert again["passed"] is True

    csv, back = place.folder / "log.csv", place.folder / "back.h5"
    export_csv(Path(verdict.log), csv)
    import_csv(csv, back)
    for path in (csv, back):
        assert resolve(path).result["parameters"] == result["parameters"]


def test_the_same_seed_gives_the_same_run(place: Place) -> None:
    first = place.run("six_position").result
    second = place.run("six_position").result
    assert first["parameters"] == second["parameters"]
    assert second["attempt"] == 2


def test_a_unit_outside_its_limits_keeps_its_registers(place: Place) -> None:
    place.write(out_of_limits=True)
    verdict = place.run("six_position")
    assert verdict.outcome == "failed"
    assert verdict.result["registers"] is None
    assert any(m.id == "registers_kept" for m in place.told(Message))
    failed = [c["name"] for c in verdict.result["checks"] if not c["passed"]]
    assert failed == ["accel_scale_y within"]


def test_early_end_on_failure(place: Place) -> None:
    place.write({"end_on_failure": True, "stages": ["six_position", "azimuth_flip"]}, out_of_limits=True)
    verdict = place.run()
    assert verdict.outcome == "failed"
    assert verdict.result["stages"] == ["six_position"]


def test_pause_and_resume(place: Place) -> None:
    pause = place.once(StepStarted, Command.PAUSE, after=2)

    def watch(event: object) -> None:
        pause(event)  # type: ignore[arg-type]
        if isinstance(event, StateChanged) and event.state == "paused":
            place.control.send(Command.RESUME)

    verdict = place.run("rate", on_event=watch)
    assert verdict.outcome == "passed", [c for c in verdict.result["checks"] if not c["passed"]]
    assert [e.state for e in place.told(StateChanged)].count("paused") == 1
    assert len(place.told(StageSolved)[0].parameters) == 3
    assert resolve(Path(verdict.log)).result["parameters"] == verdict.result["parameters"]


@pytest.mark.parametrize("moment", [StateChanged, StepStarted])
def test_stop_is_safe_and_leaves_a_result(place: Place, moment: type) -> None:
    verdict = place.run("rate", on_event=place.once(moment, Command.STOP))
    assert verdict.outcome == "stopped"
    assert verdict.result["passed"] is False
    assert [e.state for e in place.told(StateChanged)][-2:] == ["stopping", "stopped"]
    assert open_log(Path(verdict.log)).outcome == "stopped"


@pytest.mark.parametrize(
    ("bench", "word"),
    [
        ({"serial": "SN-000043"}, "SN-000043"),
        ({"watchdog_ms": 0}, "watchdog"),
        ({"interlock_closed": False}, "interlock"),
        ({"mount_deg": [20.0, 21.0]}, "away from the declared mounting"),
        ({"ready_time_s": 1000.0}, "not ready"),
        ({"orders": [{"order": "drive_fault", "at": 35.0}]}, "drive"),
        ({"orders": [{"order": "silence_imu", "value": 500, "at": 35.0}]}, "data"),
        ({"orders": [{"order": "hang_up_imu", "at": 35.0}]}, "port"),
    ],
    ids=lambda v: str(v)[:40],
)
def test_faults_are_told_and_leave_a_result(place: Place, bench: dict[str, object], word: str) -> None:
    place.write(**bench)
    verdict = place.run("rate")
    assert verdict.outcome == "fault"
    assert word in place.fault().text
    assert verdict.result["error"] == place.fault().text
    assert [e.state for e in place.told(StateChanged)][-1] == "fault"


def test_lost_frames_repeat_a_step(place: Place) -> None:
    place.write(orders=[{"order": "drop_frames", "value": 3, "at": 35.0}])
    verdict = place.run("rate")
    assert verdict.outcome == "passed", [c for c in verdict.result["checks"] if not c["passed"]]
    assert [m.values["reason"] for m in place.told(Message) if m.id == "step_repeated"] == ["gap"]
    assert verdict.result["log"]["gaps"] == 1


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals exist only on POSIX systems")
def test_rtu_and_serial_line_over_pseudo_terminals(place: Place) -> None:
    place.write(table_transport="rtu", imu_transport="pty")
    assert place.run("six_position").outcome == "passed"


def test_no_limits_no_run(place: Place) -> None:
    place.write({"limits": {}})
    with pytest.raises(ConfigurationError, match="limits"):
        place.run("rate")


def test_a_stream_behind_the_registers_has_them_read_and_logged_first(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = place.folder / "home"
    (home / "imus").mkdir(parents=True)
    shipped = library.find("imus", "bench_nav").read_text(encoding="utf-8")
    behind = shipped.replace("before_registers", "after_registers", 1)
    (home / "imus" / "bench_nav.toml").write_text(behind, encoding="utf-8")
    monkeypatch.setenv("CALSTATION_HOME", str(home))
    verdict = place.run("six_position")
    assert verdict.outcome == "passed"
    assert open_log(Path(verdict.log)).meta.registers == verdict.result["registers"]["old"]
