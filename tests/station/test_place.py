"""Latitude and gravity of a station: what contradicts itself is refused before anything is opened."""

from pathlib import Path
from typing import Any

import pytest

from calstation.config.site_check import (
    check_confirmation,
    check_latitude,
    check_seen_latitude,
    check_site,
    confirmation_key,
    latitude_untold,
    there,
)
from calstation.config.station import StationSite
from calstation.errors import ConfigurationError
from calstation.estimation.common.context import Belief
from calstation.estimation.common.latitude import LatitudeEstimate
from calstation.estimation.common.least_squares import Consistency
from calstation.estimation.method import Solution
from calstation.physics.parameters import COUNT
from calstation.records.meta import LogMeta

HERE = Path("station.toml")
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
def test_surveyed_gravity_within_what_the_earth_does_is_believed(gravity: float) -> None:
    check_site(meta(MEMS, "six_position", gravity_mps2=gravity), HERE)


@pytest.mark.parametrize(
    "wrong",
    [{"gravity_mps2": 9.7924}, {"gravity_mps2": 9.7985}, {"latitude_deg": 39.25}, {"height_m": 4000.0}],
)
@pytest.mark.parametrize("noise", [NAV, MEMS])
def test_a_slip_in_gravity_latitude_or_height_contradicts_the_others(
    noise: dict[str, float], wrong: dict[str, float]
) -> None:
    with pytest.raises(ConfigurationError, match=r"station.toml: site.gravity_mps2 = .*; correct"):
        check_site(meta(noise, "rate", **{"gravity_mps2": 9.79547, **wrong}), HERE)


def test_only_who_feels_the_earth_turn_needs_no_surveyed_gravity() -> None:
    check_site(meta(NAV, "six_position"), HERE)
    check_site(meta(MEMS, "rate"), HERE)  # turned both ways, a gyro's scale factor carries no latitude
    for stage in ("six_position", "excitation", "multi_position"):
        with pytest.raises(ConfigurationError, match=r"site.gravity_mps2 is missing.*; add"):
            check_site(meta(MEMS, "rate", stage), HERE)


def standing(*told: str, **otherwise: float) -> StationSite:
    here = {"latitude_deg": 34.25, "longitude_deg": 108.9, "height_m": 400.0, "gravity_mps2": 9.79547}
    return StationSite.model_validate({**here, **otherwise, "confirmed_on": list(told)})


CONFIRMED = confirmation_key(standing())


@pytest.mark.parametrize(
    ("noise", "site", "refused"),
    [
        (NAV, standing(), ""),
        (MEMS, standing(), "is missing"),
        (MEMS, standing("plant-2: 34.25 108.9 400.0 9.79547"), "names plant-2: 34.25 108.9 400.0 9.79547"),
        (NAV, standing("a", "b"), "names a; b"),
        (MEMS, standing("a", CONFIRMED), ""),
        (NAV, standing(CONFIRMED, height_m=900.0), "names"),
        (MEMS, standing(CONFIRMED, gravity_mps2=9.7955), "names"),
    ],
)
def test_a_station_file_from_another_place_needs_a_person_here(
    noise: dict[str, float], site: StationSite, refused: str
) -> None:
    run = meta(noise, "six_position")
    if not refused:
        check_confirmation(site, run, HERE)
        return
    with pytest.raises(
        ConfigurationError, match=rf"site.confirmed_on {refused}.* latitude 34.25°, .*; make sure.* confirm"
    ):
        check_confirmation(site, run, HERE)


def test_stages_that_carry_no_gravity_need_nobody() -> None:
    check_confirmation(standing(), meta(MEMS, "rate"), HERE)


def solved(latitude: LatitudeEstimate | None, nis: float = 1.0) -> tuple[Solution, ...]:
    belief = Belief([0.0] * COUNT, [[0.0] * COUNT] * COUNT)  # type: ignore[arg-type]
    return (Solution("six_position", belief, (), Consistency(nis, 0.9, 1.1, 1), latitude=latitude),)


def test_a_latitude_seen_elsewhere_is_a_check_that_fails_and_ends_the_run() -> None:
    told = meta(NAV, "six_position")
    for seen, agrees in ((LatitudeEstimate(0.5978, 1e-4), True), (LatitudeEstimate(0.60, 1e-4), False)):
        (check,) = check_latitude(told, solved(seen))
        assert (check.name, check.unit, check.passed) == ("latitude", "rad", agrees)
        assert there([check]) is agrees
    with pytest.raises(ConfigurationError, match=r"as at 34.38° \(sigma 0.01°\); correct latitude"):
        check_seen_latitude(told, solved(LatitudeEstimate(0.60, 1e-4)))


def test_where_nothing_is_seen_nothing_is_said() -> None:
    told = meta(NAV, "rate")
    for solutions in ((), solved(None)):
        assert check_latitude(told, solutions) == []
        check_seen_latitude(told, solutions)


def test_what_does_not_fit_together_names_a_latitude_that_no_rest_has_told() -> None:
    told, misfit = meta(NAV, "six_position"), solved(None, nis=5.0)
    assert latitude_untold(told, misfit) == {"stage": "six_position", "latitude": 34.25}
    assert latitude_untold(told, solved(None)) is None
    assert latitude_untold(told, solved(LatitudeEstimate(0.5978, 1e-4), nis=5.0)) is None
    assert latitude_untold(meta(MEMS, "six_position"), misfit) is None
