"""The catalogue describes the schedules and plans of every method."""

from collections.abc import Iterator
from itertools import takewhile
from pathlib import Path

import numpy as np
import pytest

import procedures
from calstation.config import schedule_fields
from calstation.errors import ConfigurationError
from calstation.messages import catalogue, entry, known, sentence, step_text
from calstation.physics import JointLimits, ManualMove, Move, RoundEnd, TableGeometry
from calstation.sequencer.steps import manual_move_label
from procedures import method

CATALOGUE = Path(catalogue.__file__).with_suffix("")
STAGES = sorted(path.stem for path in Path(procedures.__file__).parent.glob("*.py") if path.stem != "__init__")

#: A table with travel to spare, and one with little more than a turn.
TABLES = (TableGeometry(), TableGeometry(limits=JointLimits(np.deg2rad([-200.0] * 2), np.deg2rad([200.0] * 2))))


def labels(stage: str) -> Iterator[tuple[str, tuple[str | float, ...]]]:
    """Return type and label of every step of the plan on these tables; empty for a method without a table."""
    chosen = method(stage)
    manual = ({"manual": True},) if "manual" in chosen.schedule.model_fields else ()
    for table in TABLES:
        for values in ({}, *manual):
            try:
                steps = chosen.plan(table, chosen.schedule.model_validate(values))
                for step in takewhile(lambda each: not isinstance(each, RoundEnd), steps):
                    if isinstance(step, Move):
                        yield "move", step.label
                    elif isinstance(step, ManualMove):
                        yield "carry", manual_move_label(step)
            except ConfigurationError:
                continue


@pytest.mark.parametrize("stage", STAGES)
def test_every_schedule_field_has_a_name_and_description_in_the_catalogue(stage: str) -> None:
    for field in schedule_fields(stage):
        if field.kind not in ("targets", "number", "count", "flag", "choice"):
            continue  # the form does not show it
        about = next((c for c in (f"about_{stage}_{field.name}", f"about_{field.name}") if known(f"schedule.{c}")), "")
        assert about, f"schedule.about_{field.name}"
        for name in (field.name, about):
            assert known(f"schedule.{name}"), f"schedule.{name}"
            assert entry(f"schedule.{name}").zh, name


@pytest.mark.parametrize("stage", STAGES)
def test_every_method_has_a_file_of_texts_with_its_names(stage: str) -> None:
    assert Path(CATALOGUE, "methods", f"{stage}.toml").is_file()
    for code in (f"stage.{stage}", f"certificate.stage_{stage}"):
        assert known(code), code
        assert entry(code).zh, code
    if method(stage).needs_no_table:
        assert all(known(f"method.{stage}_{part}") for part in ("summary", "step_1", "needs", "finds"))


@pytest.mark.parametrize("stage", STAGES)
def test_every_step_of_a_plan_is_described_in_both_languages(stage: str) -> None:
    for kind, label in labels(stage):
        assert label, "without a label the window says only that the table moves"
        assert known(f"step.{label[0]}"), f"step.{label[0]}"
        assert sentence(step_text(kind, label)) != sentence(step_text(kind, label), "zh_CN")


def test_plans_on_these_tables_include_table_dependent_steps() -> None:
    names = {label[0] for stage in STAGES for _, label in labels(stage)}
    assert {"into_place", "carry", "whole_turns", "position"} <= names
