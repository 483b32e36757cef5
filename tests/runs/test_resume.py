"""A killed, stopped or faulty run is resumed after its last finished stage, with exact results."""

import json
import os
import signal
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from helpers import ignore_progress

from calstation.config import RunRequest
from calstation.devices.imu import FramedImu
from calstation.errors import ConfigurationError, DeviceFaultError, InputError
from calstation.records import open_log
from calstation.results import History, load_finished_run, resolve
from calstation.runs import Engine, execute, find_resumable, finish_incomplete, run_summary
from calstation.runs.incomplete import close_incomplete, close_incomplete_job
from calstation.runs.resume import Continuation, resumable_run
from calstation.sequencer import Command, Control, Event, Finalized, Message, StageSolved, StageStarted, StepStarted
from tests.dead_logs import write_dead_log
from tests.helpers import raises_code
from tests.shared_runs import SharedRuns
from tests.site_folder import PRODUCT, QUICK, SiteFolder

SHORT = {
    "rate": {"turns": 1, "dwell_s": 2.0, **QUICK},
    "six_position": {"dwell_s": 2.0, **QUICK},
}
STAGES = ("rate", "six_position")


def short(site_folder: SiteFolder) -> SiteFolder:
    """Configure stages of a few seconds with limits that they can meet."""
    site_folder.write({"schedule": SHORT, "stages": list(STAGES), "limits": {"gyro_scale": {"within": 0.1}}})
    return site_folder


def stopped_in(site_folder: SiteFolder, stage: str, *stages: str) -> Finalized:
    """Return a run stopped after the first step of a stage."""

    def watch(event: Event) -> None:
        if isinstance(event, StepStarted) and event.stage == stage:
            site_folder.control.send(Command.STOP)

    ended = site_folder.run(*(stages or STAGES), on_event=watch)
    site_folder.control = Control()
    site_folder.events = []
    return ended


@pytest.fixture
def before(site_folder: SiteFolder, shared_runs: SharedRuns) -> Finalized:
    """A run stopped in its second stage."""
    return shared_runs.copy("stopped", site_folder.folder, lambda folder: stopped_in(short(folder), "six_position"))


def resumed(site_folder: SiteFolder, log: str | Path, **more: object) -> Finalized:
    request = RunRequest(
        "SN-000042",
        site_folder.station,
        site_folder.product,
        operator="second",
        resume=Path(log),
        **more,  # type: ignore[arg-type]
    )
    execute(request, site_folder.events.append, site_folder.control)
    (ended,) = site_folder.events_of(Finalized)
    return ended


@pytest.mark.long
def test_stopped_run_is_resumed_after_its_last_finished_stage(site_folder: SiteFolder, before: Finalized) -> None:
    assert before.result["stages"] == ["rate"]
    assert (before.result["advice"], before.result["stop_reason"]) == ("resume", "operator")
    (offer,) = find_resumable(ignore_progress, site_folder.folder / "runs")
    assert (offer.serial, offer.stages, offer.finished) == ("SN-000042", STAGES, ("rate",))
    assert (offer.verdict, offer.why, offer.attempt) == ("stopped", "operator", 1)

    ended = resumed(site_folder, offer.log)
    result = ended.result
    assert ended.verdict.passed, [c for c in result["checks"] if not c["passed"]] or site_folder.events[-3:]
    assert result["stages"] == list(STAGES)
    assert result["resumed_from"] == Path(before.log).name
    assert (result["attempt"], result["operator"]) == (1, "second")
    assert result["log"]["gaps"] == 1
    assert [(s.stage, s.index, s.count) for s in site_folder.events_of(StageStarted)] == [("six_position", 1, 2)]
    assert [s.stage for s in site_folder.events_of(StageSolved)] == list(STAGES)
    messages = [m.id for m in site_folder.events_of(Message)]
    assert messages.index("resumed") < messages.index("identified") < messages.index("checking_mounting")

    assert Path(ended.log).parent == Path(before.log).parent
    Path(before.log).unlink()
    again = resolve(Path(ended.log)).result.to_json()
    for key in ("parameters", "consistency", "unobservable", "details", "configuration"):
        assert again[key] == result[key]
    assert find_resumable(ignore_progress, site_folder.folder / "runs") == []
    assert History(site_folder.folder / "runs").attempts("SN-000042") == 1


