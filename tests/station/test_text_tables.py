"""A run on tables of text, and on two drives: the same plan, the same verdict, behind another protocol."""

import pytest
import tomli_w

from tests.station.conftest import STATION, Place

pytestmark = pytest.mark.long


@pytest.mark.parametrize("profile", ["aerosmith_atl", "acutronic_acl", "mn_ascii", "cia402_drives"])
def test_a_stage_runs_on_another_table(place: Place, profile: str) -> None:
    station = {**STATION, "table": {"profile": profile}, "bench": {"seed": 5, "start_deg": [1.0, -1.0]}}
    place.station.write_text(tomli_w.dumps(station), encoding="utf-8")
    verdict = place.run("rate")
    assert verdict.outcome == "passed"
    assert verdict.result["registers"]["verified"]
