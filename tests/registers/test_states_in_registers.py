"""An effect in the model of the unit is written to its register, or estimated only where the unit has none."""

from typing import Any

import pytest

from calstation.config import library
from calstation.sequencer.events import Message
from tests.site_folder import SiteFolder

pytestmark = pytest.mark.long

SIZE = 3000.0  # µg/g³
CUBIC = tuple(f"accel_cubic_{axis}" for axis in "xyz")
REGISTER = """
[[registers]]
page = 3
address = 300
parameters = ["accel_cubic"]
range = [-1e-2, 1e-2]

[prior.gyro_bias]"""


@pytest.mark.parametrize("register", [True, False], ids=["with a register", "without"])
def test_the_size_of_an_effect_is_written_where_there_is_a_register(
    site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch, register: bool
) -> None:
    home = site_folder.folder / "home"
    (home / "imus").mkdir(parents=True)
    text = (
        library.find("imus", "dsp_modbus")
        .read_text("utf-8")
        .replace("\n[link]", 'states = ["accel_cubic"]\n\n[link]', 1)
    )
    if register:
        text = text.replace("\n[prior.gyro_bias]", REGISTER, 1)
    (home / "imus" / "dsp_modbus.toml").write_text(text, "utf-8")
    monkeypatch.setenv("CALSTATION_HOME", str(home))
    limits = {f"{sensor}_scale": {"within": 2e-2, "sigma_below": 1e-2} for sensor in ("gyro", "accel")}
    product: dict[str, Any] = {"imu": "dsp_modbus", "bench_grade": "mems", "limits": limits}
    site_folder.write(product, effects={"accel_cubic_ug_g3": SIZE})
    verdict = site_folder.run("rate", "six_position")
    assert verdict.outcome == "passed", verdict.result["checks"]
    new, found = verdict.result["registers"]["new"], verdict.result["parameters"]
    assert verdict.result["registers"]["verified"]
    for name in CUBIC:
        row = found[name]
        assert abs(row["value"] - SIZE * 1e-6 / 9.80665**2) < 5.0 * row["sigma"]
        if register:
            assert new[name] == pytest.approx(row["value"], rel=1e-6)
    (said,) = [e.values["states"] for e in site_folder.events_of(Message) if e.id == "states_without_register"] or [""]
    assert said == ("" if register else ", ".join(CUBIC))
    assert register or not set(CUBIC) & set(new)