@pytest.mark.parametrize("resumes", [False, True], ids=["unit", "batch"])
def test_summary_of_a_resumed_run_has_the_stages_and_schedules_of_its_log(
    site_folder: SiteFolder, resumes: bool
) -> None:
    site_folder.write({"stages": [*STAGES, "azimuth_flip"]})
    planned = run_summary(site_folder.request(*STAGES))
    log = write_dead_log(site_folder.runs)
    schedule = {**PRODUCT["schedule"], "rate": {**PRODUCT["schedule"]["rate"], "dwell_s": 60.0}}
    site_folder.write({"stages": [*STAGES, "azimuth_flip"], "schedule": schedule})
    summary = run_summary(replace(site_folder.request(), resume=log, resumes=(log,) if resumes else ()))
    assert summary.omitted == planned.omitted == ("azimuth_flip",)
    assert summary.stages == planned.stages


@pytest.mark.exhaustive
def test_a_resumed_run_can_be_resumed_again(site_folder: SiteFolder, before: Finalized) -> None:
    first = before
    site_folder.control.send(Command.STOP)
    second = resumed(site_folder, first.log)
    assert (second.verdict, second.result["stages"]) == ("stopped", [])
    site_folder.events, site_folder.control = [], Control()
    (offer,) = find_resumable(ignore_progress, site_folder.folder / "runs")
    assert offer.log == Path(first.log)

    def stop(event: Event) -> None:
        site_folder.events.append(event)
        if isinstance(event, StepStarted) and event.stage == "six_position":
            site_folder.control.send(Command.STOP)

    request = RunRequest("SN-000042", site_folder.station, site_folder.product, resume=offer.log)
    execute(request, stop, site_folder.control)
    (third,) = site_folder.events_of(Finalized)
    assert (third.verdict, third.result["stages"]) == ("stopped", ["rate"])
    site_folder.events, site_folder.control = [], Control()
    ended = resumed(site_folder, third.log)
    assert ended.verdict.passed
    assert resolve(Path(ended.log)).result.to_json()["parameters"] == ended.result["parameters"]


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL exists only on POSIX systems")
def test_run_killed_in_the_third_stage_resumes_with_bit_identical_results(site_folder: SiteFolder) -> None:
    runs = site_folder.folder / "runs"
    stages = (*STAGES, "excitation")
    schedule = {**SHORT, "excitation": PRODUCT["schedule"]["excitation"]}
    site_folder.write({"schedule": schedule, "limits": {"gyro_scale": {"within": 0.1}}})
    with Engine.start(site_folder.request(*stages)) as engine:
        deadline = time.monotonic() + 200.0
        killed = False
        while not engine.ended:
            assert time.monotonic() < deadline
            for event in engine.poll():
                if isinstance(event, StepStarted) and event.stage == "excitation" and not killed:
                    assert engine.process.pid is not None
                    os.kill(engine.process.pid, signal.SIGKILL)
                    killed = True
            time.sleep(0.01)
    assert killed
    (log,) = runs.glob("*.h5")
    (offer,) = find_resumable(ignore_progress, runs)
    assert (offer.stages, offer.finished) == (stages, STAGES)
    assert offer.verdict == "incomplete"

    ended = resumed(site_folder, offer.log)
    result = ended.result
    assert ended.verdict.passed, [c for c in result["checks"] if not c["passed"]] or site_folder.events[-3:]
    incomplete = json.loads(log.with_suffix(".json").read_text("utf-8"))
    assert (incomplete["outcome"], incomplete["advice"]) == ("incomplete", "resume")
    assert incomplete["finished_stages"] == ["rate", "six_position"]
    for written, path in ((incomplete, log), (result, Path(ended.log))):
        assert written["duration_s"] == open_log(path).facts().samples / 200.0, "the same definition for every run"
    again = resolve(Path(ended.log)).result.to_json()
    assert again["parameters"] == result["parameters"]
    assert again["consistency"] == result["consistency"]
    assert again["log"]["sha256"] == result["log"]["sha256"]
    handed = sorted(path.name for path in (site_folder.folder / "handover").glob("*.json"))
    assert handed == sorted([log.with_suffix(".json").name, Path(ended.result_file).name])


@pytest.mark.long
def test_a_run_with_all_stages_finished_is_only_finalized(site_folder: SiteFolder) -> None:
    def watch(event: Event) -> None:
        if isinstance(event, StageSolved) and event.stage == "six_position":
            site_folder.control.send(Command.STOP)

    before = short(site_folder).run(*STAGES, on_event=watch)
    assert (before.verdict, before.result["stages"]) == ("stopped", list(STAGES))
    site_folder.control, site_folder.events = Control(), []
    ended = resumed(site_folder, before.log)
    assert ended.verdict.passed
    assert ended.result["parameters"] == before.result["parameters"]
    assert ended.result["registers"]["verified"] is True
    assert site_folder.events_of(StageStarted) == []


