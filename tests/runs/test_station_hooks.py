"""Only a run on a virtual bench has hooks, and so faults; a run on hardware imports nothing of the simulation."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from calstation.config import confirmation_key, load_station
from calstation.errors import ConfigurationError
from calstation.runs import RunHooks, prepare, station_hooks
from calstation.sequencer import Control
from calstation.simulation import BenchHooks
from tests.helpers import raises_code
from tests.site_folder import STATION, SiteFolder

PREPARED = """
import sys
from pathlib import Path
from calstation.config import RunRequest
from calstation.runs import prepare
from calstation.sequencer import Control

request = RunRequest("SN-000042", Path("station.toml"), Path("product.toml"), out=Path("runs"))
(unit,) = prepare(request, print, Control())
simulation = ("calstation.simulation", "calstation.bench")
print(type(unit.hooks).__name__, [name for name in sys.modules if name.startswith(simulation)])
"""


@pytest.fixture
def hardware(site_folder: SiteFolder) -> SiteFolder:
    """Station without a bench, confirmed on this computer."""
    ports: dict[str, Any] = {
        **STATION,
        "site": {**STATION["site"], "gravity_mps2": 9.79547},
        "table": {**STATION["table"], "port": "tcp://192.0.2.1:502"},
        "imu": {"port": "socket://192.0.2.2:4001"},
    }
    site_folder.station.write_text(tomli_w.dumps(ports), encoding="utf-8")
    site = load_station(site_folder.station)[1].site
    ports["site"]["confirmed_on"] = [confirmation_key(site)]
    site_folder.station.write_text(tomli_w.dumps(ports), encoding="utf-8")
    return site_folder


def test_run_on_a_bench_has_the_hooks_of_the_bench(site_folder: SiteFolder) -> None:
    assert type(station_hooks(load_station(site_folder.station)[1])) is BenchHooks
    (unit,) = prepare(site_folder.request(), site_folder.events.append, Control())
    assert type(unit.hooks) is BenchHooks


def test_run_on_hardware_has_hooks_that_do_nothing(hardware: SiteFolder) -> None:
    assert type(station_hooks(load_station(hardware.station)[1])) is RunHooks
    (unit,) = prepare(hardware.request(), hardware.events.append, Control())
    assert type(unit.hooks) is RunHooks


@pytest.mark.long
def test_preparation_of_a_run_on_hardware_imports_no_simulation(hardware: SiteFolder) -> None:
    command = [sys.executable, "-c", PREPARED]
    done = subprocess.run(command, cwd=hardware.folder, capture_output=True, text=True, check=False)
    assert done.stdout.splitlines()[-1:] == ["RunHooks []"], done.stderr


def test_faults_are_refused_on_hardware(hardware: SiteFolder, tmp_path: Path) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text('[[fault]]\nkind = "engine_killed"\nstage = "rate"\n', encoding="utf-8")
    with raises_code(ConfigurationError, "configuration.bench_only"):
        prepare(replace(hardware.request(), faults=plan), hardware.events.append, Control())
