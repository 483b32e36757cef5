"""Sentences about the events of a run in the current language."""

from calstation.gui.text.messages import KINDS, duration_text, fault_text, say, term
from calstation.messages import entry, event_text, known, rounds_text
from calstation.sequencer import Event, Fault, Finalized, Message, StageEnded, StageSolved, StageStarted, StateChanged

_CONSISTENCY = {True: "solved", False: "inconsistent", None: "solved_unjudged"}

#: Code of the fault of an engine that does not respond; a later event shows that the engine responds again.
_SILENT = "run.engine_silent"


def event_line(event: Event, *, followed: bool = False) -> tuple[str, str]:
    """Return the badge shape ("" for none) and the sentence of an event ("" if the event is only a detail).

    `followed` states whether the engine has sent another event afterwards.
    """
    match event:
        case Fault(code=code) if code == _SILENT and followed:
            return "caution", say("event_log.responds_again")
        case StateChanged(state="running", previous="paused"):
            return "active", say("event_log.resumed")
        case StateChanged() if known(f"event_log.{event.state}"):
            kind = KINDS.get(event.state, "")
            return "" if kind == "active" else kind, say(f"event_log.{event.state}")
        case StageStarted():
            return "active", say("event_log.stage_started", stage=event.stage, time=duration_text(event.duration))
        case StageEnded():
            code = f"event_log.ended_{event.reason}"
            values = {"stage": event.stage, "rounds": rounds_text(event.stage, event.rounds)}
            return "", say(code, **values) if known(code) else event.reason
        case StageSolved():
            passed = event.consistency.get("passed")
            return "bad" if passed is False else "done", say(f"event_log.{_CONSISTENCY[passed]}", stage=event.stage)
        case Message():
            code = f"event.{event.id}"
            warning = known(code) and entry(code).severity == "warning"
            return "caution" if warning else "", say(event_text(event.id, event.values))
        case Fault():
            return "bad", fault_text(event).sentences
        case Finalized():
            return KINDS[event.verdict], say("event_log.verdict", verdict=term("badge", event.verdict))
    return "", ""
