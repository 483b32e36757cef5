"""The current calibration: its joint estimate, age, registers, and the resulting prior."""

from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import tomli_w

from calstation.config import RunConfiguration, load_configuration
from calstation.devices.profiles import load_imu_profile
from calstation.errors import InputError
from calstation.estimation import Solution
from calstation.estimation.common import Consistency, Posterior
from calstation.judgement import check_limits, unobservable
from calstation.judgement.limits import not_compared
from calstation.physics import COUNT, INDEX, NAMES, compose, composition, group_indices, parameter_vector
from calstation.records import CalibrationSection, Limit, LogMeta, correlation_of, covariance_from, prior_from_meta
from calstation.results import current_calibration, estimate_of
from calstation.results.calibration import Calibration, from_estimate
from calstation.schema import load
from tests.helpers import error_code
from tests.records.records_samples import META
from tests.results.test_history import refreshed, write
from tests.site_folder import SiteFolder, with_corrected_output

YEAR = 365.25 * 86400.0


def posterior(seed: int = 1, scale: float = 1e-6) -> Posterior:
    """Return correlated parameters with sigmas of about `scale`."""
    random = np.random.default_rng(seed)
    root = scale * random.standard_normal((COUNT, COUNT + 10)) / np.sqrt(COUNT)
    return Posterior(1e-3 * random.standard_normal(COUNT), root @ root.T)


def setup(site_folder: SiteFolder, profile: str = "bench_nav") -> RunConfiguration:
    site_folder.write({"imu": profile})
    return load_configuration(replace(site_folder.request("azimuth_flip"), serial="SN-000042"))


def held(setup_: RunConfiguration, output: Posterior) -> dict[str, float]:
    """Return registers with the values of a posterior."""
    names = [name for entry in setup_.imu.registers for name in entry.parameters if name]
    return {name: float(np.float32(output.mean[INDEX[name]])) for name in names}


def result(folder: Path, name: str, day: int, output: Posterior, registers: dict[str, float], **more: Any) -> None:
    """Write the result of a run that wrote registers."""
    section = {"old": {}, "new": registers, "verified": True, "estimate": estimate_of(output, {}).model_dump(), **more}
    files = {"imu": {"name": "bench_nav", "sha256": "0"}}
    outcome = "passed" if day != 9 else "failed"
    write(folder, name, "SN-000042", outcome, day, registers=section, configuration=files)


def test_an_estimate_is_read_back(tmp_path: Path) -> None:
    output = posterior()
    again = from_estimate(type(estimate_of(output, {})).model_validate_json(estimate_of(output, {}).model_dump_json()))
    np.testing.assert_array_equal(again.mean, output.mean)
    np.testing.assert_allclose(again.covariance, output.covariance, rtol=1e-14, atol=1e-30)


def test_estimate_from_corrected_output_equals_the_raw_output_estimate() -> None:
    output, registers = posterior(), {name: 2e-3 * (-1) ** i for i, name in enumerate(NAMES[:24])}
    estimate = from_estimate(estimate_of(output, registers))
    remaining = dict(zip(NAMES, output.mean.tolist(), strict=True))
    assert dict(zip(NAMES, estimate.mean.tolist(), strict=True)) == pytest.approx(compose(registers, remaining))
    offset, matrix = composition(registers)
    values = parameter_vector({"gyro_scale_y": 0.5, "accel_bias_z": -2.0})
    whole = parameter_vector(compose(registers, {"gyro_scale_y": 0.5, "accel_bias_z": -2.0}))
    np.testing.assert_allclose(offset + matrix @ values, whole, atol=1e-15)


