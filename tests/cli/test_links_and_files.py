"""Links are tested and files are checked from the terminal."""

import errno
import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import tomli_w

from calstation.config.library import KINDS, shipped_folder
from tests.cli.conftest import Done, six_position_rows, write_log
from tests.connection.fake_links import FakeImu, FakeTable, server, terminal
from tests.site_folder import PRODUCT, STATION

Run = Callable[..., Done]


def station(tmp_path: Path, table: str, imu: str) -> Path:
    """Write a station file with these ports."""
    path = tmp_path / "station.toml"
    links = {
        "table": {"profile": "bench", "port": table, "timeout_s": 0.2},
        "imu": {"port": imu, "timeout_s": 0.2},
    }
    path.write_text(tomli_w.dumps({**STATION, **links}), encoding="utf-8")
    return path


def test_a_working_link_is_described_line_by_line(calstation: Run) -> None:
    done = calstation("test", "table")
    assert done.code == 0, done.out + done.err
    assert done.out.splitlines()[-1] == "The link works."
    assert "ok      bench-table, serial number T-0001." in done.out
    report = calstation("test", "imu", "--json", "-").json
    assert (report["device"], report["state"]) == ("imu", "ok")
    assert {"id", "state", "values", "text", "remedy"} == set(report["findings"][0])


@pytest.mark.long
def test_imus_of_all_slots_are_tested(calstation: Run, tmp_path: Path) -> None:
    path = tmp_path / "batch.toml"
    slots = [{"name": "left"}, {"name": "right", "orientation": "-y+z"}]
    path.write_text(tomli_w.dumps({**STATION, "bench": {"seed": 5}, "slots": slots}), encoding="utf-8")
    done = calstation("test", "imu", "--station", path)
    assert done.code == 0, done.out + done.err
    lines = done.out.splitlines()
    assert [line for line in lines if line.startswith("[")] == ["[left]", "[right]"]
    assert lines.count("The link works.") == 2
    report = calstation("test", "imu", "--station", path, "--json", "-").json
    assert (report["device"], report["state"]) == ("imu", "ok")
    assert [(row["slot"], row["device"], row["state"]) for row in report["slots"]] == [
        ("left", "imu", "ok"),
        ("right", "imu", "ok"),
    ]
    assert "slots" not in calstation("test", "table", "--station", path, "--json", "-").json


def test_a_failed_link_is_shown_with_its_remedy(calstation: Run, tmp_path: Path) -> None:
    fake = FakeTable({})
    fake.words[17] |= 1 << 3
    fake.words[20] = 0
    with server(fake.answer) as address:
        done = calstation("test", "table", "--station", station(tmp_path, f"tcp://{address}", "/dev/ttyNONE9"))
    assert done.code == 3
    lines = done.out.splitlines()
    wrong = next(i for i, line in enumerate(lines) if line.startswith("ERROR"))
    assert "watchdog is off" in lines[wrong]
    assert lines[wrong + 1].startswith("        Set the watchdog's time in the drive")
    assert "calstation table reset" in done.out
    assert set(fake.functions) == {3}
    assert "is unknown. Choose from table, imu" in calstation("test", "oven").err


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals on Windows")
def test_imu_on_hardware_is_tested(calstation: Run, tmp_path: Path) -> None:
    unit = FakeImu()
    with terminal(unit.answer, unit.sends) as port:
        done = calstation("test", "imu", "--station", station(tmp_path, "tcp://127.0.0.1:1", port))
    assert "ok      bench-imu, serial number SN-000042." in done.out, done.out
    assert done.code == 0


SHIPPED = sorted(path for kind in KINDS for path in (shipped_folder() / kind).glob("*.toml"))


@pytest.mark.parametrize("path", SHIPPED, ids=lambda p: f"{p.parent.name}-{p.stem}")
def test_a_shipped_file_is_valid_in_any_folder(calstation: Run, tmp_path: Path, path: Path) -> None:
    elsewhere = tmp_path / path.name
    elsewhere.write_text(path.read_text(encoding="utf-8"), encoding="utf-8")
    for file in (path, elsewhere):
        done = calstation("check", file, "--json", "-")
        assert done.code == 0, done.out + done.err
        assert done.json["kind"] == path.parent.name


