"""Every result is delivered to the factory folder once, complete and in order, even after a failure."""

import csv
import json
import os
import threading
from pathlib import Path
from typing import Any

import pytest

from calstation.config import StationConfig
from calstation.parsing import MAX_JSON
from calstation.results import HandOver, deliver_pending, handover, register_pending
from calstation.results.handover import COLUMNS, CSV_NAME, PENDING
from calstation.sequencer import Event, Message
from tests.site_folder import STATION

#: A check as a result holds it.
CHECKSUM_COLUMN = {"name": "gyro_bias_x within", "value": 2.0, "limit": [-1.0, 1.0], "unit": "rad/s"}


class Factory:
    """A folder of runs, a station file, and the folder for its results."""

    def __init__(self, folder: Path) -> None:
        self.runs = folder / "runs"
        self.runs.mkdir()
        self.events: list[Event] = []
        self.station = folder / "station.toml"
        self.folder = folder / "share"

    def config(self, own: bool = True) -> StationConfig:
        section = {"handover": {"folder": "share"}} if own else {}
        return StationConfig.model_validate({**STATION, "bench": {}, **section})

    def result(self, name: str, outcome: str = "passed", **more: Any) -> dict[str, Any]:
        """Write the result of a run."""
        result = {
            "schema": "calstation.result/1",
            "parameters": {},
            "started_utc": "2026-11-21T10:00:00+00:00",
            "unit": {"serial": name.partition("_")[0]},
            "outcome": outcome,
            "attempt": 2,
            "product": 'Grade "A", new',
            "station": "bench",
            "operator": None,
            "stages": ["rate", "six_position"],
            "duration_s": 12.34,
            "advice": None,
            "checks": [{**CHECKSUM_COLUMN, "passed": outcome == "passed"}],
            "registers": {"verified": True} if outcome == "passed" else None,
            "configuration_sha256": "c0",
            "log": {"sha256": "1f", "file": f"{name}.h5"},
            **more,
        }
        register_pending(self.runs, name)
        (self.runs / f"{name}.json").write_text(json.dumps(result), encoding="utf-8")
        return result

    def hand_over(self, own: bool = True) -> None:
        """Deliver a result as a run does at its end."""
        HandOver(self.runs, self.station, self.config(own), self.events.append).finish()

    def rows(self, folder: Path | None = None) -> list[dict[str, str]]:
        with ((folder or self.folder) / CSV_NAME).open(encoding="utf-8", newline="") as stream:
            return list(csv.DictReader(stream))


@pytest.fixture
def factory(tmp_path: Path) -> Factory:
    made = Factory(tmp_path)
    made.folder.mkdir()
    return made


def test_result_is_copied_and_one_line_added(factory: Factory) -> None:
    result = factory.result("SN-1_a")
    factory.hand_over()
    factory.result("SN-2_b", "fault", error="table: no\nanswer")
    factory.hand_over()
    assert json.loads((factory.folder / "SN-1_a.json").read_text("utf-8")) == result
    first, second = factory.rows()
    assert list(first) == [*COLUMNS, "result"]
    assert first["product"] == 'Grade "A", new'
    assert (first["serial"], first["stages"], first["duration_s"]) == ("SN-1", "rate six_position", "12.3")
    assert (first["operator"], first["registers_written"], first["failed_checks"]) == ("", "1", "")
    assert (second["outcome"], second["error"]) == ("fault", "table: no answer")
    assert (second["failed_checks"], second["result"]) == ("gyro_bias_x within", "SN-2_b.json")
    assert factory.events == []
    left = {path.name for path in factory.folder.iterdir()}
    assert left == {"SN-1_a.json", "SN-2_b.json", CSV_NAME, ".handover.lock"}


def test_line_states_whether_the_run_was_simulated(factory: Factory) -> None:
    factory.result("SN-1_a", simulated=True)
    factory.result("SN-2_b", simulated=False)
    factory.hand_over()
    assert [row["simulated"] for row in factory.rows()] == ["1", "0"]


