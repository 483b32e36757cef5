"""Contradictory latitude and gravity of a station are refused before any device is opened."""

from dataclasses import replace
from typing import Any

import pytest

from calstation.config import confirmation_key
from calstation.config.site_check import check_confirmation, check_gravity_sigma, check_site
from calstation.config.station import StationSite
from calstation.errors import ConfigurationError
from calstation.estimation import Solution
from calstation.estimation.common import Consistency, LatitudeEstimate, Posterior
from calstation.judgement import latitude_agrees, require_latitude, unconfirmed_site
from calstation.judgement.site import check_latitude, unconfirmed_latitude
from calstation.physics import COUNT
from calstation.records import LogMeta
from calstation.schema import EntryError
from tests.helpers import raises_code

NAV = {"gyro_arw": 2.9e-7, "gyro_bias_instability": 4.8e-9}
MEMS = {"gyro_arw": 8.7e-5, "gyro_bias_instability": 2.4e-5}


def meta(noise: dict[str, float], *stages: str, **site: Any) -> LogMeta:
    imu = {"serial": "1", "sample_rate_hz": 100.0, "output": "rate", "gyro_lsb": 1e-9, "accel_lsb": 1e-6}
    return LogMeta.model_validate(
        {
            "site": {"latitude_deg": 34.25, "longitude_deg": 108.9, "height_m": 400.0, **site},
            "imu": {**imu, "accel_vrw": 1e-4, **noise},
            "run": {"stages": list(stages), "software": "1", "started_utc": "2026-01-01T00:00:00+00:00"},
        }
    )


@pytest.mark.parametrize("gravity", [9.79547, 9.7928, 9.7981])
def test_surveyed_gravity_within_natural_anomalies_is_accepted(gravity: float) -> None:
    check_site(meta(MEMS, "six_position", gravity_mps2=gravity))


@pytest.mark.parametrize(
    "wrong",
    [{"gravity_mps2": 9.7924}, {"gravity_mps2": 9.7985}, {"latitude_deg": 39.25}, {"height_m": 4000.0}],
)
@pytest.mark.parametrize("noise", [NAV, MEMS])
def test_gravity_that_contradicts_latitude_or_height_is_refused(
    noise: dict[str, float], wrong: dict[str, float]
) -> None:
    with raises_code(EntryError, "site.gravity_contradicts") as caught:
        check_site(meta(noise, "rate", **{"gravity_mps2": 9.79547, **wrong}))
    assert caught.value.key_path == ("site", "gravity_mps2")


def test_gyros_that_resolve_earth_rate_need_no_surveyed_gravity() -> None:
    check_site(meta(NAV, "six_position"))
    check_site(meta(MEMS, "rate"))  # turns in both directions make the gyro scale factor independent of the latitude
    for stage in ("six_position", "excitation", "multi_position"):
        with raises_code(EntryError, "site.gravity_missing"):
            check_site(meta(MEMS, "rate", stage))


@pytest.mark.parametrize(("site", "key"), [({}, "gravity_mps2"), ({"gravity_sigma_mps2": 1e-4}, "gravity_mps2")])
def test_limit_tighter_than_the_gravity_uncertainty_is_refused(site: dict[str, float], key: str) -> None:
    with raises_code(EntryError, "site.gravity_uncertain") as caught:
        check_gravity_sigma(meta(NAV, "six_position", **site), {"gyro_scale_x": 1e-6, "accel_scale_y": 5e-6})
    assert caught.value.key_path == ("site", key)
    assert caught.value.values["parameter"] == "accel_scale_y"
    check_gravity_sigma(meta(NAV, "six_position", **site), {"accel_scale_y": 1e-4})
    check_gravity_sigma(meta(NAV, "six_position", gravity_mps2=9.79547), {"accel_scale_y": 5e-6})


def test_imported_recording_requires_site_confirmation() -> None:
    solutions = (replace(solved(None)[0], estimated=("accel_scale_x",)),)
    foreign = meta(MEMS, gravity_mps2=9.79547).model_copy(update={"run": None})
    asked = unconfirmed_site(foreign, solutions)
    assert asked is not None
    assert asked["latitude"] == 34.25
    assert unconfirmed_site(meta(MEMS, "six_position"), solutions) is None  # a run requires the confirmation itself
    assert unconfirmed_site(meta(NAV).model_copy(update={"run": None}), solutions) is None
    assert unconfirmed_site(foreign, solved(None)) is None


def station_site(*confirmed: str, **otherwise: float) -> StationSite:
    here = {"latitude_deg": 34.25, "longitude_deg": 108.9, "height_m": 400.0, "gravity_mps2": 9.79547}
    return StationSite.model_validate({**here, **otherwise, "confirmed_on": list(confirmed)})