@pytest.mark.parametrize(
    ("change", "section"),
    [
        ({"limits": {"gyro_scale": {"within": 0.09}}}, "product"),
        pytest.param({"schedule": {**SHORT, "rate": {**SHORT["rate"], "turns": 2}}}, None, marks=pytest.mark.long),
    ],
)
def test_changed_configuration_prevents_resuming_except_for_the_schedule(
    site_folder: SiteFolder, before: Finalized, change: dict[str, object], section: str | None
) -> None:
    """Changed limits require a new run; the schedule stays the schedule at the start of the run."""
    base = {"schedule": SHORT, "stages": list(STAGES), "limits": {"gyro_scale": {"within": 0.1}}}
    site_folder.write({**base, **change})
    if section is None:
        ended = resumed(site_folder, before.log)
        assert ended.verdict.passed
        assert open_log(Path(ended.log)).meta.schedule == open_log(Path(before.log)).meta.schedule
        return
    with raises_code(ConfigurationError, "run.section_changed") as caught:
        resumed(site_folder, before.log)
    assert caught.value.values["section"] == section


def test_changed_site_requires_a_new_run(site_folder: SiteFolder, before: Finalized) -> None:
    text = site_folder.station.read_text("utf-8")
    site_folder.station.write_text(text.replace("34.25", "34.5"), encoding="utf-8")
    with raises_code(ConfigurationError, "run.section_changed") as caught:
        resumed(site_folder, before.log)
    assert caught.value.values["section"] == "site"


def test_run_cannot_be_resumed_at_another_station_of_the_site(site_folder: SiteFolder, before: Finalized) -> None:
    text = site_folder.station.read_text("utf-8")
    site_folder.station.write_text(text.replace("test bench", "line 3"), encoding="utf-8")
    with raises_code(ConfigurationError, "run.other_station"):
        resumed(site_folder, before.log)
    hardware, _, _ = text.partition("[bench]")
    hardware = hardware.replace('profile = "bench"', 'profile = "bench"\nport = "tcp://127.0.0.1:1"')
    site_folder.station.write_text(f'{hardware}\n[imu]\nport = "/dev/ttyNONE9"\n', encoding="utf-8")
    with raises_code(ConfigurationError, "run.station_now_hardware"):
        resumed(site_folder, before.log)