def test_prior_is_the_aged_joint_estimate(site_folder: SiteFolder) -> None:
    configured, output = setup(site_folder), posterior()
    meta = configured.log_meta()
    assert meta.run is not None
    started = (datetime.fromisoformat(meta.run.started_utc) - timedelta(days=365)).isoformat()
    section = {"log": "a.h5", "started_utc": started}
    aged = Calibration(CalibrationSection(**section), output, {}).prior(configured, meta)
    prior, lever = prior_from_meta(aged), group_indices("outer_lever")
    others = np.delete(np.arange(COUNT), lever)
    growth = np.zeros(COUNT)
    for group, power_up, year in (("gyro_bias", 1e-8, 5e-8), ("accel_bias", 2e-5, 2.5e-4), ("accel_scale", 1e-6, 3e-5)):
        growth[group_indices(group)] = power_up**2 + year**2 * (365 * 86400.0) / YEAR
    np.testing.assert_array_equal(prior.mean[others], output.mean[others])
    index = np.concatenate([group_indices(group) for group in ("gyro_bias", "accel_bias", "accel_scale")])
    expected = np.diag(output.covariance)[index] + growth[index]
    np.testing.assert_allclose(np.diag(prior.covariance)[index], expected, rtol=1e-9)
    off = ~np.eye(COUNT, dtype=bool)
    off[lever, :] = off[:, lever] = False
    np.testing.assert_allclose(prior.covariance[off], output.covariance[off], rtol=1e-12)
    np.testing.assert_allclose(prior.sigma[lever], prior_from_meta(meta).sigma[lever])
    assert not prior.covariance[np.ix_(lever, others)].any()
    assert aged.run is not None
    assert aged.run.calibration is not None
    assert aged.run.calibration.log == "a.h5"
    assert aged.calibrated == set(NAMES) - {NAMES[i] for i in lever}


