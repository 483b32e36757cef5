"""A stopped run is resumed from the command line."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from calstation.cli.run import _show_run
from calstation.sequencer import Command, Event, StepStarted
from tests.site_folder import QUICK, SiteFolder


@pytest.mark.exhaustive
def test_stopped_run_is_resumed(
    tmp_path: Path, calstation: Callable[..., Any], capsys: pytest.CaptureFixture[str]
) -> None:
    site_folder = SiteFolder(tmp_path)
    schedule = {"rate": {"turns": 1, "dwell_s": 2.0, **QUICK}, "six_position": {"dwell_s": 2.0, **QUICK}}
    limits = {"gyro_scale": {"within": 0.1}}
    site_folder.write({"schedule": schedule, "stages": ["rate", "six_position"], "limits": limits})

    def watch(event: Event) -> None:
        if isinstance(event, StepStarted) and event.stage == "six_position":
            site_folder.control.send(Command.STOP)

    before = site_folder.run(on_event=watch)
    assert before.verdict == "stopped", before.result.get("error")
    where = ("--station", site_folder.station, "--product", site_folder.product)
    _show_run(before, None, replace(site_folder.request(), station=Path("my line.toml")))
    said = capsys.readouterr().out
    assert f"--resume {before.log} --station 'my line.toml' --product {site_folder.product}" in said
    assert "STOPPED by the operator" in said
    lost = replace(before, result={**before.result, "stop_reason": "listener_lost"})
    _show_run(lost, None, site_folder.request())
    assert "STOPPED: the window or terminal that monitored the run has ended" in capsys.readouterr().out
    done = calstation("run", *where, "--resume", before.log, "--json", "-")
    assert done.code == 0, done.err
    assert done.json["resumed_from"] == Path(before.log).name
    assert done.json["stages"] == ["rate", "six_position"]
    assert "Resuming" in done.err
    assert "rate" in done.err

    again = calstation("run", *where, "--resume", done.json["log"]["file"])
    assert again.code == 2
    assert "is complete." in again.err
    logs = sorted(Path(before.log).parent.iterdir())
    twice = calstation("run", *where, "--resume", before.log)
    assert twice.code == 2
    assert f"was resumed in {Path(done.json['log']['file']).name} and is complete there" in twice.err
    assert sorted(Path(before.log).parent.iterdir()) == logs, "nothing was opened or recorded"
    mixed = calstation("run", *where, "--resume", before.log, "--stages", "rate")
    assert mixed.code == 2
    assert "Leave --stages and --seed out." in mixed.err
