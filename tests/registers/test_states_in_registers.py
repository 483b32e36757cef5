"""A modelled effect is written to its register, or only estimated if the unit has no register for it."""

from collections.abc import Callable
from typing import Any

import pytest

from calstation.config import library
from calstation.sequencer import Message
from tests.site_folder import SiteFolder, with_corrected_output

pytestmark = pytest.mark.long

SIZE = 3000.0  # µg/g³
TRUE = SIZE * 1e-6 / 9.80665**2
CUBIC = tuple(f"accel_cubic_{axis}" for axis in "xyz")
REGISTER = """
[[registers]]
page = 3
address = 300
parameters = ["accel_cubic"]
range = [-1e-2, 1e-2]

[prior.gyro_bias]"""


def prepare(site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch, change: Callable[[str], str]) -> None:
    """Create a unit with the effect, and a site copy of its profile with the state in its model."""
    home = site_folder.folder / "home"
    (home / "imus").mkdir(parents=True)
    text = library.find("imus", "dsp_modbus").read_text("utf-8")
    text = change(text).replace("\n[link]", 'states = ["accel_cubic"]\n\n[link]', 1)
    (home / "imus" / "dsp_modbus.toml").write_text(text, "utf-8")
    monkeypatch.setenv("CALSTATION_HOME", str(home))
    limits = {f"{sensor}_scale": {"within": 2e-2, "sigma_below": 1e-2} for sensor in ("gyro", "accel")}
    product: dict[str, Any] = {"imu": "dsp_modbus", "bench_grade": "mems", "limits": limits}
    flash = str(site_folder.folder / "flash.bin")
    site_folder.write(product, effects={"accel_cubic_ug_g3": SIZE}, flash_file=flash)


def with_register(profile: str) -> str:
    """Return the profile with the register of the state."""
    return profile.replace("\n[prior.gyro_bias]", REGISTER, 1)


@pytest.mark.parametrize("register", [True, False], ids=["with a register", "without"])
def test_effect_is_written_to_its_register_if_available(
    site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch, register: bool
) -> None:
    prepare(site_folder, monkeypatch, with_register if register else str)
    ended = site_folder.run("six_position", "excitation")
    assert ended.verdict.passed, ended.result["checks"]
    new, parameters = ended.result["registers"]["new"], ended.result["parameters"]
    assert ended.result["registers"]["verified"]
    for name in CUBIC:
        row = parameters[name]
        assert abs(row["value"] - TRUE) < 5.0 * row["sigma"]
        if register:
            assert new[name] == pytest.approx(row["value"], rel=1e-6)
    (states,) = [e.values["states"] for e in site_folder.events_of(Message) if e.id == "states_without_register"] or [
        ""
    ]
    assert states == ("" if register else ", ".join(CUBIC))
    assert register or not set(CUBIC) & set(new)


def test_residual_effect_is_added_to_the_register(site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    prepare(site_folder, monkeypatch, lambda profile: with_register(corrected_stream(profile)))
    first, second = (site_folder.run("six_position", "excitation") for _ in range(2))
    assert first.verdict.passed
    assert second.verdict.passed
    for name in CUBIC:
        left = second.result["parameters"][name]
        assert abs(left["value"]) < 0.1 * TRUE
        held, new = (second.result["registers"][key][name] for key in ("old", "new"))
        assert held == first.result["registers"]["new"][name]
        assert new == pytest.approx(held + left["value"], rel=1e-6)


def corrected_stream(profile: str) -> str:
    """Return the profile of a unit whose only stream is corrected by its registers."""
    return with_corrected_output(profile).replace("before_registers", "after_registers")
