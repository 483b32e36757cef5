"""Registers with polynomials over temperature: names, encoding, and the correction by the unit, which happens once."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calstation.bench import BenchConfig
from calstation.bench.imu.units.framed import FramedUnit
from calstation.connection import imu_session
from calstation.devices.imu import RegisterMap
from calstation.devices.profiles import ImuProfile, load_imu_profile
from calstation.errors import ConfigurationError, InputError
from calstation.estimation import Solution
from calstation.estimation.common import Consistency, Posterior
from calstation.estimation.temperature import compensate_each
from calstation.physics import (
    COUNT,
    NAMES,
    PARAMETERS,
    TEMPERATURES,
    display,
    group_matrix,
    group_vector,
    highest_powers,
    values_at,
)
from calstation.registers import AppliedRegisters, target_registers, verify_output
from calstation.results import TemperatureResult
from calstation.results.temperature import Coefficients
from calstation.runs.finalize import Finalization
from calstation.sequencer import Output, VerificationData
from tests.helpers import ignore_progress, raises_code
from tests.registers.test_manual_write import result_of
from tests.registers.verification_scene import REPEATABILITY, Captures, recording
from tests.site_folder import SiteFolder

IMUS = Path(__file__).parents[2] / "data" / "imus"


def thermal_map() -> RegisterMap:
    return RegisterMap(tuple(load_imu_profile(IMUS / "bench_mems_thermal.toml").registers))


def registers(seed: int = 1) -> dict[str, float]:
    """Return plausible coefficients of the powers 0 to 2 for every parameter."""
    random, values = np.random.default_rng(seed), dict(zip(TEMPERATURES, (25.0, -40.0, 85.0), strict=True))
    for p in PARAMETERS:
        if p.group != "outer_lever":
            powers = (0, 1, 2) if p.sensor != "lever" else (0,)
            sizes = 0.1 * p.prior_sigma * random.standard_normal(3)
            values |= {f"{p.name}[{k}]" if k else p.name: sizes[k] / 65.0**k for k in powers}
    return values


def polynomial(values: dict[str, float], temperature: float) -> np.ndarray:
    """Return the parameters at a temperature, without `values_at`."""
    change = temperature - values["temperature_reference"]
    return np.array([values.get(n, 0.0) + sum(values.get(f"{n}[{k}]", 0.0) * change**k for k in (1, 2)) for n in NAMES])


@pytest.mark.parametrize("temperature", [-40.0, 3.0, 25.0, 85.0])
def test_the_unit_corrects_as_the_program_does(temperature: float) -> None:
    entries, values = thermal_map(), registers()
    complete = {name: values.get(name, 0.0) for name in entries.parameters}
    unit = FramedUnit(BenchConfig(grade="mems", thermal_registers=True))
    unit.sensor_output = lambda time: temperature
    for key, numbers in entries.encode(complete).items():
        unit.registers[key : key + len(numbers)] = numbers
    random = np.random.default_rng(2)
    raw = np.hstack([random.uniform(-1.0, 1.0, (20, 3)), random.uniform(-10.0, 10.0, (20, 3))])
    rate, force = compensate_each(raw[:, :3], raw[:, 3:], np.tile(polynomial(values, temperature), (20, 1)))
    assert unit.correction().apply(raw) == pytest.approx(np.hstack([rate, force]), abs=1e-6)
    applied = AppliedRegisters(entries.decode(entries.encode(complete))).at(temperature).current
    assert [applied.get(n, 0.0) for n in NAMES] == pytest.approx(polynomial(values, temperature), rel=1e-5, abs=1e-12)


def test_the_unit_limits_the_temperature_to_the_range() -> None:
    values = {"gyro_bias_x": 1e-3, "gyro_bias_x[1]": 1e-5, **dict(zip(TEMPERATURES, (25.0, -40.0, 85.0), strict=True))}
    assert values_at(values, 200.0)["gyro_bias_x"] == pytest.approx(1e-3 + 60e-5)
    assert values_at(values, None) == {"gyro_bias_x": 1e-3}
    assert values_at({"gyro_bias_x": 1e-3}, 50.0) == {"gyro_bias_x": 1e-3}


def test_names_and_units_of_coefficients() -> None:
    highest = highest_powers(thermal_map().parameters)
    assert (highest["gyro_bias_x"], highest["inner_lever_x"]) == (6, 0)
    assert display("gyro_bias_x[2]", 1.0)[1] == "°/h/K²"
    assert display("temperature_low", -40.0) == (-40.0, "°C")


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ('"temperature_high"]', '""]', "profile.temperature_incomplete"),
        ('"gyro_bias_x[1]"', '"gyro_bias_x[9]"', "entry.unknown_parameter"),
        ('"gyro_bias_x[1]"', '"inner_lever_x[1]"', "entry.unknown_parameter"),
    ],
)
def test_incomplete_maps_are_refused(tmp_path: Path, old: str, new: str, code: str) -> None:
    path = tmp_path / "unit.toml"
    path.write_text((IMUS / "bench_mems_thermal.toml").read_text("utf-8").replace(old, new), "utf-8")
    with pytest.raises(ConfigurationError) as caught:
        load_imu_profile(path)
    assert code in str(caught.value.values) or code == caught.value.code


def test_the_coefficient_of_the_power_0_is_the_parameter(tmp_path: Path) -> None:
    path = tmp_path / "unit.toml"
    text = (IMUS / "bench_mems_thermal.toml").read_text("utf-8")
    path.write_text(text.replace('["gyro_bias_x", ', '["gyro_bias_x[0]", '), "utf-8")
    profile: ImuProfile = load_imu_profile(path)
    assert profile.registers[0].names[0] == "gyro_bias_x"


def test_a_unit_that_becomes_warmer_between_both_captures_is_verified() -> None:
    """The reference is corrected at its own temperature, as the output is at its temperature."""
    values, context = registers(), Captures("framed", recording("mems", 1, "rate")).context
    force = np.array([[0.0, 0.0, 9.8], [0.0, 9.8, 0.0]])
    true = np.hstack([np.full((2, 3), 4e-5), force])

    def captured(temperature: float, *, corrected: bool) -> VerificationData:
        p = polynomial(values, temperature)
        gyro, accel = (np.eye(3) + group_matrix(p, f"{s}_scale", f"{s}_misalign") for s in ("gyro", "accel"))
        raw = np.hstack([true[:, :3] @ gyro.T, force @ accel.T + group_vector(p, "accel_quadratic") * force**2])
        raw += np.hstack([group_vector(p, "gyro_bias"), group_vector(p, "accel_bias")])
        return VerificationData(tuple(true if corrected else raw), 2.0, corrected=corrected, temperature=temperature)

    data = replace(captured(35.0, corrected=True), reference=captured(20.0, corrected=False))
    checks = verify_output(data, AppliedRegisters(values), np.zeros((COUNT, COUNT)), context, REPEATABILITY)
    differences = [check for check in checks if check.name.endswith("difference")]
    assert len(differences) == 6
    assert max(check.value for check in differences) < 1e-7


@pytest.mark.parametrize("order", [None, 2, 7])
def test_a_result_is_written_by_hand_as_by_a_run(site_folder: SiteFolder, order: int | None) -> None:
    """Coefficients of an earlier calibration do not remain, and none that has no register is left out."""
    site_folder.write({"imu": "bench_mems_thermal", "bench_grade": "mems"})
    result = result_of(site_folder, gyro_bias_x=1e-4)
    if order is not None:
        row = Coefficients(values=[1e-4 / 65.0**k for k in range(order + 1)], sigma=[0.0] * (order + 1), unit="rad/s")
        ranges: dict[str, Any] = {"reference_c": 25.0, "range_c": (-40.0, 85.0), "covariance": [], "worst": {}}
        over = TemperatureResult(coefficients={"gyro_bias_x": row}, points=[], **ranges)
        result = result.model_copy(update={"temperature": over})
    if order == 7:
        with raises_code(InputError, "transfer.result_over_temperature"):
            target_registers(ignore_progress, site_folder.request(), result)
        return
    values = target_registers(ignore_progress, site_folder.request(), result).values
    assert values["gyro_bias_x"] == pytest.approx(1e-4)
    assert values["gyro_bias_x[1]"] == pytest.approx(0.0 if order is None else 1e-4 / 65.0)
    assert (values["gyro_bias_x[3]"], values["accel_bias_z[1]"]) == (0.0, 0.0)
    assert values["temperature_low"] == (0.0 if order is None else -40.0)


def test_a_calibration_at_one_temperature_replaces_the_coefficients() -> None:
    """It would otherwise be applied on top of those of an earlier calibration over temperature."""
    finalization = object.__new__(Finalization)
    finalization._setup = SimpleNamespace(after_registers=False)  # type: ignore[assignment]
    finalization._entries = thermal_map()
    finalization.run = SimpleNamespace(meta=SimpleNamespace(registers={}))  # type: ignore[assignment]
    posterior = Posterior(np.full(COUNT, 1e-4), np.eye(COUNT))
    solution = Solution("designed", posterior, NAMES, Consistency(1.0, 0.9, 1.1, 10))
    new = {**registers(), **finalization._registers_to_write((solution,))}
    for temperature in (-40.0, 85.0):
        assert values_at(new, temperature)["gyro_bias_x"] == 1e-4
    assert {value for name, value in new.items() if "[" in name} == {0.0}


def test_the_temperature_of_a_rest_without_a_table_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """The unit applies its polynomials at this temperature, not at their reference."""
    temperature = np.array([np.nan, 34.0, 36.0])
    batch = SimpleNamespace(counts=np.ones((3, 6)), temperature=temperature)
    monkeypatch.setattr(imu_session, "read_contiguous", lambda *values, **options: [batch])
    monkeypatch.setattr(imu_session, "corrected_output", lambda setup: Output.ON_COMMAND)
    model = SimpleNamespace(sample_rate=1.0, count_size=np.ones(6))
    status = SimpleNamespace(ready=0)
    setup: Any = SimpleNamespace(solve_context=lambda: SimpleNamespace(imu=model), imu=SimpleNamespace(status=status))
    session: Any = SimpleNamespace(imu=SimpleNamespace(start=lambda: None))
    data = imu_session.capture_rest(session, setup, lambda: None)
    assert data.reference is not None
    assert (data.temperature, data.reference.temperature) == (35.0, 35.0)
