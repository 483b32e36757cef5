"""Events survive the pipe and the log."""

import json
from dataclasses import FrozenInstanceError

import pytest

from calstation.sequencer import Fault, Message, StageProgress, StateChanged, StepStarted, Trace, from_json, to_json


@pytest.mark.parametrize(
    "event",
    [
        StateChanged("running", "preparing"),
        StepStarted("rate", 3, "move", ("turn", "x", 2.0)),
        Trace((0.05, 0.1), tuple(range(12))),
        StageProgress("rate", 0.5, 3.0, {"gyro_bias": 1e-6}),
        Message("homing"),
        Fault("device", "text", 3),
    ],
)
def test_events_survive_json(event: object) -> None:
    assert from_json(json.loads(json.dumps(to_json(event)))) == event  # type: ignore[arg-type]


def test_events_are_immutable() -> None:
    with pytest.raises(FrozenInstanceError):
        Message("a").id = "b"  # type: ignore[misc]