def test_limits_that_no_stage_judges_are_warned_about(calstation: Run, tmp_path: Path) -> None:
    file = tmp_path / "short.toml"
    file.write_text(tomli_w.dumps({**PRODUCT, "stages": ["six_position"]}), encoding="utf-8")
    done = calstation("check", file)
    assert done.code == 0
    line = file.read_text(encoding="utf-8").splitlines().index("[limits.gyro_bias]") + 1
    assert f"{file}:{line}: warning: limits.gyro_bias: No stage of the product" in done.out
    first, *_ = calstation("check", file, "--json", "-").json["warnings"]
    assert first["line"] == line


def test_all_problems_of_a_file_are_shown_with_line_numbers(calstation: Run, tmp_path: Path) -> None:
    path = tmp_path / "s.toml"
    text = (shipped_folder() / "stations" / "virtual_bench.toml").read_text(encoding="utf-8")
    path.write_text(text.replace("34.25", "134.25").replace('profile = "bench"', 'profile = "lathe"'), encoding="utf-8")
    done = calstation("check", path)
    assert done.code == 2
    assert f"{path}:5: site.latitude_deg" in done.out
    path.write_text("name = \n", encoding="utf-8")
    assert "is not a station, table, IMU or product file" in calstation("check", path).err
    assert calstation("check", tmp_path / "none.toml").code == 2


@pytest.mark.parametrize(
    ("table", "imu", "line", "remedy"),
    [
        ("127.0.0.1:39551", "/dev/ttyUSB0", 11, "Write tcp://127.0.0.1:39551, or socket://"),
        ("/dev/ttyUSB0", "10.0.0.7:4001", 15, "Write socket://10.0.0.7:4001 for a serial server"),
        ("/dev/ttyUSB0", "/dev/ttyUSB0", 15, "two devices cannot share a port. Give each device its own"),
    ],
)
def test_ports_that_a_run_would_refuse_are_shown_with_a_remedy(
    calstation: Run, tmp_path: Path, table: str, imu: str, line: int, remedy: str
) -> None:
    file = station(tmp_path, table, imu)
    done = calstation("check", file)
    assert done.code == 2
    assert f"{file}:{line}: " in done.out
    assert remedy in done.out


def test_missing_report_folders_are_problems(calstation: Run, tmp_path: Path) -> None:
    file = tmp_path / "station.toml"
    report = {"folder": "certificates", "template": "mine", "signing": {"certificate": "lab.p12"}}
    file.write_text(tomli_w.dumps({**STATION, "bench": {"seed": 1}, "report": report}), encoding="utf-8")
    done = calstation("check", file)
    assert done.code == 2
    lines = file.read_text(encoding="utf-8").splitlines()
    for entry, name in (("folder", "certificates"), ("template", "mine"), ("signing.certificate", "lab.p12")):
        key = entry.rpartition(".")[2]
        line = 1 + next(i for i, text in enumerate(lines) if text.startswith(f'{key} = "{name}"'))
        said = f"{file}:{line}: report.{entry}: {tmp_path / name} does not exist. Create it or mount its share"
        assert said in done.out
    for name in ("certificates", "mine"):
        (tmp_path / name).mkdir()
    (tmp_path / "lab.p12").touch()
    assert calstation("check", file).code == 0


