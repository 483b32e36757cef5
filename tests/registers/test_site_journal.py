"""A unit on hardware has one journal in the site folder, and its flash wears out."""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from calstation.bench import BenchHost
from calstation.cli.app import run_app
from calstation.config import RunRequest, load_configuration
from calstation.config.library import shipped_folder
from calstation.devices.imu import TransferOutcome, TransferStep
from calstation.errors import ConfigurationError, InputError
from calstation.registers import journal as register_journal
from calstation.registers import journal_folder, read_unit
from calstation.runs import execute
from calstation.sequencer import Control, Event, Finalized, Message
from calstation.simulation import bench_config
from tests.helpers import ignore_progress, raises_code
from tests.registers.operations import RegisterOperations
from tests.site_folder import STATION, SiteFolder

SERIAL = "SN-000042"
VALUES = {"gyro_bias_x": 2e-6, "accel_scale_y": 3e-4}


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The site folder."""
    folder = tmp_path / "home"
    monkeypatch.setenv("CALSTATION_HOME", str(folder))
    return folder


@pytest.fixture
def hardware(site_folder: SiteFolder) -> Iterator[RunRequest]:
    """Request a unit and a table on hardware ports that exist on every computer."""
    setup = load_configuration(site_folder.request())
    config = bench_config(setup)
    assert config is not None
    with closing(BenchHost.start({**config, "speed": 1.0, "watchdog_ms": 60_000})) as bench:
        endpoints = bench.endpoints
        table = {"profile": "bench", "port": f"tcp://{endpoints['table']}", "timeout_s": 5.0}
        station = {**STATION, "table": table, "imu": {"port": endpoints["imu"], "timeout_s": 5.0}}
        file = site_folder.folder / "hardware.toml"
        file.write_text(tomli_w.dumps(station), encoding="utf-8")
        yield replace(site_folder.request(), station=file, out=site_folder.folder / "monday")


@pytest.mark.exhaustive
def test_different_runs_folders_share_the_journal(
    hardware: RunRequest, site_folder: SiteFolder, home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    RegisterOperations(hardware).write(VALUES, at_rest=True)
    tuesday = site_folder.folder / "tuesday"
    assert read_unit(ignore_progress, hardware, tuesday).commits == 1
    assert not (hardware.out / register_journal.FOLDER).exists()
    assert register_journal.serials(home) == [SERIAL]

    folder = journal_folder(load_configuration(hardware).station, hardware.out)
    opened = register_journal.begin(folder, SERIAL, {}, {}, register_journal.Purpose(None, "run", ""))
    events: list[Event] = []
    execute(replace(hardware, out=tuesday, stages=("rate",)), events.append, Control())
    assert isinstance(events[-1], Finalized)
    assert events[-1].verdict == "fault"
    assert "Finish or restore" in str(events[-1].result["error"])
    opened.close(TransferOutcome.KEPT)

    assert run_app(["registers", "list", SERIAL, "--out", str(tuesday)]) == 0
    assert f"unit {SERIAL} on hardware, 1 flash cycle" in capsys.readouterr().out
    with raises_code(InputError, "transfer.none_known") as unknown:
        RegisterOperations(replace(hardware, serial="SN-000077")).do("restore")
    assert unknown.value.values == {"folder": str(home), "serial": "SN-000077"}


class WornFlashSite:
    """A site whose units have a flash with ten write cycles."""

    def __init__(self, site_folder: SiteFolder, home: Path) -> None:
        profile = (shipped_folder() / "imus" / "bench_nav.toml").read_text(encoding="utf-8")
        (home / "imus").mkdir(parents=True)
        (home / "imus" / "worn.toml").write_text(f"flash_cycles_max = 10\n{profile}", encoding="utf-8")
        site_folder.write({"imu": "worn"})
        self.request = site_folder.request("rate")
        self.runs = self.request.out

    def wear(self, cycles: int) -> None:
        """Use this number of flash write cycles."""
        entry = register_journal.begin(self.runs, SERIAL, {}, {}, register_journal.Purpose(None, "hand", ""))
        for _ in range(cycles):
            entry.note(TransferStep.COMMITTING)
        entry.close(TransferOutcome.DONE)

    def run(self) -> list[Event]:
        """Run and return the ids of the messages."""
        events: list[Event] = []
        execute(self.request, events.append, Control())
        return events


@pytest.fixture
def worn(site_folder: SiteFolder, home: Path) -> WornFlashSite:
    return WornFlashSite(site_folder, home)


@pytest.mark.long
def test_a_nearly_worn_flash_is_reported(worn: WornFlashSite) -> None:
    worn.wear(9)
    events = worn.run()
    (message,) = [event for event in events if isinstance(event, Message) and event.id == "flash_near"]
    assert message.values == {"serial": SERIAL, "used": 9, "most": 10}
    assert isinstance(events[-1], Finalized)
    assert events[-1].verdict.passed
    assert register_journal.cycles(worn.runs, SERIAL) == 10
    with raises_code(ConfigurationError, "transfer.flash_worn"):
        worn.run()


def test_a_worn_flash_is_not_written(worn: WornFlashSite) -> None:
    worn.wear(10)
    operations = RegisterOperations(worn.request)
    uses: list[Any] = [worn.run, lambda: operations.write(VALUES), lambda: operations.do("restore")]
    for use in uses:
        with raises_code(ConfigurationError, "transfer.flash_worn"):
            use()
    assert list(worn.runs.glob("*.h5")) == []


@pytest.mark.long
def test_interrupted_transfer_is_restored_despite_worn_flash(worn: WornFlashSite) -> None:
    worn.wear(10)
    register_journal.begin(worn.runs, SERIAL, {}, {}, register_journal.Purpose(None, "run", ""))
    assert RegisterOperations(worn.request).do("restore").closing in ("kept", "restored")


def test_damaged_journal_ends_a_run_before_any_device_is_opened(worn: WornFlashSite) -> None:
    worn.wear(1)
    (journal,) = (worn.runs / register_journal.FOLDER).iterdir()
    data = journal.read_bytes()
    journal.write_bytes(data.replace(b"hand", b"hanf"))
    with raises_code(ConfigurationError, "journal.damaged"):
        worn.run()


@pytest.mark.long
def test_a_truncated_line_is_reported(worn: WornFlashSite) -> None:
    worn.wear(1)
    (journal,) = (worn.runs / register_journal.FOLDER).iterdir()
    journal.write_bytes(journal.read_bytes() + b'{"event": "int')
    messages = [event for event in worn.run() if isinstance(event, Message) and event.id == "journal_torn"]
    assert [event.values["file"] for event in messages] == [str(journal)]
    assert len(register_journal.history(worn.runs, SERIAL)) == 2
