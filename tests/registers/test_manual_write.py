"""Manual register operations on the simulated IMU: read, compare with a result, write, journal."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calstation.cli.app import run_app
from calstation.errors import ConfigurationError, DeviceFaultError, InputError
from calstation.registers import UnitRegisters, read_unit, target_registers
from calstation.registers.journal import FOLDER, history
from calstation.registers.unit_registers import compose
from calstation.results import Result
from tests.helpers import ignore_progress, raises_code
from tests.registers.operations import RegisterOperations
from tests.site_folder import STATION, SiteFolder

SERIAL = "SN-000042"


@pytest.fixture
def unit(site_folder: SiteFolder) -> SiteFolder:
    """A site whose unit keeps its flash."""
    site_folder.write(flash_file=str(site_folder.folder / "flash.bin"))
    return site_folder


def result_of(site_folder: SiteFolder, **values: float) -> Result:
    """Write a result with these parameters."""
    return Result.from_json(
        {
            "schema": "calstation.result/1",
            "unit": {"serial": SERIAL},
            "stages": [],
            "outcome": "passed",
            "parameters": {name: {"value": value, "sigma": 0.0} for name, value in values.items()},
            "log": {"file": str(site_folder.folder / "no.h5")},
        }
    )


@pytest.mark.long
def test_unit_contains_the_written_values(unit: SiteFolder) -> None:
    runs = unit.folder / "runs"
    before = read_unit(ignore_progress, unit.request(), runs)
    assert (before.serial, before.commits, before.virtual) == (SERIAL, 0, True)
    assert before.model.startswith("bench-imu")
    wanted = target_registers(ignore_progress, unit.request(), result_of(unit, gyro_bias_x=1e-6, accel_scale_y=3e-4))
    assert [(r.address, r.parameter) for r in wanted.registers] == [(0, "gyro_bias_x"), (19, "accel_scale_y")]
    assert wanted.registers[0].value == np.float32(1e-6)
    assert bytes.fromhex(wanted.registers[0].raw) == np.array([1e-6], ">f4").tobytes()

    after = UnitRegisters.of(RegisterOperations(unit.request()).write(wanted.values, at_rest=True).unit)
    again = read_unit(ignore_progress, unit.request(), runs)
    assert again.values == after.values == before.values | wanted.values
    assert again.commits == 1
    (entry,) = history(runs, SERIAL)
    assert (entry.by, entry.why, entry.source, entry.closing) == ("tester", "hand", "x.h5", "done")
    assert entry.station == STATION["name"]
    assert entry.old == before.values
    assert entry.new == after.values


def test_the_command_line_reads_the_registers_of_a_unit(unit: SiteFolder, capsys: pytest.CaptureFixture[str]) -> None:
    RegisterOperations(unit.request()).write({"gyro_bias_x": 1e-6, "accel_scale_y": 3e-4}, at_rest=True)
    flash = (unit.folder / "flash.bin").read_bytes()
    where = [
        "--station",
        str(unit.station),
        "--product",
        str(unit.product),
        "--out",
        str(unit.folder / "runs"),
    ]
    assert run_app(["registers", "read", SERIAL, *where]) == 0
    output = capsys.readouterr().out
    assert f"unit {SERIAL}, bench-imu" in output
    assert "(virtual bench); flash cycles known here: 1" in output
    rows = {line.split()[1]: line.split() for line in output.splitlines() if "_" in line}
    assert rows["accel_scale_y"] == ["19", "accel_scale_y", "300.0000", "ppm", "399D4952"]
    assert run_app(["registers", "read", SERIAL, *where, "--json", "-"]) == 0
    unit_registers = UnitRegisters.of(json.loads(capsys.readouterr().out))
    assert unit_registers.values["gyro_bias_x"] == np.float32(1e-6)
    assert (unit.folder / "flash.bin").read_bytes() == flash, "nothing was written"
    unit.write(serial=SERIAL)
    assert run_app(["registers", "read", "SN-000043", *where]) == 3
    assert f"Unit '{SERIAL}' is in the fixture, not 'SN-000043'" in capsys.readouterr().err


def test_write_to_a_different_unit_is_refused(unit: SiteFolder) -> None:
    unit.write(serial=SERIAL)
    runs = unit.folder / "runs"
    with pytest.raises(DeviceFaultError, match=r"'SN-000042' is in the fixture.*nothing was written"):
        RegisterOperations(unit.request(serial="SN-000043")).write({"gyro_bias_x": 1e-6})
    assert history(runs, "SN-000043") == []


def test_value_outside_the_register_range_is_refused(unit: SiteFolder) -> None:
    runs = unit.folder / "runs"
    with pytest.raises(DeviceFaultError, match="does not fit register 0"):
        RegisterOperations(unit.request()).write({"gyro_bias_x": 7.0}, at_rest=True)
    assert read_unit(ignore_progress, unit.request(), runs).values["gyro_bias_x"] != 7.0


def test_write_is_refused_without_a_journal(unit: SiteFolder) -> None:
    runs = unit.folder / "runs"
    runs.mkdir()
    (runs / FOLDER).write_text("a file where the folder should be", encoding="utf-8")
    with raises_code(ConfigurationError, "journal.unwritable"):
        RegisterOperations(unit.request()).write({"gyro_bias_x": 1e-6}, at_rest=True)
    (runs / FOLDER).unlink()
    assert read_unit(ignore_progress, unit.request(), runs).values["gyro_bias_x"] == 0.0


@pytest.mark.long
def test_result_from_corrected_output_is_composed_with_the_registers(corrected_site: SiteFolder) -> None:
    result = dict(corrected_site.run("six_position").result)
    wanted = target_registers(ignore_progress, corrected_site.request(), Result.from_json(result))
    unit_registers = {name: row["value"] for name, row in result["parameters"].items()}
    expected = compose(result["registers"]["old"], unit_registers)
    for name, value in wanted.values.items():
        assert value == pytest.approx(np.float32(expected[name]), abs=1e-12)
    moved = replace(corrected_site.request(), out=Path("elsewhere"))
    Path(result["log"]["file"]).unlink()
    again = target_registers(ignore_progress, moved, Result.from_json(result))
    assert again.values == wanted.values, "as the run wrote them"
    with raises_code(InputError, "transfer.log_missing"):
        target_registers(ignore_progress, moved, Result.from_json({**result, "registers": None}))