def test_gravity_that_a_run_would_refuse_is_a_problem(calstation: Run, tmp_path: Path) -> None:
    file = tmp_path / "station.toml"
    site = {**STATION["site"], "gravity_mps2": 9.83}
    file.write_text(tomli_w.dumps({**STATION, "site": site, "bench": {"seed": 1}}), encoding="utf-8")
    done = calstation("check", file)
    assert done.code == 2
    assert "site.gravity_mps2: 9.83 m/s² contradicts latitude 34.25° and height" in done.out
    done = calstation("test", "imu", "--station", file)
    assert done.code == 3
    assert "WARNING site.gravity_mps2 = 9.83 does not match latitude 34.25°" in done.out
    assert done.out.splitlines()[-1] == "The link works, but the warnings can prevent or end a run."


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals on Windows")
def test_all_incompatibilities_between_product_and_station_are_shown(calstation: Run, tmp_path: Path) -> None:
    product = tmp_path / "product.toml"
    product.write_text(
        'name = "carried"\nimu = "bench_nav"\nserial_pattern = ".*"\nstages = ["multi_position"]\n'
        "[schedule.multi_position]\nmanual = true\n",
        encoding="utf-8",
    )
    unit = FakeImu()
    with terminal(unit.answer, unit.sends) as port:
        file = station(tmp_path, "tcp://127.0.0.1:1", port)
        carried = calstation("test", "imu", "--station", file, "--product", product)
    unit = FakeImu(counts=[0, 0, 0, 0, 0, 2449])  # 2e-5 m/s per count
    with terminal(unit.answer, unit.sends) as port:
        file = station(tmp_path, "tcp://127.0.0.1:1", port)
        mems = calstation("test", "imu", "--station", file, "--product", shipped_folder() / "products" / "mems_c.toml")
    assert "Tested as a unit of “carried”, with the profile “Bench IMU, navigation grade”." in carried.out
    assert "WARNING “Bench table” is driven, but stages of “carried” are turned by hand" in carried.out, carried.out
    assert "WARNING Surveyed gravity is missing" in mems.out, mems.out
    assert "WARNING The site has not been confirmed on this computer" in mems.out
    assert "site.confirmed_on of the station file" in mems.out
    for done in (carried, mems):
        assert done.code == 3
        # On a busy computer the rate of the simulated unit may be found wrong too.
        assert done.out.splitlines()[-1].startswith(("The link works, but the warnings can prevent", "Not ready"))


def test_the_table_is_checked_for_a_given_product(calstation: Run) -> None:
    by_hand = shipped_folder() / "products" / "mems_hand.toml"
    done = calstation("test", "table", "--product", by_hand)
    assert done.code == 3
    assert "is driven, but stages of “" in done.out


def test_site_file_is_found_by_its_name(calstation: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path))
    for kind, name, data in (
        ("stations", "rtu", {**STATION, "bench": {"speed": -1.0}}),
        ("stations", "both", STATION),
        ("products", "both", {}),
    ):
        (tmp_path / kind).mkdir(exist_ok=True)
        (tmp_path / kind / f"{name}.toml").write_text(tomli_w.dumps(data), encoding="utf-8")
    done = calstation("check", "rtu")
    assert (done.code, f"{tmp_path / 'stations' / 'rtu.toml'}:" in done.out) == (2, True)
    assert "rtu.toml [bench]: speed" in calstation("run", "--station", "rtu", "--out", tmp_path).err
    assert calstation("check", "cia402_drives").code == 0
    assert "“both” is the name of several files (station file, product file)" in calstation("check", "both").err
    for option, kind in (("--station", "station"), ("--product", "product")):
        done = calstation("test", "table", option, "unit7")
        assert done.code == 2
        assert f"There is no {kind} file “unit7”. Give the path of a file, or one of the names: " in done.err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full device")
@pytest.mark.parametrize("name", ["out.csv", "out.csv.gz"])
def test_export_to_a_full_disk_leaves_nothing(calstation: Callable[..., Done], tmp_path: Path, name: str) -> None:
    log = write_log(tmp_path, six_position_rows(3.0))
    (tmp_path / f"partial-{name}").symlink_to("/dev/full")
    done = calstation("export", log, "-o", tmp_path / name)
    assert done.code == 2
    assert "the disk is full" in done.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.csv", "log.toml"]


def test_import_to_a_full_disk_leaves_nothing(
    calstation: Callable[..., Done], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(handle: int, offset: int, size: int) -> None:
        raise OSError(errno.EDQUOT, "Disk quota exceeded")

    log = write_log(tmp_path, six_position_rows(3.0))
    monkeypatch.setattr(os, "posix_fallocate", full, raising=False)
    done = calstation("import", log, "-o", tmp_path / "out.h5")
    assert (done.code, len(done.err.splitlines())) == (2, 1)
    assert "cannot be created (the disk is full)" in done.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.csv", "log.toml"]
