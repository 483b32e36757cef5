"""The engine refuses a run without a badge, independent of the requesting program."""

import tomllib

import pytest
import tomli_w

from calstation.errors import ConfigurationError
from tests.site_folder import SiteFolder


def test_engine_refuses_a_run_without_a_badge(site_folder: SiteFolder) -> None:
    station = tomllib.loads(site_folder.station.read_text(encoding="utf-8"))
    text = tomli_w.dumps({**station, "sign_in": {"badge_pattern": r"B\d{4}"}})
    site_folder.station.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError, match="“tester” is not a badge of this station"):
        site_folder.run()
    assert not (site_folder.folder / "runs").exists()