def test_prior_of_corrected_output_is_the_residual_error(
    site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    configured, output = setup(site_folder), posterior()
    text = with_corrected_output(configured.sources["imu"].text)
    path = site_folder.folder / "after.toml"
    path.write_text(text, encoding="utf-8")
    after = replace(configured, imu=load_imu_profile(path))
    registers = held(after, output)
    meta = after.log_meta(registers=registers)
    assert meta.run is not None
    section = CalibrationSection(log="a.h5", started_utc=meta.run.started_utc)
    prior = prior_from_meta(Calibration(section, output, registers).prior(after, meta))
    left = compose(registers, dict(zip(NAMES, prior.mean.tolist(), strict=True)))
    inner = [i for i in range(COUNT) if i not in group_indices("outer_lever")]
    np.testing.assert_allclose(parameter_vector(left)[inner], output.mean[inner], rtol=1e-12)
    written = [INDEX[name] for name in registers]
    assert np.abs(prior.mean[written]).max() < 1e-8


def test_only_registers_of_a_verified_run_are_current(
    site_folder: SiteFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    configured, runs = setup(site_folder), tmp_path / "history"
    opened = SimpleNamespace(meta=configured.log_meta())
    monkeypatch.setattr("calstation.results.calibration.open_log", lambda path: opened)
    runs.mkdir()
    first, second = posterior(1), posterior(2)
    result(runs, "a", 1, first, held(configured, first))
    result(runs, "b", 2, second, held(configured, second))
    result(runs, "c", 3, first, held(configured, first), verified=False)
    result(runs, "d", 9, second, held(configured, second))
    history = refreshed(runs)
    for output, log in ((first, "a.h5"), (second, "b.h5")):
        calibration, message = current_calibration(history, configured, held(configured, output))
        assert calibration is not None
        assert (calibration.section.log, message.id) == (log, "prior_calibration")
        np.testing.assert_array_equal(calibration.posterior.mean, output.mean)
    other = held(configured, first)
    other["gyro_bias_x"] = float(np.nextafter(np.float32(other["gyro_bias_x"]), np.float32(1.0)))
    none, message = current_calibration(history, configured, other)
    assert (none, message.id) == (None, "prior_other_registers")
    latest, _ = current_calibration(history, configured, None)
    assert latest is not None
    assert latest.section.log == "b.h5"
    rescaled = configured.log_meta()
    opened.meta = rescaled.model_copy(update={"imu": rescaled.imu.model_copy(update={"gyro_lsb": 1.0})})
    none, message = current_calibration(history, configured, held(configured, second))
    assert (none, message.id) == (None, "prior_no_calibration")
    other_unit = replace(configured, request=replace(configured.request, serial="SN-000043"))
    none, message = current_calibration(history, other_unit, other)
    assert (none, message.id) == (None, "prior_no_calibration")


def test_correlations_survive_toml(tmp_path: Path) -> None:
    covariance = posterior().covariance
    sigma = np.sqrt(np.diag(covariance))
    prior = {name: {"value": 0.1, "sigma": float(sigma[INDEX[name]])} for name in NAMES}
    correlation = correlation_of(covariance)
    meta = LogMeta.model_validate({**META, "prior": prior, "prior_correlation": correlation})
    path = tmp_path / "log.toml"
    path.write_text(meta.to_toml(), encoding="utf-8")
    again = load(LogMeta, path, InputError)
    assert again == meta
    assert not again.calibrated
    np.testing.assert_array_equal(prior_from_meta(again).covariance, prior_from_meta(meta).covariance)
    np.testing.assert_allclose(prior_from_meta(again).covariance, covariance, rtol=1e-14)
    np.testing.assert_array_equal(covariance_from(sigma, {}), np.diag(sigma**2))


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"gyro_bias_x": {"gyro_bias_w": 0.1}}, "prior_correlation.gyro_bias_x.gyro_bias_w entry.unknown_parameter"),
        ({"gyro_bias_x": {"gyro_bias_x": 0.1}}, "prior_correlation.gyro_bias_x.gyro_bias_x log.correlation_repeated"),
        (
            {"gyro_bias_x": {"gyro_bias_y": 0.1}, "gyro_bias_y": {"gyro_bias_x": 0.1}},
            "prior_correlation.gyro_bias_x.gyro_bias_y log.correlation_repeated",
        ),
        ({"gyro_bias_x": {"gyro_bias_y": 1.1}}, "prior_correlation log.correlation_impossible"),
    ],
)
def test_invalid_correlations_are_refused(tmp_path: Path, table: dict[str, Any], message: str) -> None:
    path = tmp_path / "log.toml"
    path.write_text(tomli_w.dumps({**META, "prior_correlation": table}), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load(LogMeta, path, InputError)
    assert error_code(caught.value) == message


def solution(prior: Posterior, name: str, value: float, sigma: float) -> Solution:
    """Return the solution of a stage that changes one parameter of its prior."""
    mean, covariance = prior.mean.copy(), prior.covariance.copy()
    mean[INDEX[name]], covariance[INDEX[name], INDEX[name]] = value, sigma**2
    return Solution("rate", Posterior(mean, covariance), (name,), Consistency(1.0, 0.5, 1.5, 100))


@pytest.mark.parametrize(("change", "passed"), [(3e-6, True), (6e-6, False)])
def test_unit_that_changed_since_its_calibration_fails(change: float, passed: bool) -> None:
    prior, sigma = Posterior(np.zeros(COUNT), np.eye(COUNT) * 1e-12), 0.5e-6
    output = solution(prior, "gyro_scale_x", change, sigma)
    checks = {check.kind: check for check in check_limits({}, prior, (output,), calibrated=("gyro_scale_x",))}
    assert checks["unobservable"].passed
    assert checks["change"].value == pytest.approx(change / np.sqrt(1e-12 - sigma**2))
    assert (checks["change"].passed, checks["change"].where.parameter) == (passed, "gyro_scale_x")


@pytest.mark.parametrize("determined", [0, 1, 2])
def test_partial_run_passes_if_it_determines_at_least_half_of_its_parameters(determined: int) -> None:
    prior = Posterior(np.zeros(COUNT), np.eye(COUNT) * 1e-12)
    names = ("gyro_bias_x", "gyro_bias_y", "gyro_bias_z", "gyro_scale_x")
    covariance = prior.covariance.copy()
    covariance[range(determined), range(determined)] /= 4.0
    output = Solution("azimuth_flip", Posterior(prior.mean, covariance), names, Consistency(1.0, 0.5, 1.5, 100))
    limits = {name: Limit(sigma_below=1e-3) for name in names}
    checks = {check.name: check for check in check_limits(limits, prior, (output,), calibrated=NAMES)}
    assert checks["unobservable parameters"].passed is (determined == 2)
    assert checks["unobservable parameters"].value == (0 if determined == 2 else 4 - determined)
    assert [name for name in names if f"{name} sigma below" in checks] == list(names[:determined])
    assert not_compared(limits, prior, (output,)) == unobservable(prior, (output,)) == list(names[determined:])


def test_profile_without_stability_data_ages_by_its_prior(site_folder: SiteFolder) -> None:
    imu = setup(site_folder).imu.model_copy(update={"stability": {}})
    sigma = imu.change_sigmas(4.0)[INDEX["gyro_scale_x"]]
    assert sigma == pytest.approx(np.hypot(0.01 * 0.002, 0.1 * 0.002 * 2.0))
