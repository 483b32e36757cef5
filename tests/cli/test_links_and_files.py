"""Links tested and files checked from the terminal."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import tomli_w

from calstation.station.library import shipped_folder
from tests.cli.conftest import Done
from tests.station.conftest import STATION
from tests.station.wires import FakeImu, FakeTable, server, terminal

Run = Callable[..., Done]


def station(tmp_path: Path, table: str, imu: str) -> Path:
    """A station file with these ports."""
    path = tmp_path / "station.toml"
    links = {
        "table": {"profile": "bench", "port": table, "timeout_s": 0.2},
        "imu": {"port": imu, "timeout_s": 0.2},
    }
    path.write_text(tomli_w.dumps({**STATION, **links}), encoding="utf-8")
    return path


def test_a_right_link_is_told_line_by_line(calstation: Run) -> None:
    done = calstation("test", "table")
    assert done.code == 0, done.out + done.err
    assert done.out.splitlines()[-1] == "The link works."
    assert "ok     bench-table, serial number T-0001." in done.out
    report = calstation("test", "imu", "--json", "-").json
    assert (report["device"], report["state"]) == ("imu", "ok")
    assert {"id", "state", "values", "text", "mend"} == set(report["findings"][0])


def test_what_is_wrong_is_told_with_its_mend(calstation: Run, tmp_path: Path) -> None:
    fake = FakeTable({})
    fake.words[17] |= 1 << 3
    fake.words[20] = 0
    with server(fake.answer) as address:
        done = calstation(
            "test", "table", "--station", station(tmp_path, f"tcp://{address}", "/dev/ttyNONE9")
        )
    assert done.code == 3
    lines = done.out.splitlines()
    wrong = next(i for i, line in enumerate(lines) if line.startswith("WRONG"))
    assert "watchdog is off" in lines[wrong]
    assert lines[wrong + 1].startswith("       Set the watchdog's time in the drive")
    assert "calstation table reset" in done.out
    assert set(fake.functions) == {3}
    assert "is unknown; choose from table, imu" in calstation("test", "oven").err


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals on Windows")
def test_a_unit_on_hardware_is_tested(calstation: Run, tmp_path: Path) -> None:
    unit = FakeImu()
    with terminal(unit.answer, unit.sends) as port:
        done = calstation("test", "imu", "--station", station(tmp_path, "tcp://127.0.0.1:1", port))
    assert "ok     bench-imu, serial number SN-000042." in done.out, done.out
    assert done.code == 0


@pytest.mark.parametrize(
    "path", sorted(shipped_folder().glob("*/*.toml")), ids=lambda p: f"{p.parent.name}-{p.stem}"
)
def test_a_shipped_file_is_right_wherever_it_lies(calstation: Run, tmp_path: Path, path: Path) -> None:
    elsewhere = tmp_path / path.name
    elsewhere.write_text(path.read_text(encoding="utf-8"), encoding="utf-8")
    for file in (path, elsewhere):
        done = calstation("check", file, "--json", "-")
        assert done.code == 0, done.out + done.err
        assert done.json["kind"] == path.parent.name


def test_all_that_is_wrong_in_a_file_is_told_with_its_line(calstation: Run, tmp_path: Path) -> None:
    path = tmp_path / "s.toml"
    text = (shipped_folder() / "stations" / "virtual_bench.toml").read_text(encoding="utf-8")
    path.write_text(
        text.replace("34.25", "134.25").replace('profile = "bench"', 'profile = "lathe"'), encoding="utf-8"
    )
    done = calstation("check", path)
    assert done.code == 2
    assert f"{path}:5: site.latitude_deg" in done.out
    path.write_text("name = \n", encoding="utf-8")
    assert "is no station, table, IMU or product file" in calstation("check", path).err
    assert calstation("check", tmp_path / "none.toml").code == 2
