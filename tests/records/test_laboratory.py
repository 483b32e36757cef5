"""Laboratory and instruments, including dates, are stored in the log."""

from datetime import date
from pathlib import Path

import pytest
import tomli_w

from calstation.config import load_configuration, load_station
from calstation.errors import ConfigurationError
from calstation.records.meta import meta_from_json
from tests.reports.certificates import LABORATORY, with_laboratory
from tests.site_folder import STATION, SiteFolder


def test_log_contains_the_laboratory_of_the_station(site_folder: SiteFolder) -> None:
    plain = load_configuration(site_folder.request()).log_meta()
    assert "laboratory" not in plain.to_json().partition('"profiles"')[0]
    assert '"instruments"' not in plain.to_json()  # so that the digest of logs without instruments is unchanged
    with_laboratory(site_folder)
    meta = load_configuration(site_folder.request()).log_meta()
    assert meta.laboratory is not None
    assert meta.laboratory.model_dump(exclude_none=True) == LABORATORY["laboratory"]
    assert meta.instruments[0].due == date(2121, 3, 2)
    assert meta_from_json(meta.to_json(), "log").instruments == meta.instruments


@pytest.mark.parametrize("due", ["soon", 5, True])
def test_invalid_date_is_reported_by_its_entry(tmp_path: Path, due: object) -> None:
    path = tmp_path / "station.toml"
    entries = {"bench": {}, "instruments": [{"name": "table", "due": due}]}
    path.write_text(tomli_w.dumps({**STATION, **entries}), encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"instruments\[.table.\]\.due: .*is not a date.*YYYY-MM-DD"):
        load_station(path)