def test_file_of_an_earlier_version_keeps_its_columns(factory: Factory) -> None:
    names = [name for name in COLUMNS if name != "simulated"]
    (factory.folder / CSV_NAME).write_text(",".join([*names, "result"]) + "\n", "utf-8")
    factory.result("SN-1_a", simulated=True)
    factory.hand_over()
    (row,) = factory.rows()
    assert list(row) == [*names, "result"]
    assert (row["serial"], row["log"], row["result"]) == ("SN-1", "SN-1_a.h5", "SN-1_a.json")


def test_incomplete_run_is_delivered_with_its_stages_and_the_reason_of_its_end(factory: Factory) -> None:
    factory.result("SN-1_a", "incomplete", stages=[], finished_stages=["rate"])
    factory.result("SN-2_b", "stopped", stages=["rate"], stop_reason="listener_lost")
    factory.hand_over()
    dead, stopped = factory.rows()
    assert (dead["stages"], dead["error"]) == ("rate", "")
    assert (stopped["stages"], stopped["error"]) == ("rate", "listener_lost")


def test_every_documented_column_exists() -> None:
    text = (Path(__file__).parents[2] / "docs" / "how-to" / "hand-over.md").read_text("utf-8")
    for column in [*COLUMNS, "result"]:
        assert f"`{column}`" in text


def test_default_delivery_folder_is_next_to_the_runs_folder(factory: Factory) -> None:
    factory.result("SN-1_a")
    factory.hand_over(own=False)
    assert len(factory.rows(factory.runs.parent / "handover")) == 1


def test_unreachable_folder_is_reported_and_results_delivered_later(factory: Factory) -> None:
    factory.folder.rmdir()
    for name in ("SN-1_a", "SN-2_b"):
        factory.result(name)
        factory.hand_over()
    assert not factory.folder.exists()
    messages = [event for event in factory.events if isinstance(event, Message)]
    assert [(m.id, m.values["count"]) for m in messages] == [("handover_waiting", 1), ("handover_waiting", 2)]
    assert messages[0].values["reason"].code == "os.not_found"
    factory.folder.mkdir()
    factory.result("SN-3_c")
    factory.hand_over()
    assert [row["serial"] for row in factory.rows()] == ["SN-1", "SN-2", "SN-3"]
    assert factory.events[-1] == Message("handover_done", {"folder": str(factory.folder), "count": 3})
    factory.hand_over()
    assert len(factory.rows()) == 3


def test_window_delivers_pending_results(factory: Factory) -> None:
    import tomli_w

    station = {**STATION, "bench": {}, "handover": {"folder": "share"}}
    factory.station.write_text(tomli_w.dumps(station), encoding="utf-8")
    factory.result("SN-1_a")
    delivery = deliver_pending(lambda *_: None, factory.runs, factory.station)
    assert (delivery.done, delivery.waiting, delivery.folder) == (1, 0, factory.folder)


def test_an_unresponsive_folder_does_not_delay_a_run(factory: Factory, monkeypatch: pytest.MonkeyPatch) -> None:
    go = threading.Event()
    monkeypatch.setattr(handover, "_WAIT_TIME", 0.2)
    monkeypatch.setattr(handover, "write_atomic", lambda *_: go.wait(60.0))
    factory.result("SN-1_a")
    factory.hand_over()
    go.set()
    (message,) = factory.events
    assert isinstance(message, Message)
    assert (message.id, message.values["count"]) == ("handover_waiting", 1)
    assert message.values["reason"].code == "handover.no_answer"


def test_failed_delivery_does_not_block_other_results(factory: Factory) -> None:
    factory.result("SN-1_a")
    factory.result("SN-2_b")
    (factory.folder / "SN-1_a.json").mkdir()
    factory.hand_over()
    assert [row["serial"] for row in factory.rows()] == ["SN-2"]
    assert [path.name for path in (factory.runs / PENDING).glob("S*")] == ["SN-1_a"]


