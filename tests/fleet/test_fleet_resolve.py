"""Many logs are solved once each, with the results of `calstation resolve`; a failure affects only its log."""

import json
import math
import os
import shutil
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from datetime import date
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import dask
import pytest
from distributed.core import Status
from sqlalchemy import create_engine, func, select

from calstation import __version__
from calstation.database import connect, solutions
from calstation.errors import ConfigurationError, InputError
from calstation.fleet import FleetRequest, FleetSummary, Selection, cluster, resolve_fleet, solved_results
from calstation.fleet.sources import StoredLog
from calstation.fleet.store import SolveSettings
from calstation.fleet.task import Assignment
from calstation.records import export_csv, open_log, resolve_file, write_log
from calstation.results import resolve
from tests.cli.conftest import Done
from tests.helpers import raises_code

Run = Callable[..., Done]


def request_of(logs: Path | list[Path], url: str, workers: int = 1, **more: object) -> FleetRequest:
    """Return a request for local workers, each of which takes seconds of processor time to start."""
    sources = [logs] if isinstance(logs, Path) else logs
    return FleetRequest(tuple(map(str, sources)), url, f"local:{workers}", **more)


def counts(summary: FleetSummary) -> tuple[int, int, int]:
    """Return the numbers of logs solved now, solved before and failed."""
    return summary.solved_now, summary.already_there, summary.failed


def rows(url: str) -> int:
    """Return the number of solutions in the database."""
    engine = create_engine(url)
    with engine.connect() as connection:
        number = connection.execute(select(func.count()).select_from(solutions)).scalar_one()
    engine.dispose()
    return int(number)


@pytest.mark.long
def test_solutions_equal_the_resolve_command_and_are_computed_once(logs: list[Path], url: str, tmp_path: Path) -> None:
    seen: list[int] = []
    summary = resolve_fleet(request_of(logs[0].parent, url), lambda state: seen.append(state.done))
    assert counts(summary) == (6, 0, 0)
    assert sorted(set(seen)) == list(range(7))
    assert not summary.stopped
    assert not resolve_file(logs[0].parent).path.exists()
    found = {result["log"]["file"]: result for result in map(json.loads, solved_results(url, summary))}
    for log in logs:
        assert found[str(log)] == resolve(log).result.to_json()
    again = resolve_fleet(request_of(logs, url))
    assert counts(again) == (0, 6, 0)
    assert again.processed == 0  # by the fingerprint, without a worker
    moved = Path(shutil.copy(logs[0], tmp_path / "moved.h5"))
    other = resolve_fleet(request_of([moved], url))
    assert (counts(other), other.processed) == ((0, 1, 0), 1)  # by the digest of the log
    os.utime(shutil.copy(moved, logs[0].with_name("new")), ns=2 * (moved.stat().st_mtime_ns,))
    logs[0].with_name("new").replace(moved)  # as if the folder was mounted again: another file number
    other = resolve_fleet(request_of([moved, *logs], url))
    assert (counts(other), other.processed) == ((0, 7, 0), 0)
    assert other.copies == {str(logs[0]): str(moved)}
    assert len(list(solved_results(url, other))) == 6
    assert rows(url) == 6
    assert counts(resolve_fleet(request_of(logs[:1], url, label="part", stages=("designed",)))) == (1, 0, 0)
    assert rows(url) == 7


