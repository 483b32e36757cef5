"""`calstation run` shares its records and says when another station works on the unit; it never waits for it."""

import sys
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from calstation.database import Exchange, ExchangeProcess, read_state
from calstation.database.outbox import Outbox
from tests.database.result_files import in_database
from tests.postgres import postgres as postgres
from tests.postgres import shared_database as shared_database
from tests.site_folder import SiteFolder


def sharing(folder: Path, url: str) -> SiteFolder:
    """A virtual station with a short product that shares its records."""
    made = SiteFolder(folder)
    made.write({"stages": ["six_position"]})
    station = tomllib.loads(made.station.read_text(encoding="utf-8"))
    made.station.write_text(tomli_w.dumps({**station, "records": {"database": url}}), encoding="utf-8")
    return made


def test_a_run_is_shared_and_names_another_station_with_its_unit(
    shared_database: str, tmp_path: Path, calstation: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("calstation.database.process._END_S", 60.0)  # on a busy computer the process starts slowly
    other = tmp_path / "line 2"
    other.mkdir()
    there = Exchange(other, shared_database, "line 2", {"SN-000042": "li"})
    assert there.exchange() == []
    site, out = sharing(tmp_path, shared_database), tmp_path / "runs"
    where = ("--station", site.station, "--product", site.product, "--out", out)
    done = calstation("run", *where, "--serial", "SN-000042", "--json", "-")
    assert done.code == 0, done.err
    assert "SN-000042 is also being calibrated at line 2 since" in done.err
    assert in_database(shared_database) == [(Path(done.json["log"]["file"]).stem, "test bench")]
    assert read_state(out).pending == 0
    assert there.exchange() == []  # the claim has ended
    there.close()


def test_a_run_does_not_wait_for_an_unreachable_database(
    tmp_path: Path, calstation: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    close = ExchangeProcess.close

    def noted(exchange: ExchangeProcess) -> None:
        sys.stderr.write("last exchange\n")
        close(exchange)

    monkeypatch.setattr(ExchangeProcess, "close", noted)
    site, out = sharing(tmp_path, "postgresql+psycopg://line@127.0.0.1:1/none"), tmp_path / "runs"
    where = ("--station", site.station, "--product", site.product, "--out", out)
    done = calstation("run", *where, "--json", "-")
    assert done.code == 0, done.err
    assert "database" not in done.err
    assert done.err.index("\nresult:") < done.err.index("last exchange")
    ended = max(path.stat().st_mtime for path in out.glob("*.json"))
    assert time.time() - ended < 30.0
    outbox = Outbox(out)
    outbox.fill()
    assert outbox.pending == 1
