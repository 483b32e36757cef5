"""Two stations that work on the same unit both get a warning; a claim ends with its station or after five minutes."""

import multiprocessing
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import create_engine, select, update

from calstation.config import library
from calstation.database import Claim, Exchange, Outbox, connect
from calstation.database.exchange import claim_units, other_claims
from calstation.database.process import MAX_RETRY_S
from calstation.database.tables import claims
from calstation.messages import event_text, sentence
from tests.database.result_files import in_database, write_result


def station_file(folder: Path, url: str) -> Path:
    """Write a virtual station, named after its folder, that shares its records."""
    shipped = library.find("stations", "virtual_bench").read_text(encoding="utf-8")
    lines = [line for line in shipped.splitlines() if not line.startswith("name")]
    path = folder.parent / f"{folder.name}.toml"
    path.write_text("\n".join([f'name = "{folder.name}"', *lines, "[records]", f'database = "{url}"', ""]), "utf-8")
    return path


def scan(start: float, url: str, folder: Path, serial: str) -> list[Claim]:
    """Claim a unit at a given time in a separate process, and return the claims of other stations on it."""
    time.sleep(max(0.0, start - time.time()))
    engine, outbox = connect(url), Outbox(folder).id
    claim_units(engine, outbox, folder.name, {serial: "li"})
    found = other_claims(engine, outbox)
    engine.dispose()
    return [claim for claim in found if claim.serial == serial]


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    """Runs folders of two stations."""
    made = tmp_path / "line 1", tmp_path / "line 2"
    for folder in made:
        folder.mkdir()
    return made


def test_two_stations_that_scan_the_same_unit_are_both_warned(shared_database: str, folders: tuple[Path, Path]) -> None:
    context = multiprocessing.get_context("spawn")
    counts = {0: 0, 1: 0}
    with context.Pool(2) as pool:
        pool.starmap(
            scan, [(0.0, shared_database, folders[k], "SN-0") for k in (0, 1)], chunksize=1
        )  # imports are done
        for number in range(1, 11):
            start = datetime.now(UTC).timestamp() + 0.2
            work = [(start, shared_database, folders[k], f"SN-{number}") for k in (0, 1)]
            found = pool.starmap(scan, work, chunksize=1)
            assert any(found)  # the station that scans last sees the other's claim immediately
            for k, there in enumerate(found):
                assert all((claim.serial, claim.operator) == (f"SN-{number}", "li") for claim in there)
                assert {claim.station for claim in there} <= {folders[1 - k].name}
                counts[k] += len(there)
    assert sum(counts.values()) >= 10
    for k in (0, 1):  # the exchange informs the station that scanned first
        exchange = Exchange(folders[k], shared_database, folders[k].name)
        there = exchange.exchange()
        exchange.close()
        assert {claim.serial for claim in there} == {f"SN-{number}" for number in range(11)}
        assert {claim.station for claim in there} == {folders[1 - k].name}
    utc = there[0].since
    assert abs(datetime.now(UTC) - utc) < timedelta(minutes=5)
    text = event_text(there[0].message.id, there[0].message.values)
    assert (
        sentence(text) == f"SN-0 has also been claimed for calibration by li at line 1 since {utc.astimezone():%H:%M}."
    )
    assert sentence(text, "zh_CN") == f"SN-0 自 {utc.astimezone():%H:%M} 起也在 line 1 由 li 标定。"


def serials(url: str, changes: dict[str, Any] | None = None) -> list[str]:
    """Return the claimed units in a database, in order, after changing all claims."""
    engine = create_engine(url)
    with engine.begin() as connection:
        if changes is not None:
            connection.execute(update(claims).values(**changes))
        found = connection.execute(select(claims.c.serial).order_by(claims.c.serial)).scalars().all()
    engine.dispose()
    return list(found)


def test_all_units_of_a_batch_are_claimed(url: str, folders: tuple[Path, Path]) -> None:
    batch, other = (Exchange(folder, url, folder.name) for folder in folders)
    batch.claimed, other.claimed = {"SN-1": "li", "SN-2": "li"}, {"SN-2": None}
    assert batch.exchange() == []
    assert [(claim.serial, claim.station) for claim in other.exchange()] == [("SN-2", "line 1")]
    assert [(claim.serial, claim.station) for claim in batch.exchange()] == [("SN-2", "line 2")]
    batch.claimed = {"SN-1": "li"}
    batch.exchange()
    assert other.exchange() == []
    batch.close()
    other.close()
    assert serials(url) == []


def test_claim_lasts_while_the_station_renews_it(url: str, folders: tuple[Path, Path]) -> None:
    one, two = (Exchange(folder, url, folder.name, {"SN-1": "li"}) for folder in folders)
    assert one.exchange() == []
    (since,) = [claim.since for claim in two.exchange()]
    one.exchange()
    assert [(claim.station, claim.operator, claim.since) for claim in two.exchange()] == [("line 1", "li", since)]
    assert [claim.station for claim in one.exchange()] == ["line 2"]
    past = datetime.now(UTC) - timedelta(seconds=1)
    serials(url, {"expires": past})  # simulates five minutes without contact
    assert two.exchange() == []
    assert [claim.station for claim in one.exchange()] == ["line 2"]
    assert [claim.station for claim in two.exchange()] == ["line 1"]
    one.claimed = {"SN-2": "li"}
    one.exchange()
    assert serials(url) == ["SN-1", "SN-2"]
    assert two.exchange() == []
    one.claimed = {}
    one.exchange()
    assert serials(url) == ["SN-1"]
    two.close()
    assert serials(url) == []
    one.close()


def test_claim_expires_after_five_minutes_by_the_database_clock(url: str, folders: tuple[Path, Path]) -> None:
    exchange = Exchange(folders[0], url, "line 1", {"SN-1": "li"})
    exchange.exchange()
    engine = create_engine(url)
    with engine.begin() as connection:
        row = connection.execute(select(claims.c.claimed, claims.c.expires)).one()
    engine.dispose()
    assert row.expires - row.claimed == timedelta(minutes=5)
    assert MAX_RETRY_S < 300.0
    exchange.close()


def test_earlier_run_of_a_unit_does_not_end_its_claim(url: str, folders: tuple[Path, Path]) -> None:
    write_result(folders[0], "a", 1)
    exchange = Exchange(folders[0], url, "line 1", {"SN-1": "li"})
    exchange.exchange()
    assert in_database(url) == [("a", "line 1")]
    assert serials(url) == ["SN-1"]
    exchange.close()


def test_exchange_service_on_the_same_folder_does_not_end_a_claim(url: str, folders: tuple[Path, Path]) -> None:
    window, service = Exchange(folders[0], url, "line 1", {"SN-1": "li"}), Exchange(folders[0], url, "line 1")
    window.exchange()
    service.exchange()
    service.close()
    assert serials(url) == ["SN-1"]
    window.close()