def test_changed_registers_require_a_new_run(
    site_folder: SiteFolder, before: Finalized, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = FramedImu.read_registers
    monkeypatch.setattr(FramedImu, "read_registers", lambda self: {**read(self), "gyro_scale_x": 1e-4})
    ended = resumed(site_folder, before.log)
    assert ended.verdict == "fault"
    assert site_folder.fault().code == "run.registers_changed"
    monkeypatch.undo()
    (offer,) = find_resumable(ignore_progress, site_folder.folder / "runs")
    assert offer.log == Path(before.log)


@pytest.mark.parametrize("end", [pytest.param("passed", marks=pytest.mark.long), "nothing finished"])
def test_a_run_that_cannot_be_resumed_gives_the_reason(site_folder: SiteFolder, end: str) -> None:
    short(site_folder)
    log = (site_folder.run("rate") if end == "passed" else stopped_in(site_folder, "rate")).log
    site_folder.events = []
    assert find_resumable(ignore_progress, site_folder.folder / "runs") == []
    with raises_code(ConfigurationError, "run.ended" if end == "passed" else "run.no_stage_finished"):
        resumed(site_folder, log)


def test_run_cannot_be_resumed_with_another_unit(site_folder: SiteFolder, before: Finalized) -> None:
    log = Path(before.log)
    with raises_code(ConfigurationError, "run.other_unit"):
        execute(
            RunRequest("SN-000043", site_folder.station, site_folder.product, resume=log), print, site_folder.control
        )
    with raises_code(ConfigurationError, "run.not_own_log"):
        execute(RunRequest("SN-000042", resume=log.with_suffix(".csv")), print, site_folder.control)
    with pytest.raises(InputError, match=r"(?i)no such file"):
        execute(RunRequest("SN-000042", resume=log.with_name("no.h5")), print, site_folder.control)


def test_a_log_that_solves_differently_is_not_resumed(site_folder: SiteFolder, before: Finalized) -> None:
    import h5py

    with h5py.File(before.log, "r+", libver="latest") as file:
        text = bytes(file["events"][:]).decode()
        at = text.index('"value":', text.index('"StageSolved"')) + len('"value": ')
        digit = at + 4
        file["events"][digit] = ord("5" if text[digit] != "5" else "6")
    ended = resumed(site_folder, before.log)
    assert ended.verdict == "fault"
    assert site_folder.fault().code == "run.solved_differently"


def test_unit_fault_before_the_remaining_stages_is_reported(
    site_folder: SiteFolder, before: Finalized, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(self: FramedImu) -> None:
        raise DeviceFaultError("stream.no_data")

    monkeypatch.setattr(FramedImu, "read", fail)
    ended = resumed(site_folder, before.log)
    assert (ended.verdict, ended.result["error_code"]) == ("fault", "stream.no_data")
    assert site_folder.fault().code == "stream.no_data"


def test_malformed_result_hides_only_its_own_run(site_folder: SiteFolder, before: Finalized) -> None:
    import h5py

    with h5py.File(before.log, "r+", libver="latest") as file:
        at = bytes(file["results"][:]).index(b'"name"')
        file["results"][at : at + 6] = list(b'"nome"')
    assert find_resumable(ignore_progress, site_folder.folder / "runs") == []
    with raises_code(InputError, "result.not_a_result"):
        load_finished_run(lambda *_, **__: None, Path(before.log), site_folder.folder)


def test_damaged_result_file_is_reported_when_closing_a_run(before: Finalized) -> None:
    Path(before.result_file).write_text("{", "utf-8")
    with raises_code(InputError, "result.not_json"):
        close_incomplete(Path(before.log))


def test_closed_run_is_no_longer_offered(site_folder: SiteFolder, before: Finalized) -> None:
    path = close_incomplete(Path(before.log), "li")
    closed = json.loads(path.read_text("utf-8"))
    assert closed["closed_by"] == "li"
    assert {k: v for k, v in closed.items() if not k.startswith("closed")} == before.result
    assert find_resumable(ignore_progress, site_folder.folder / "runs") == []


def test_closed_run_is_not_resumed_even_if_its_log_is_named(site_folder: SiteFolder, before: Finalized) -> None:
    log = Path(before.log)
    Continuation.of(site_folder.request(*STAGES), log)
    History(log.parent).refresh()
    (result,) = close_incomplete_job(ignore_progress, (log,), "li")
    assert result == log.with_suffix(".json")
    assert resumable_run(History(log.parent), "SN-000042", "test bench") is None  # a scan asks the index as it is
    with raises_code(ConfigurationError, "run.closed"):
        Continuation.of(site_folder.request(*STAGES), log)
    with raises_code(ConfigurationError, "run.closed"):
        execute(replace(site_folder.request(), resume=log, stages=None), site_folder.events.append, Control())


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL exists only on POSIX systems")
@pytest.mark.parametrize("touched", [0.0, 4e9], ids=["long ago", "in the future"])
def test_run_counts_as_running_until_its_process_ends(site_folder: SiteFolder, touched: float) -> None:
    with Engine.start(short(site_folder).request(*STAGES)) as engine:
        while not any(isinstance(event, StepStarted) and event.stage for event in engine.poll()):
            time.sleep(0.01)
        assert engine.process.pid is not None
        os.kill(engine.process.pid, signal.SIGSTOP)  # it writes no more, but lives
        (log,) = (site_folder.folder / "runs").glob("*.h5")
        os.utime(log, (touched, touched))
        assert finish_incomplete(log.parent) == []
        for use in (close_incomplete, lambda path: Continuation.of(site_folder.request(*STAGES), path)):
            with raises_code(ConfigurationError, "run.still_running"):
                use(log)
        os.kill(engine.process.pid, signal.SIGKILL)
        engine.process.join(30.0)
    os.utime(log, (touched, touched))
    result = json.loads(close_incomplete(log).read_text("utf-8"))
    assert (result["outcome"], result["advice"]) == ("incomplete", "repeat")
    assert finish_incomplete(log.parent) == []


@pytest.mark.exhaustive
def test_a_verdict_closes_earlier_runs(site_folder: SiteFolder, before: Finalized) -> None:
    assert find_resumable(ignore_progress, site_folder.folder / "runs")[0].log == Path(before.log)
    assert len(find_resumable(ignore_progress, site_folder.folder / "runs")) == 1
    assert site_folder.run("rate").verdict.passed
    assert find_resumable(ignore_progress, site_folder.folder / "runs") == []