@pytest.mark.long
def test_one_command_solves_selected_logs_and_lists_changed_verdicts(
    logs: list[Path], tmp_path: Path, calstation: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))
    monkeypatch.setattr("calstation.cli.commands.fleet._LINE_INTERVAL", 0.0)
    wrong = logs[4]  # the only one of bench 2 since March
    log = open_log(wrong)
    copy, computed = tmp_path / "logs" / "copy.h5", tmp_path / "logs" / "computed.h5"
    shutil.copy(wrong, copy)
    site = log.meta.site.model_copy(update={"gravity_mps2": None})
    write_log(computed, log.meta.model_copy(update={"site": site}), log.blocks())
    patch = tmp_path / "gravity.toml"
    patch.write_text("[scale.site]\ngravity_mps2 = 0.99998\n")
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    selection = ("--station", "bench 2", "--since", "2026-03-01")
    command = ("fleet", "resolve", tmp_path / "logs", "--database", url, "--scheduler", "local:2", "--patch", patch)
    done = calstation(*command, *selection, "--compare-with", "unchanged", "--json", "-")
    assert done.code == 0
    counted = ("solved_now", "already_there", "failed", "not_selected", "unchanged")
    assert [done.json[name] for name in counted] == [2, 1, 0, 5, 1]
    assert done.json["copies"] in ({str(wrong): str(copy)}, {str(copy): str(wrong)})
    assert [result["unit"]["serial"] for result in done.json["results"]] == ["SN-00005", "SN-00005"]
    compared = done.json["comparison"]
    assert (compared["before"], compared["after"]) == (__version__, f"{__version__}+gravity")
    assert (compared["logs"], compared["only_before"], compared["only_after"]) == (2, 0, 0)
    sigma = resolve(wrong).result.parameters["accel_scale_x"].sigma
    assert compared["moves"]["accel_scale_x"]["largest"] == pytest.approx(20e-6 / sigma, rel=0.01)
    assert "5 not selected" in done.err
    assert "1 copy of other logs" in done.err
    assert "1 log not affected by the changes" in done.err
    assert "logs left" in done.err
    assert rows(url) == 4
    shown = calstation(*command, *selection, "--compare-with", "unchanged")
    assert "logs in both" in shown.out
    assert "0 solved, 3 already there, 0 failed, 5 not selected" in " ".join(shown.err.split())
    assert "accel_scale_x" in shown.out
    request = FleetRequest((str(tmp_path / "logs"),), url, "local:2", patch, selection=Selection("bench 2"))
    again = resolve_fleet(replace(request, selection=Selection("bench 2", since=date(2026, 3, 1))))
    assert (counts(again), again.not_selected, again.processed) == ((0, 3, 0), 5, 0)
    wider = resolve_fleet(request)  # of another selection, but the same changes
    assert (counts(wider), wider.not_selected) == ((1, 3, 0), 4)


@pytest.mark.parametrize(
    ("options", "code", "expected"),
    [
        (("--compare-with", "unchanged"), 2, "would be compared with itself"),
        (("--compare-with", __version__), 2, "would be compared with itself"),
        (("--label", "x", "--compare-with", "0.0.1"), 2, "No such database"),
        (("--since", "March"), 2, "--since"),
    ],
)
def test_impossible_comparison_is_refused_before_solving(
    logs: list[Path], tmp_path: Path, calstation: Run, options: tuple[str, ...], code: int, expected: str
) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    done = calstation("fleet", "resolve", *logs, "--database", url, *options)
    assert (done.code, done.out) == (code, "")
    assert expected in done.err
    assert not (tmp_path / "shared.sqlite").exists()


