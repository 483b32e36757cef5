"""A profile that misinterprets registers fails verification by the unit's output; the old registers are restored."""

from pathlib import Path
from typing import Any

import pytest

from calstation.config import library
from calstation.errors import DeviceFaultError
from calstation.registers import journal as register_journal
from calstation.sequencer import Message
from tests.helpers import raises_code, sampled
from tests.registers.operations import RegisterOperations
from tests.site_folder import SiteFolder

pytestmark = pytest.mark.long

WIDE = {
    "gyro_scale": {"within": 2e-2, "sigma_below": 1e-2},
    "accel_scale": {"within": 2e-2, "sigma_below": 1e-2},
}
DSP = 'convention = { matrix = "error", identity = false, offset = "after", added = true }'
WRONG = {
    "sign of the accelerometers": (
        "dsp_modbus",
        'convention = { matrix = "correction", identity = false, negated = true }',
        'convention = { matrix = "correction", identity = false }',
    ),
    "correction for error": ("dsp_modbus", DSP, DSP.replace('"error"', '"correction"')),
    "error for correction": ("vectornav_vn100", 'matrix = "correction"', 'matrix = "error"'),
    "axes of the scale": (
        "bench_nav",
        '"gyro_scale_x", "gyro_misalign_xy", "gyro_misalign_xz",\n    "gyro_misalign_yx", "gyro_scale_y"',
        '"gyro_scale_y", "gyro_misalign_xy", "gyro_misalign_xz",\n    "gyro_misalign_yx", "gyro_scale_x"',
    ),
}


def misread(site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch, name: str, right: str, wrong: str) -> None:
    """Write a copy of a profile with a mistake to the site's folder."""
    home = site_folder.folder / "home"
    (home / "imus").mkdir(parents=True)
    shipped = library.find("imus", name).read_text("utf-8")
    assert right in shipped
    (home / "imus" / f"{name}.toml").write_text(shipped.replace(right, wrong), "utf-8")
    monkeypatch.setenv("CALSTATION_HOME", str(home))
    grade = "nav" if name == "bench_nav" else "mems"
    product: dict[str, Any] = {"imu": name, "bench_grade": grade}
    site_folder.write(product if name == "bench_nav" else {**product, "limits": WIDE})


@pytest.mark.parametrize(
    "what", [pytest.param(what, marks=[pytest.mark.long] if "of" not in what else []) for what in WRONG]
)
def test_failed_verification_restores_the_old_registers(
    site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    misread(site_folder, monkeypatch, *WRONG[what])
    ended = site_folder.run("rate", "six_position")
    assert ended.verdict == "fault", ended.result["registers"]
    assert site_folder.fault().code == "verification.differs"
    registers = ended.result["registers"]
    assert not registers["verified"]
    assert set(registers["new"].values()) == {0.0}
    (entry,) = register_journal.history(site_folder.folder / "runs", "SN-000042")
    assert entry.closing == "restored"
    assert "refuted" in entry.steps


def test_manually_written_registers_are_verified_at_rest(
    site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    misread(
        site_folder,
        monkeypatch,
        "bench_nav",
        'parameters = ["accel_bias_x", ',
        'scale = -1.0\nparameters = ["accel_bias_x", ',
    )
    with raises_code(DeviceFaultError, "verification.differs"):
        RegisterOperations(site_folder.request()).write({"accel_bias_x": 5e-3}, at_rest=True)


def test_registers_of_a_unit_without_corrected_output_are_only_read_back(
    site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    misread(site_folder, monkeypatch, "bench_nav", "[corrected]\nstream = 2", "# none")
    ended = site_folder.run("six_position")
    assert ended.verdict.passed
    registers = ended.result["registers"]
    assert (registers["verified"], registers["proved_on"]) == (True, "read_back")
    assert "difference" not in " ".join(check["name"] for check in registers["proof"])
    ids = [message.id for message in site_folder.events_of(Message)]
    assert "registers_read_back" in ids
    assert "registers_written" not in ids
    (entry,) = register_journal.history(site_folder.folder / "runs", "SN-000042")
    assert (entry.closing, entry.steps[-1]) == ("done", "read_back")


@pytest.mark.parametrize("at", sampled(3, [60.0, 75.0, 100.0]))
def test_frames_dropped_during_verification_repeat_one_rotation(site_folder: SiteFolder, at: float) -> None:
    site_folder.write(orders=[{"order": "drop_frames", "at": at, "value": 3}])
    ended = site_folder.run("six_position")
    assert ended.verdict.passed, site_folder.fault().text
    assert ended.result["registers"]["proved_on"] == "corrected_output"
    assert Path(ended.log).is_file()