CONFIRMED = confirmation_key(station_site())


@pytest.mark.parametrize(
    ("noise", "site", "code"),
    [
        (NAV, station_site(), ""),
        (MEMS, station_site(), "site.not_confirmed"),
        (MEMS, station_site("plant-2: 34.25 108.9 400.0 9.79547"), "site.confirmed_elsewhere"),
        (NAV, station_site("a", "b"), "site.confirmed_elsewhere"),
        (MEMS, station_site("a", CONFIRMED), ""),
        (NAV, station_site(CONFIRMED, height_m=900.0), "site.confirmed_elsewhere"),
        (MEMS, station_site(CONFIRMED, gravity_mps2=9.7955), "site.confirmed_elsewhere"),
    ],
)
def test_site_confirmed_on_another_computer_must_be_confirmed_again(
    noise: dict[str, float], site: StationSite, code: str
) -> None:
    run = meta(noise, "six_position")
    if not code:
        check_confirmation(site, run)
        return
    with raises_code(EntryError, code) as caught:
        check_confirmation(site, run)
    assert caught.value.key_path == ("site", "confirmed_on")
    assert caught.value.values["key"] == confirmation_key(site)
    assert caught.value.values.get("confirmed", "") == "; ".join(site.confirmed_on)


def test_stages_without_accelerometer_scale_factors_need_no_confirmation() -> None:
    check_confirmation(station_site(), meta(MEMS, "rate"))


def solved(latitude: LatitudeEstimate | None, nis: float = 1.0) -> tuple[Solution, ...]:
    posterior = Posterior([0.0] * COUNT, [[0.0] * COUNT] * COUNT)  # type: ignore[arg-type]
    return (Solution("six_position", posterior, (), Consistency(nis, 0.9, 1.1, 1), latitude=latitude),)


def test_measured_latitude_that_contradicts_the_site_ends_the_run() -> None:
    log_meta = meta(NAV, "six_position")
    for seen, agrees in ((LatitudeEstimate(0.5978, 1e-4), True), (LatitudeEstimate(0.60, 1e-4), False)):
        (check,) = check_latitude(log_meta, solved(seen))
        assert (check.name, check.unit, check.passed) == ("latitude", "rad", agrees)
        assert latitude_agrees([check]) is agrees
        assert agrees or (check.diagnosis is not None and check.diagnosis.cause == "latitude_unlike")
    with pytest.raises(ConfigurationError, match=r"the earth rate of latitude 34.38° \(sigma 0.01°\)"):
        require_latitude(log_meta, solved(LatitudeEstimate(0.60, 1e-4)))


def test_latitudes_that_differ_between_stages_are_a_change_of_a_gyro_bias() -> None:
    log_meta, latest = meta(NAV, "six_position"), LatitudeEstimate(0.60, 1e-4)
    for earlier, cause in ((0.6001, "latitude_unlike"), (0.5978, "gyro_bias_wanders")):
        solutions = (*solved(LatitudeEstimate(earlier, 1e-4)), *solved(latest))
        (check,) = check_latitude(log_meta, solutions)
        assert check.diagnosis is not None
        assert check.diagnosis.cause == cause
    require_latitude(log_meta, solutions)  # the site is not wrong


def test_no_latitude_check_without_a_latitude_estimate() -> None:
    log_meta = meta(NAV, "rate")
    for solutions in ((), solved(None)):
        assert check_latitude(log_meta, solutions) == []
        require_latitude(log_meta, solutions)


def test_inconsistent_stage_reports_an_unconfirmed_latitude() -> None:
    log_meta, diagnosis = meta(NAV, "six_position"), solved(None, nis=5.0)
    assert unconfirmed_latitude(log_meta, diagnosis) == {"stage": "six_position", "latitude": 34.25}
    both = tuple(f"accel_{kind}_{axis}" for kind in ("bias", "scale") for axis in "xyz")
    (upright_and_inverted,) = (replace(each, estimated=both) for each in solved(None))
    assert unconfirmed_latitude(log_meta, (upright_and_inverted, *diagnosis)) is None, "this run can measure it"
    assert unconfirmed_latitude(log_meta, (*solved(LatitudeEstimate(0.5978, 1e-4)), *diagnosis)) is None
    assert unconfirmed_latitude(log_meta, solved(None)) is None
    assert unconfirmed_latitude(log_meta, solved(LatitudeEstimate(0.5978, 1e-4), nis=5.0)) is None
    assert unconfirmed_latitude(meta(MEMS, "six_position"), diagnosis) is None
