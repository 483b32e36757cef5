"""The engine process: commands, termination, and loss of its listener."""

import csv
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from queue import Queue
from types import SimpleNamespace
from typing import Any, cast

import pytest

from calstation.connection.port_lock import ENGINE
from calstation.errors import DeviceFaultError
from calstation.messages import render
from calstation.records import open_log
from calstation.results.handover import CSV_NAME
from calstation.runs import Engine, finish_incomplete
from calstation.sequencer import (
    Command,
    Event,
    Fault,
    Finalized,
    Message,
    StageSolved,
    StageStarted,
    StateChanged,
    StepStarted,
    from_json,
    to_json,
)
from tests.helpers import raises_code
from tests.site_folder import SiteFolder

#: The solution of a stage.
SOLVED = StageSolved("rate", {}, {"passed": True})


def test_engine_sends_events_and_accepts_commands(site_folder: SiteFolder) -> None:
    with Engine.start(site_folder.request("rate")) as engine:
        assert engine.process.name == ENGINE, "a port in use names it"
        for event in engine.events():
            if isinstance(event, StepStarted) and event.stage:
                engine.send(Command.STOP)
    assert isinstance(event, Finalized)
    assert event.verdict == "stopped"
    assert engine.process.exitcode == 0


@pytest.mark.long
def test_stopped_engine_does_not_wait_for_the_kernels_of_a_new_computer(
    site_folder: SiteFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kernels"))
    spawn = multiprocessing.context.SpawnContext()  # a new process, which has loaded no kernels
    monkeypatch.setattr("multiprocessing.get_context", lambda method: spawn)
    with Engine.start(site_folder.request("rate")) as engine:
        for event in engine.events():
            if isinstance(event, Message) and event.id == "preparing_solver":
                engine.send(Command.STOP)
                stopped = time.monotonic()
    assert time.monotonic() - stopped < 10.0
    assert isinstance(event, Finalized)
    assert event.verdict == "stopped"


@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL exists only on POSIX systems")
def test_killed_engine_leaves_a_readable_log_that_is_listed(site_folder: SiteFolder) -> None:
    def kill_in_the_middle(engine: Engine) -> None:
        for event in engine.events():
            if isinstance(event, StepStarted) and event.step == 7:
                assert engine.process.pid is not None
                os.kill(engine.process.pid, signal.SIGKILL)

    with (
        Engine.start(site_folder.request("rate")) as engine,
        raises_code(DeviceFaultError, "run.engine_ended"),
    ):
        kill_in_the_middle(engine)
    (path,) = (site_folder.folder / "runs").glob("*.h5")
    log = open_log(path)
    assert log.outcome is None
    samples = sum(len(block) for block in log.blocks())
    assert samples > 200

    assert finish_incomplete(path.parent) == [path]
    result = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    assert (result["outcome"], result["passed"]) == ("incomplete", False)
    assert finish_incomplete(path.parent) == []


def polled(engine: Engine, until: Callable[[list[Event]], bool]) -> list[Event]:
    """Return the events that a window polls until `enough`."""
    events: list[Event] = []
    deadline = time.monotonic() + 200.0
    while not until(events):
        assert time.monotonic() < deadline, events[-3:]
        events += engine.poll()
        time.sleep(0.02)
    return events


def moving(events: list[Event]) -> bool:
    """Return whether the stage has started."""
    return any(isinstance(event, StepStarted) and event.step == 7 for event in events)


def test_window_polls_a_run_to_its_end(site_folder: SiteFolder) -> None:
    with Engine.start(site_folder.request("rate")) as engine:
        assert engine.alive
        events = polled(engine, lambda events: engine.ended)
        assert [event.verdict for event in events if isinstance(event, Finalized)] == ["partial"]
        assert not [event for event in events if isinstance(event, Fault)]
        assert engine.poll() == []
    assert not engine.alive


@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL exists only on POSIX systems")
def test_poll_returns_although_messages_arrive_faster_than_they_are_read(
    site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Engine.start(site_folder.request("rate")) as engine:
        event = next(engine.events())
        with monkeypatch.context() as patched:
            patched.setattr(engine._child, "take", lambda wait: to_json(event))
            assert all(each == event for each in engine.poll())


def test_engine_that_compiles_the_solver_may_be_silent_for_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    """A new computer compiles for two minutes, which delays the other threads by seconds; the table is at rest."""
    now, arriving = 0.0, Queue[Any]()
    monkeypatch.setattr("calstation.runs.engine.time.monotonic", lambda: now)
    child = SimpleNamespace(process=None, take=lambda _: arriving.get_nowait())
    engine = Engine(cast(Any, child))

    def silence_after(event: Event) -> float:
        """Return the silence after an event until the fault, s."""
        nonlocal now
        arriving.put(to_json(event))
        assert engine.poll() == [event]
        begin = now
        while not engine.poll():
            now += 0.1
        return now - begin

    assert silence_after(Message("checking_mounting")) < 3.0
    assert 25.0 < silence_after(Message("preparing_solver")) < 35.0
    assert silence_after(StateChanged("running", "preparing")) < 3.0


@pytest.mark.parametrize(
    ("event", "english", "chinese"),
    [
        (StageStarted("rate", 0, 2, 60.0), "then start again.", "然后重新开始。"),
        (SOLVED, "then resume the run after its last completed stage, or start again.", "之后接着做，或重新开始。"),
    ],
    ids=["no stage", "stage"],
)
def test_dead_engine_offers_to_resume_only_after_a_completed_stage(
    site_folder: SiteFolder, event: Event, english: str, chinese: str
) -> None:
    messages = iter([to_json(event)])

    def take(_: float) -> str:
        try:
            return next(messages)
        except StopIteration:
            raise EOFError from None

    process = SimpleNamespace(join=lambda _: None, exitcode=-9)
    request = site_folder.request("rate")
    fault = Engine(cast(Any, SimpleNamespace(process=process, take=take)), request).poll()[-1]
    assert isinstance(fault, Fault)
    fault = from_json(to_json(fault))
    assert isinstance(fault, Fault)
    assert render(fault.code, fault.values, window=True).remedy.endswith(english)
    assert render(fault.code, fault.values, "zh_CN", window=True).remedy.endswith(chinese)


def test_terminated_engine_gives_a_polling_window_one_fault(site_folder: SiteFolder) -> None:
    with Engine.start(site_folder.request("rate")) as engine:
        polled(engine, moving)
        assert engine.process.pid is not None
        os.kill(engine.process.pid, signal.SIGKILL)
        (fault,) = [e for e in polled(engine, lambda events: engine.ended) if isinstance(e, Fault)]
        assert (fault.kind, fault.exit_code) == ("DeviceFaultError", 3)
        assert fault.code == "run.engine_ended"
        assert engine.poll() == []


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="SIGSTOP exists only on POSIX systems")
def test_frozen_engine_is_a_fault_and_may_send_events_later(site_folder: SiteFolder) -> None:
    """Meanwhile the watchdog has stopped the table, which the engine then reports."""
    site_folder.write(watchdog_ms=1000)
    with Engine.start(site_folder.request("rate")) as engine:
        polled(engine, moving)
        assert engine.process.pid is not None
        os.kill(engine.process.pid, signal.SIGSTOP)
        events = polled(engine, lambda events: any(isinstance(e, Fault) for e in events))
        assert events[-1].code == "run.engine_silent"  # type: ignore[union-attr]
        os.kill(engine.process.pid, signal.SIGCONT)
        rest = polled(engine, lambda events: engine.ended)
        assert "table.latched_watchdog" in [event.code for event in rest if isinstance(event, Fault)]
        assert isinstance(rest[-1], Finalized)


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="SIGSTOP exists only on POSIX systems")
def test_frozen_engine_is_terminated_when_its_window_closes(site_folder: SiteFolder) -> None:
    engine = Engine.start(site_folder.request("rate"))
    polled(engine, moving)
    assert engine.process.pid is not None
    os.kill(engine.process.pid, signal.SIGSTOP)
    polled(engine, lambda events: any(isinstance(e, Fault) for e in events))
    engine.stop_listening()
    engine.process.join(30.0)
    assert not engine.alive


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
@pytest.mark.parametrize("sent", ["SIGTERM", "SIGHUP"])
def test_engine_makes_a_safe_stop_on_a_signal(site_folder: SiteFolder, sent: str) -> None:
    events = []
    with Engine.start(site_folder.request("rate")) as engine:
        for event in engine.events():
            events.append(event)
            if isinstance(event, StepStarted) and event.step == 7:
                assert engine.process.pid is not None
                os.kill(engine.process.pid, getattr(signal, sent))
                if sent == "SIGHUP":
                    engine.send(Command.STOP)
    assert [event.verdict for event in events if isinstance(event, Finalized)] == ["stopped"]
    assert engine.process.exitcode == 0


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL exists only on POSIX systems")
@pytest.mark.parametrize(("fate", "reason"), [("SIGKILL", "listener_lost"), ("SIGSTOP", "listener_silent")])
def test_terminated_or_frozen_listener_causes_a_safe_stop(site_folder: SiteFolder, fate: str, reason: str) -> None:
    script = (
        "from pathlib import Path\n"
        "from calstation.runs.engine import Engine\n"
        "from calstation.config.request import RunRequest\n"
        "if __name__ == '__main__':\n"
        f"    station, product = Path({str(site_folder.station)!r}), Path({str(site_folder.product)!r})\n"
        "    request = RunRequest('SN-000042', station, product,\n"
        f"        ('rate',), Path({str(site_folder.folder / 'runs')!r}), speed=4.0)\n"
        "    for event in Engine.start(request).events():\n"
        "        print(type(event).__name__, flush=True)\n"
    )
    file = site_folder.folder / "listener.py"
    file.write_text(script, encoding="utf-8")
    listener = subprocess.Popen([sys.executable, str(file)], stdout=subprocess.PIPE, text=True)
    assert listener.stdout is not None
    for line in listener.stdout:
        if line.strip() == StageStarted.__name__:
            break
    os.kill(listener.pid, getattr(signal, fate))
    deadline = time.monotonic() + 120.0
    results: list[Path] = []
    while not results and time.monotonic() < deadline:
        time.sleep(0.1)
        results = [p for p in (site_folder.folder / "runs").glob("*.json") if p.stat().st_size]
    listener.kill()
    listener.wait()
    listener.stdout.close()
    (result,) = results
    found = json.loads(result.read_text(encoding="utf-8"))
    assert (found["outcome"], found["stop_reason"]) == ("stopped", reason)
    handed = site_folder.folder / "handover" / CSV_NAME
    while not (handed.is_file() and handed.stat().st_size) and time.monotonic() < deadline:
        time.sleep(0.1)
    with handed.open(encoding="utf-8", newline="") as stream:
        (row,) = csv.DictReader(stream)
    assert (row["outcome"], row["error"]) == ("stopped", reason), "not an operator's stop"
    log = open_log(result.with_suffix(".h5"))
    states = [event["state"] for event in log.events if event["event"] == StateChanged.__name__]
    assert states[-2:] == ["stopping", "stopped"]
    reasons = [event["values"] for event in log.events if event.get("id") == "stopped_because"]
    assert reasons == [{"reason": reason}]
