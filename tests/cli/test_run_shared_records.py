"""`calstation run` shares its records and warns if another station claims the unit; it never waits for the database."""

import socket
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from calstation.cli import run as run_module
from calstation.cli.run import shared_records
from calstation.config import RunRequest
from calstation.database import Exchange, Outbox, read_state
from tests.database.result_files import in_database
from tests.database.test_exchange_process import eventually
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


def test_run_is_shared_and_warns_if_another_station_claims_its_unit(
    shared_database: str, tmp_path: Path, calstation: Callable[..., Any]
) -> None:
    other = tmp_path / "line 2"
    other.mkdir()
    there = Exchange(other, shared_database, "line 2", {"SN-000042": "li"})
    assert there.exchange() == []
    site, out = sharing(tmp_path, shared_database), tmp_path / "runs"
    request = RunRequest("SN-000042", site.station, site.product, out=out)
    with shared_records(request) as new_claims:
        claims = []
        eventually(lambda: claims.extend(new_claims()) or claims)
        assert [(claim.serial, claim.station, claim.operator) for claim in claims] == [("SN-000042", "line 2", "li")]
        eventually(there.exchange)
        where = ("--station", site.station, "--product", site.product, "--out", out)
        done = calstation("run", *where, "--serial", "SN-000042", "--json", "-")
        assert done.code == 0, done.err
        assert "SN-000042 has also been claimed for calibration by li at line 2 since" in done.err
    run = (Path(done.json["log"]["file"]).stem, "test bench")
    eventually(lambda: in_database(shared_database) == [run])
    eventually(lambda: read_state(out).pending == 0)
    eventually(lambda: there.exchange() == [])  # the claim has ended
    there.close()


@pytest.mark.long
def test_a_run_does_not_wait_for_a_database_that_hangs(
    tmp_path: Path, calstation: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[float] = []
    emit = run_module.emit_json

    def noted(result: Any, json: str | None) -> None:
        shown.append(time.monotonic())
        emit(result, json)

    monkeypatch.setattr(run_module, "emit_json", noted)
    with socket.create_server(("127.0.0.1", 0)) as server:  # accepts connections and says nothing
        site = sharing(tmp_path, f"postgresql+psycopg://line@127.0.0.1:{server.getsockname()[1]}/none")
        where = ("--station", site.station, "--product", site.product, "--out", tmp_path / "runs")
        done = calstation("run", *where, "--json", "-")
        assert done.code == 0, done.err
        assert time.monotonic() - shown[-1] < 1.0
        assert "database" not in done.err
    outbox = Outbox(tmp_path / "runs")
    outbox.refresh()
    assert outbox.pending == 1
