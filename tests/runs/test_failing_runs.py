"""A run that is certain to fail says so while stages remain, and can be ended with its verdict."""

from dataclasses import replace
from pathlib import Path

import pytest

from calstation.estimation import Solution
from calstation.judgement import Check, final_checks
from calstation.results import resolve
from calstation.sequencer import Command, Event, Message, StageEnded, StageSolved, StageStarted
from tests.site_folder import SiteFolder

STAGES = {"stages": ["six_position", "azimuth_flip"]}


@pytest.fixture
def site_folder(tmp_path) -> SiteFolder:  # type: ignore[no-untyped-def]
    return SiteFolder(tmp_path)


@pytest.fixture
def inconsistent(monkeypatch: pytest.MonkeyPatch) -> None:
    """Residuals of every stage that are inconsistent, as those of a disturbed unit are."""

    def checks(solution: Solution) -> list[Check]:
        return [Check("consistency", solution.stage, 3.2, 1.1, "1", passed=False)]

    monkeypatch.setattr("calstation.runs.finalize.final_checks", checks)


def end_in_last_stage(site_folder: SiteFolder) -> list[Event]:
    """Run, and request the end of a failing run in the last stage; return the events of its end."""

    def watch(event: Event) -> None:
        if isinstance(event, StageStarted) and event.stage == "azimuth_flip":
            site_folder.control.send(Command.END_FAILING)

    site_folder.ended = site_folder.run(on_event=watch)  # type: ignore[attr-defined]
    return [e for e in site_folder.events if isinstance(e, StageEnded) and e.stage == "azimuth_flip"]


@pytest.mark.usefixtures("inconsistent")
def test_failing_run_is_announced_and_ended_with_its_verdict(site_folder: SiteFolder) -> None:
    site_folder.write(STAGES, out_of_limits=True)
    (end,) = end_in_last_stage(site_folder)
    (message,) = [m for m in site_folder.events_of(Message) if m.id == "will_fail"]
    assert message.values["why"].code == "event.inconsistent"
    assert message.values["why"].values["stage"] == "six_position"
    assert end.reason == "failing"
    assert [e.stage for e in site_folder.events_of(StageSolved)] == ["six_position"]
    ended = site_folder.ended  # type: ignore[attr-defined]
    assert (ended.verdict, ended.result["stages"]) == ("failed", ["six_position"])
    assert any(m.id == "registers_kept" for m in site_folder.events_of(Message))
    again = resolve(Path(ended.log)).result
    assert (again.stages, again.passed) == (["six_position"], False)
    assert {name: row.value for name, row in again.parameters.items()} == {
        name: row["value"] for name, row in ended.result["parameters"].items()
    }


@pytest.mark.long
def test_run_that_may_pass_is_not_ended(site_folder: SiteFolder) -> None:
    site_folder.write(STAGES)
    (end,) = end_in_last_stage(site_folder)
    assert end.reason != "failing"
    assert not [m for m in site_folder.events_of(Message) if m.id == "will_fail"]
    assert [e.stage for e in site_folder.events_of(StageSolved)] == STAGES["stages"]


@pytest.mark.long
def test_checks_of_effects_are_not_final(site_folder: SiteFolder) -> None:
    site_folder.write({"stages": ["six_position"]})
    solutions: list[Solution] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("calstation.runs.finalize.Finalization._note_failure", lambda self, s, n: solutions.append(s))
        site_folder.run()
    (solution,) = solutions
    kinds = {test.kind for test in solution.tests}
    assert "clipping" in kinds
    assert {check.kind for check in final_checks(solution)} >= kinds - {"effects", "alternatives"}
    if "effects" in kinds:
        assert "effects" not in {check.kind for check in final_checks(solution)}
    bad = replace(solution, consistency=replace(solution.consistency, nis_mean=99.0))
    assert not bad.consistency.count or not all(check.passed for check in final_checks(bad))
