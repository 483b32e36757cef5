"""Two stations that work on the same unit are both told; claims end with the run or by the database's clock."""

import multiprocessing
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from sqlalchemy import create_engine, select, update

from calstation.config import library
from calstation.database import Claim, Exchange, claim_scanned, release_scanned, upgrade
from calstation.database.tables import claims
from calstation.messages import event_text, sentence
from tests.database.result_files import write_result
from tests.helpers import ignore_progress


def station_file(folder: Path, url: str) -> Path:
    """A virtual station, named after its folder, that shares its records."""
    shipped = library.find("stations", "virtual_bench").read_text(encoding="utf-8")
    lines = [line for line in shipped.splitlines() if not line.startswith("name")]
    path = folder.parent / f"{folder.name}.toml"
    path.write_text("\n".join([f'name = "{folder.name}"', *lines, "[records]", f'database = "{url}"', ""]), "utf-8")
    return path


def scan(start: float, station: Path, folder: Path, serial: str) -> list[Claim]:
    """Claim a unit at a given time, in a process of its own."""
    import time

    time.sleep(max(0.0, start - time.time()))
    return claim_scanned(ignore_progress, station, folder, serial, "li")


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    """Runs folders of two stations."""
    made = tmp_path / "line 1", tmp_path / "line 2"
    for folder in made:
        folder.mkdir()
    return made


def test_two_stations_that_scan_a_unit_at_once_are_both_told(shared_database: str, folders: tuple[Path, Path]) -> None:
    stations = [station_file(folder, shared_database) for folder in folders]
    context = multiprocessing.get_context("spawn")
    told = {0: 0, 1: 0}
    with context.Pool(2) as pool:
        pool.starmap(scan, [(0.0, stations[k], folders[k], "SN-0") for k in (0, 1)], chunksize=1)  # imports are done
        for number in range(1, 11):
            start = datetime.now(UTC).timestamp() + 0.2
            work = [(start, stations[k], folders[k], f"SN-{number}") for k in (0, 1)]
            found = pool.starmap(scan, work, chunksize=1)
            assert any(found)  # at once: whoever scans last sees the other
            for k, there in enumerate(found):
                assert all((claim.serial, claim.operator) == (f"SN-{number}", "li") for claim in there)
                assert {claim.station for claim in there} <= {folders[1 - k].name}
                told[k] += len(there)
    assert sum(told.values()) >= 10
    for k in (0, 1):  # the exchange tells whoever scanned first
        exchange = Exchange(folders[k], shared_database, folders[k].name)
        there = exchange.exchange()
        exchange.close()
        assert {claim.serial for claim in there} == {f"SN-{number}" for number in range(11)}
        assert {claim.station for claim in there} == {folders[1 - k].name}
    utc = there[0].since
    assert abs(datetime.now(UTC) - utc) < timedelta(minutes=5)
    text = event_text(there[0].message.id, there[0].message.values)
    assert sentence(text) == f"SN-0 is also being calibrated at line 1 since {utc.astimezone():%H:%M}."
    assert sentence(text, "zh_CN") == f"SN-0 自 {utc.astimezone():%H:%M} 起也在 line 1 标定。"


@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
def test_a_claim_ends_by_release_arrival_or_time(
    kind: str, request: pytest.FixtureRequest, tmp_path: Path, folders: tuple[Path, Path]
) -> None:
    if kind == "sqlite":
        url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
        upgrade(url)
    else:
        url = request.getfixturevalue("shared_database")
    one, two = (station_file(folder, url) for folder in folders)

    def others() -> list[str]:
        return [claim.station for claim in claim_scanned(ignore_progress, two, folders[1], "SN-1", None)]

    def again() -> None:
        assert [c.station for c in claim_scanned(ignore_progress, one, folders[0], "SN-1", "li")] in ([], ["line 2"])
        assert others() == ["line 1"]

    assert others() == []
    again()
    release_scanned(ignore_progress, one, folders[0], "SN-1")
    assert others() == []
    again()
    write_result(folders[0], "a", 1)
    exchange = Exchange(folders[0], url, "line 1")
    exchange.exchange()
    assert others() == []
    again()
    engine = create_engine(url)
    past = datetime.now(UTC) - timedelta(seconds=1)
    with engine.begin() as connection:
        connection.execute(update(claims).where(claims.c.station == "line 1").values(expires=past))
    assert others() == []
    again()  # it is claimed again
    with engine.begin() as connection:
        rows = connection.execute(select(claims.c.claimed, claims.c.expires)).all()
    assert all(row.expires - row.claimed == timedelta(hours=2) for row in rows)
    engine.dispose()
    exchange.close()


def test_a_station_without_a_shared_database_claims_nothing(tmp_path: Path) -> None:
    assert claim_scanned(ignore_progress, None, tmp_path, "SN-1", None) == []
    release_scanned(ignore_progress, None, tmp_path, "SN-1")
    assert list(tmp_path.iterdir()) == []