def test_error_for_an_unknown_baseline_lists_the_existing_versions(logs: list[Path], tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    connect(url).dispose()
    with raises_code(ConfigurationError, "fleet.no_version"):
        request_of(logs, url, label="x").baseline("0.0.1")


@pytest.mark.long
def test_selection_without_logs_is_reported(logs: list[Path], tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    for _ in range(2):  # by the workers, then by what the database knows
        with raises_code(ConfigurationError, "fleet.none_selected"):
            resolve_fleet(request_of(logs, url, selection=Selection("bnech 2")))
    assert rows(url) == 0


def test_parameters_only_solutions_are_a_separate_version(logs: list[Path], tmp_path: Path, calstation: Run) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    command = ("fleet", "resolve", logs[0], "--database", url, "--scheduler", "local:1")
    done = calstation(*command, "--parameters-only", "--json", "-")
    assert done.code == 0
    assert done.json["version"] == f"{__version__}+parameters"
    assert done.json["results"] == [resolve(logs[0], diagnostics=False).result.to_json()]
    assert "Parameters only: not judged, since data and model were not tested." in " ".join(done.err.split())
    (tmp_path / "gravity.toml").write_text("[site]\ngravity_sigma_mps2 = 1e-4\n")
    patch = ("--patch", tmp_path / "gravity.toml")
    done = calstation(*command, "--parameters-only", *patch, "--json", "-")
    assert done.json["version"] == f"{__version__}+gravity-parameters"
    with raises_code(ConfigurationError, "fleet.label_used"):
        resolve_fleet(request_of(logs[0], url, label="parameters"))
    with raises_code(ConfigurationError, "fleet.label_needed"):
        resolve_fleet(request_of(logs[0], url, diagnostics=False, stages=("designed",)))


def test_damaged_logs_are_recorded_as_failed_and_the_rest_is_solved(
    logs: list[Path], tmp_path: Path, calstation: Run
) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    logs[0].write_bytes(logs[0].read_bytes()[:20_000])
    logs[1].write_bytes(b"no log at all")
    stored = bytearray(logs[2].read_bytes())
    begin = stored.index(json.dumps({"serial": "SN-00003"})[1:-1].replace(" ", "").encode())
    stored[begin : begin + 4] = b"XXXX"
    logs[2].write_bytes(stored)
    summary = resolve_fleet(request_of(logs[0].parent, url))
    assert counts(summary) == (3, 0, 3)
    found = {Path(result["log"]["file"]).name: result for result in map(json.loads, solved_results(url, summary))}
    for log in logs[:3]:
        result = found[log.name]
        assert result["outcome"] == "failed"
        with pytest.raises(InputError) as caught:
            resolve(log)
        assert result["error_code"] == caught.value.code
        assert result["error"] == str(caught.value)
    assert {found[log.name]["outcome"] for log in logs[3:]} == {"resolved"}
    again = resolve_fleet(request_of(logs[0].parent, url))
    assert counts(again) == (0, 3, 3)
    assert again.processed == 0
    assert sorted(each.error["error"] for each in again.failures) == sorted(
        each.error["error"] for each in summary.failures
    )
    shown = calstation("fleet", "resolve", logs[1], "--database", url, "--scheduler", "local:1")
    assert shown.code == 1
    assert "".join(shown.err.split()).count(str(logs[1])) == 1  # long lines are wrapped


@pytest.mark.long
def test_log_that_kills_its_workers_fails_and_is_retried(logs: list[Path], tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    with dask.config.set({"distributed.worker.preload": [str(Path(__file__).with_name("dies_for_one_unit.py"))]}):
        summary = resolve_fleet(request_of(logs, url, 2))
    assert counts(summary) == (5, 0, 1)
    assert [(Path(each.location), each.error["error_code"]) for each in summary.failures] == [
        (logs[1], "fleet.worker_died")
    ]
    assert rows(url) == 5
    assert counts(resolve_fleet(request_of(logs, url))) == (1, 5, 0)


@pytest.mark.long
def test_unreachable_log_is_retried(logs: list[Path], tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    missing = tmp_path / "away.h5"
    stop = threading.Event()

    def remove(summary: FleetSummary) -> None:
        if not summary.done:
            logs[0].rename(missing)  # after the folder was listed

    first = resolve_fleet(request_of(logs[:2], url), remove, stop)
    assert counts(first) == (1, 0, 1)
    assert [failure.error["error_code"] for failure in first.failures] == ["fleet.unreachable"]
    assert Counter(json.loads(text)["outcome"] for text in solved_results(url, first)) == {"resolved": 1, "failed": 1}
    missing.rename(logs[0])
    assert counts(resolve_fleet(request_of(logs[:2], url))) == (1, 1, 0)


@pytest.mark.long
def test_changes_give_the_solution_of_the_changed_configuration(
    logs: list[Path], url: str, tmp_path: Path, calstation: Run
) -> None:
    resolve_fleet(request_of(logs[:1], url))
    patch = tmp_path / "gravity.toml"
    gravity = open_log(logs[0]).meta.site.gravity_mps2
    assert gravity is not None
    patch.write_text(f"[site]\ngravity_mps2 = {gravity * (1 - 20e-6)}\n")
    done = calstation(
        "fleet", "resolve", logs[0], "--database", url, "--scheduler", "local:1", "--patch", patch, "--json", "-"
    )
    assert done.code == 0
    assert (done.json["solved_now"], done.json["already_there"], done.json["failed"]) == (1, 0, 0)
    assert done.json["duration_s"] > 0.0
    assert "1 solved" in done.err
    result = done.json["results"][0]
    before = resolve(logs[0]).result
    assert result["outcome"] == "resolved"
    assert result["configuration_sha256"] != before.configuration_sha256
    assert result["log"]["sha256"] == before.log.sha256
    log = open_log(logs[0])
    site = log.meta.site.model_copy(update={"gravity_mps2": gravity * (1 - 20e-6)})
    changed = tmp_path / "changed.h5"
    write_log(changed, log.meta.model_copy(update={"site": site}), log.blocks())
    assert result["parameters"] == resolve(changed).result.to_json()["parameters"]
    patch.write_text("[site]\ngravity_mps2 = 9.8\n")
    with raises_code(ConfigurationError, "fleet.label_used"):
        resolve_fleet(request_of(logs[:1], url, patch=patch))


@pytest.mark.long
def test_csv_log_is_solved_with_its_configuration(logs: list[Path], tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    folder = tmp_path / "text"
    folder.mkdir()
    export_csv(logs[0], folder / "a.csv.gz")
    (folder / "list.csv").write_text("no log\n")
    summary = resolve_fleet(request_of(folder, url))
    assert counts(summary) == (1, 0, 0)
    assert json.loads(next(solved_results(url, summary))) == resolve(folder / "a.csv.gz").result.to_json()


def test_stop_request_is_handled_before_solving(logs: list[Path], tmp_path: Path) -> None:
    stop = threading.Event()
    stop.set()
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    states: list[FleetSummary] = []
    summary = resolve_fleet(request_of(logs, url), states.append, stop)
    assert summary.stopped
    assert (summary.total, len(states)) == (0, 1)

    def stop_listed(state: FleetSummary) -> None:
        assert not state.done
        later.set()

    later = threading.Event()
    summary = resolve_fleet(request_of(logs, url), stop_listed, later)
    assert summary.stopped
    assert (summary.total, summary.done, rows(url)) == (6, 0, 0)


def test_lost_scheduler_and_failed_workers_are_reported(logs: list[Path], monkeypatch: pytest.MonkeyPatch) -> None:
    nannies = {name: SimpleNamespace(name=name, status=Status.failed, is_alive=lambda: False) for name in range(2)}
    scaled: list[int] = []

    def scale(count: int) -> None:
        scaled.append(count)
        local.workers, local.worker_spec = dict(nannies), dict(nannies)

    created = list(nannies.values())
    local = SimpleNamespace(workers=dict(nannies), worker_spec=dict(nannies), _created=created, scale=scale)
    future = SimpleNamespace(key="a", status="pending", add_done_callback=lambda put: None)
    client: Any = SimpleNamespace(cluster=local, submit=lambda *arguments, **more: future)
    stored = [StoredLog(str(logs[0]), "", (None,))]
    assignment = Assignment("", SolveSettings())
    monkeypatch.setattr(cluster, "_MAX_SILENCE", 0.0)
    with raises_code(ConfigurationError, "fleet.workers_end"):
        list(cluster.solve_logs(client, assignment, stored, threading.Event(), "local:2"))
    assert scaled == [2, 2, 2]
    for nanny in created:
        nanny.is_alive = lambda: True
    local.workers = {}  # as long as they are starting
    assert cluster._replace_workers(local, 0, dict.fromkeys(nannies, -math.inf), 0.0) == 0
    future.status, future.add_done_callback = "cancelled", lambda put: put(future)
    with raises_code(ConfigurationError, "fleet.scheduler_lost"):
        list(cluster.solve_logs(client, assignment, stored, threading.Event(), "tcp://a:1"))
    future.status, future.exception = "error", lambda: ModuleNotFoundError("calstation")
    with raises_code(ConfigurationError, "fleet.task_failed"):
        list(cluster.solve_logs(client, assignment, stored, threading.Event(), "tcp://a:1"))


@pytest.mark.long
def test_a_cluster_closes_workers_that_it_has_lost() -> None:
    with cluster.started_cluster("local:1", 1) as client:
        client.wait_for_workers(1)
        while not client.cluster.workers:
            time.sleep(0.05)  # the cluster notes a worker after it has joined
        (nanny,) = client.cluster.workers.values()
        client.cluster.workers.clear()
        client.cluster.worker_spec.clear()
    assert nanny.status == Status.closed


def test_an_empty_archive_is_refused(tmp_path: Path, calstation: Run) -> None:
    done = calstation("fleet", "resolve", "archive", "--database", f"sqlite:///{tmp_path / 'shared.sqlite'}")
    assert (done.code, done.out) == (2, "")
    assert "The archive of the database contains no logs. Give logs or folders" in done.err


def test_unusable_sources_are_refused_immediately(
    logs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("calstation.fleet.cluster._CONNECT_TIMEOUT", "1s")
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    empty = tmp_path / "empty"
    empty.mkdir()
    for source, code in ((tmp_path / "none", "fleet.source_missing"), (empty, "fleet.no_logs")):
        with raises_code(InputError, code):
            resolve_fleet(request_of(source, url))
    with raises_code(ConfigurationError, "fleet.scheduler"):
        resolve_fleet(FleetRequest((str(logs[0]),), url, "local:0"))
    with raises_code(ConfigurationError, "fleet.no_scheduler"):
        resolve_fleet(FleetRequest((str(logs[0]),), url, "tcp://127.0.0.1:1"))
    for part in ({"first_seq": 5}, {"last_seq": 5}, {"stages": ("designed",)}):
        with raises_code(ConfigurationError, "fleet.label_needed"):
            resolve_fleet(request_of(logs[:1], url, **part))
    with raises_code(ConfigurationError, "solution.range_reversed"):
        resolve_fleet(request_of(logs[:1], url, first_seq=5, last_seq=4))


def test_the_scheduler_of_local_workers_refuses_other_programs() -> None:
    with cluster.started_cluster("local:1", 1) as client:
        address = client.scheduler_info()["address"]
        assert address.startswith("tls://127.0.0.1:")
        for other in (address, address.replace("tls://", "tcp://")):
            with pytest.raises((OSError, ValueError, TypeError)):
                cluster.Client(other, timeout="3s")
