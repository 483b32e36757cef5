"""Runs on tables with text protocols and on two drives have the same plan and verdict."""

import pytest
import tomli_w

from tests.helpers import sampled
from tests.site_folder import STATION, SiteFolder

pytestmark = pytest.mark.long


@pytest.mark.parametrize("profile", sampled(2, ["aerosmith_atl", "acutronic_acl", "mn_ascii", "cia402_drives"]))
def test_stage_runs_on_a_table_with_another_protocol(site_folder: SiteFolder, profile: str) -> None:
    station = {**STATION, "table": {"profile": profile}, "bench": {"seed": 5, "start_deg": [1.0, -1.0]}}
    site_folder.station.write_text(tomli_w.dumps(station), encoding="utf-8")
    ended = site_folder.run("rate")
    assert ended.verdict.passed
    assert ended.result["registers"]["verified"]
