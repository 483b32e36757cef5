"""Log sources: locations for workers, timestamps without a request per log, outages and passwords."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import fsspec
import pytest
from botocore.exceptions import EndpointConnectionError
from fsspec.implementations.memory import MemoryFileSystem
from fsspec.utils import infer_storage_options
from sqlalchemy import Engine, insert

from calstation.database import connect, log_copies, runs
from calstation.database.tables import outboxes
from calstation.errors import ConfigurationError, InputError
from calstation.fleet import FleetRequest, FleetSummary, resolve_fleet, task
from calstation.fleet.sources import StoredLog, find_logs
from calstation.fleet.store import SolveSettings
from tests.helpers import raises_code
from tests.s3 import bucket as bucket


@pytest.fixture
def engine(tmp_path: Path) -> Iterator[Engine]:
    """A new database."""
    made = connect(f"sqlite:///{tmp_path / 'shared.sqlite'}")
    yield made
    made.dispose()


def found(engine: Engine, *sources: object) -> list[StoredLog]:
    """Return the logs of sources."""
    return list(find_logs([str(source) for source in sources], engine))


def test_files_of_a_folder_have_size_and_timestamp(engine: Engine, tmp_path: Path) -> None:
    folder = tmp_path / "logs"
    (folder / "2026").mkdir(parents=True)
    for name, content in (("2026/b.h5", "bb"), ("a.csv", "a"), ("a.toml", "aaa"), ("c.csv", "without its TOML")):
        (folder / name).write_text(content)
    logs = found(engine, folder, folder / "a.csv", folder / "2026" / "b.h5")
    assert [(log.location, log.sizes) for log in logs] == [
        (str(folder / "2026" / "b.h5"), (2,)),
        (str(folder / "a.csv"), (1, 3)),
    ]
    assert found(engine, folder / "a.csv", folder / "2026") == logs[::-1]
    (folder / "a.toml").write_text("bbbb")
    assert [log.fingerprint == again.fingerprint for log, again in zip(logs, found(engine, folder), strict=True)] == [
        True,
        False,
    ]


class Hosted(MemoryFileSystem):
    """A file system whose paths omit the host, like FTP, SFTP and SMB; it refuses requests for single files."""

    protocol = "hosted"

    @classmethod
    def _strip_protocol(cls, path: str) -> str:
        return str(infer_storage_options(path)["path"])

    def exists(self, path: str, **more: Any) -> bool:
        return True

    def isdir(self, path: str) -> bool:
        return True

    def find(self, path: str, *arguments: Any, **more: Any) -> Any:
        return {f"{path.rstrip('/')}/2026/a.h5": {"size": 5, "mtime": 1.5}}

    def info(self, path: str, **more: Any) -> dict[str, Any]:
        raise AssertionError("a request for one file")


@pytest.mark.parametrize("source", ["hosted://store.plant.example/logs", "hosted://calibration@store:2222/share/logs"])
def test_log_location_contains_user_host_and_port(engine: Engine, source: str) -> None:
    fsspec.register_implementation("hosted", Hosted, clobber=True)
    for given in (source, f"{source}/"):
        assert found(engine, given) == [StoredLog(f"{source}/2026/a.h5", "5 1.5", (5,))]


@pytest.mark.parametrize(
    "source", ["sftp://calibration:geheim@store/logs", "https://store/logs?token=geheim", "smb://a:ge@heim@store/x"]
)
def test_source_with_a_password_is_refused_without_showing_the_password(
    engine: Engine, tmp_path: Path, source: str
) -> None:
    with raises_code(ConfigurationError, "fleet.password_in_source") as caught:
        found(engine, tmp_path / "first", source)
    assert "geheim" not in str(caught.value)


def test_outage_while_listing_a_source_is_reported(engine: Engine, monkeypatch: pytest.MonkeyPatch) -> None:
    def exists(self: object, path: str, **more: object) -> bool:
        raise EndpointConnectionError(endpoint_url="http://storage")

    monkeypatch.setattr(MemoryFileSystem, "exists", exists)
    with raises_code(InputError, "fleet.source_unreachable") as caught:
        found(engine, "memory://logs")
    assert 'Could not connect to the endpoint URL: "http://storage"' in str(caught.value)
    with raises_code(InputError, "fleet.source_unreachable"):
        found(engine, "unknown://logs")


def test_file_without_a_timestamp_has_no_fingerprint(engine: Engine, monkeypatch: pytest.MonkeyPatch) -> None:
    system = MemoryFileSystem()
    system.pipe_file("/unstamped/a.h5", b"abc")
    assert [log.fingerprint for log in found(engine, "memory://unstamped")] == [None]  # it has only its creation
    system.rm("/unstamped", recursive=True)


def test_archive_is_listed_from_the_database_without_file_requests(
    engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fsspec.core.url_to_fs", None)  # no request to a file system
    content = {"station": "bench 2", "product": "nav", "outcome": "passed"}
    run = {"serial": "A", "started_utc": "2026-03-05T00:00:00+00:00", "content": json.dumps(content), "revision": 1}
    run |= {"failed_checks": "[]", "parameters": "[]", "numbers": b""}
    copy = {"url": "s3://logs/x/a.h5", "file_sha256": "f" * 64, "size": 7}
    with engine.begin() as connection:
        connection.execute(insert(outboxes).values(id="x", station="bench 2", revision=1))
        connection.execute(insert(runs).values(outbox="x", name="a", stamp="", **run))
        connection.execute(insert(log_copies).values(outbox="x", name="a", **copy))
    (log,) = found(engine, "archive")
    origin = ("bench 2", "nav", "2026-03-05T00:00:00+00:00")
    assert log == StoredLog("s3://logs/x/a.h5", "f" * 64, (7,), "f" * 64, origin)


@pytest.mark.long
def test_logs_in_s3_are_solved_and_an_outage_affects_only_its_log(
    logs: list[Path], bucket: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import s3fs

    system = s3fs.S3FileSystem(skip_instance_cache=True)
    for log in logs[:2]:
        system.put_file(str(log), f"{bucket}/2026/{log.name}")
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    request = FleetRequest((bucket,), url, "local:2")

    def remove(summary: FleetSummary) -> None:
        if not summary.done:
            system.rm_file(f"{bucket}/2026/{logs[0].name}")  # after the bucket was listed

    first = resolve_fleet(request, remove)
    assert (first.solved_now, first.failed) == (1, 1)
    assert [failure.error["error_code"] for failure in first.failures] == ["fleet.unreachable"]
    assert first.failures[0].location == f"{bucket}/2026/{logs[0].name}"
    system.put_file(str(logs[0]), f"{bucket}/2026/{logs[0].name}")
    second = resolve_fleet(request)
    assert (second.solved_now, second.already_there, second.processed) == (1, 1, 1)
    alone = resolve_fleet(replace(request, sources=(f"{bucket}/2026/{logs[0].name}",)))
    assert (alone.already_there, alone.processed) == (1, 0)  # the same stamp as in the list of the folder
    monkeypatch.setattr(task, "RETRY_DELAYS", (0.0,))
    monkeypatch.setattr(task, "get_worker", lambda: type("Worker", (), {"local_directory": str(tmp_path)}))
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")  # nothing answers there
    s3fs.S3FileSystem.clear_instance_cache()
    (log,) = (StoredLog(location, None, (None,)) for location in [first.failures[0].location])
    status = task.solve_stored_log(task.Assignment(url, SolveSettings()), log)
    assert (status.outcome, status.error["error_code"]) == ("unreachable", "fleet.unreachable")
    assert "127.0.0.1:9" in status.error["error"]
    with raises_code(InputError, "fleet.source_unreachable"):
        resolve_fleet(request)