def test_line_written_just_before_a_power_cut_is_not_repeated(factory: Factory) -> None:
    factory.result("SN-1_a")
    factory.hand_over()
    register_pending(factory.runs, "SN-1_a")
    factory.hand_over()
    assert len(factory.rows()) == 1


def test_truncated_line_does_not_damage_the_next_line(factory: Factory) -> None:
    factory.result("SN-1_a")
    factory.hand_over()
    with (factory.folder / CSV_NAME).open("ab") as stream:
        stream.write(b"2026-11-21T10:00:00+00:00,SN-9,pas")
    factory.result("SN-2_b")
    factory.hand_over()
    assert [row["serial"] for row in factory.rows()] == ["SN-1", "SN-9", "SN-2"]


def test_run_in_progress_stays_pending_and_a_deleted_run_is_dropped(factory: Factory) -> None:
    (factory.runs / "SN-1_a.h5").touch()
    for name in ("SN-1_a", "SN-2_gone"):
        register_pending(factory.runs, name)
    factory.hand_over()
    assert [path.name for path in (factory.runs / PENDING).glob("S*")] == ["SN-1_a"]
    assert factory.events == []


def test_result_delivered_meanwhile_by_another_program_is_skipped(
    factory: Factory, monkeypatch: pytest.MonkeyPatch
) -> None:
    factory.result("SN-1_a")
    (factory.runs / PENDING / "SN-1_a").unlink()
    monkeypatch.setattr(Path, "glob", lambda folder, pattern: [folder / "SN-1_a"])
    factory.hand_over()
    assert factory.events == []


def test_lines_of_two_programs_do_not_interleave(factory: Factory) -> None:
    """Two stations with separate runs deliver to one folder."""
    folder = factory.runs.parent / "other"
    folder.mkdir()
    other = Factory(folder)
    other.folder = factory.folder
    config = StationConfig.model_validate({**STATION, "bench": {}, "handover": {"folder": str(factory.folder)}})
    for i in range(20):
        factory.result(f"SN-{i}_a")
        other.result(f"SN-{i}_b")
    sides = [HandOver(side.runs, side.station, config, side.events.append) for side in (factory, other)]
    for side in sides:
        side.start()
    for side in sides:
        side.finish()
    rows = factory.rows()
    assert sorted(row["result"] for row in rows) == sorted(f"SN-{i}_{s}.json" for i in range(20) for s in "ab")
    assert all(row["outcome"] == "passed" for row in rows)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission_is_reported(factory: Factory) -> None:
    factory.folder.chmod(0o500)
    factory.result("SN-1_a")
    factory.hand_over()
    factory.folder.chmod(0o700)
    (message,) = factory.events
    assert isinstance(message, Message)
    assert message.values["reason"].code == "os.no_permission"


@pytest.mark.parametrize("content", ["[]", "{}", '{"unit": []}', "[" * 100_000])
def test_file_that_is_no_result_does_not_block_other_results(factory: Factory, content: str) -> None:
    register_pending(factory.runs, "a")
    (factory.runs / "a.json").write_text(content, encoding="utf-8")
    factory.result("SN-1_b")
    factory.hand_over()
    assert [row["serial"] for row in factory.rows()] == ["SN-1"]


def test_a_result_that_is_too_large_to_be_read_is_copied_whole(factory: Factory) -> None:
    factory.result("SN-1_a", advice="x" * MAX_JSON)
    factory.hand_over()
    copy, original = factory.folder / "SN-1_a.json", factory.runs / "SN-1_a.json"
    assert copy.stat().st_size == original.stat().st_size


def test_a_result_whose_name_begins_with_a_hyphen_is_named_exactly_and_once(factory: Factory) -> None:
    for _ in range(2):  # as after an interrupted delivery
        factory.result("--1_a", operator="=1+1")
        factory.hand_over()
    (row,) = factory.rows()
    assert (row["result"], row["operator"]) == ("--1_a.json", "'=1+1")
