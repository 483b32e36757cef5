"""Sentences and terms of the message catalogue in the language of the window."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from calstation.errors import CalstationError
from calstation.gui.text import language
from calstation.messages import Rendered, Text, entry, event_text, rendering, short_step_text, step_text
from calstation.messages import with_minus as with_minus
from calstation.sequencer import Fault

#: Badge shape (`widgets.badge.KINDS`) of each state and outcome of a run.
KINDS = {
    "idle": "none",
    "not_ready": "caution",
    "starting": "waiting",
    "preparing": "active",
    "running": "active",
    "writing": "active",
    "pausing": "paused",
    "paused": "paused",
    "stopping": "stopped",
    "stopped": "stopped",
    "fault": "caution",
    "passed": "good",
    "partial": "partial",
    "failed": "bad",
    "released": "bad",
    "incomplete": "waiting",
}


@dataclass(frozen=True)
class ErrorText:
    """An error text in the current language.

    `source` names the origin of the error in the catalogue family ``source``, or is "", and `where` is its display
    text. An operator may reset a `resettable` fault on the device.
    """

    source: str
    where: str
    reason: str
    remedy: str
    resettable: bool = False

    @property
    def sentences(self) -> str:
        """The reason followed by the remedy."""
        return rendering.joined(self.reason, self.remedy, language.current())


def say(code: str, **values: Any) -> str:
    """Return the text of a catalogue entry in the current language."""
    return show(Text(code, values))


def rendered(message: Text) -> Rendered:
    """Render a message in the current language; a question has its title as `text`, its explanation as `remedy`."""
    return rendering.render(message.code, message.values, language.current(), window=True)


def show(message: Text) -> str:
    """Return the text of a message in the current language."""
    return rendered(message).sentences


def term(family: str, name: str, **values: Any) -> str:
    """Return a term of a catalogue family, such as the stage ``rate``."""
    return rendering.term(family, name, language.current(), **values)


def event_sentence(event_id: str, values: Mapping[str, Any]) -> str:
    """Return the sentence that describes a progress event."""
    return show(event_text(event_id, values))


def step_sentence(kind: str, label: tuple[str | float, ...]) -> str:
    """Return the description of a step; for a dwell after a labelled move, the position is included."""
    if kind == "dwell" and label:
        return f"{show(step_text('move', label))}  ·  {show(step_text(kind, ()))}"
    return show(step_text(kind, label))


def short_step(label: tuple[str | float, ...]) -> str:
    """Return a few characters that describe a move, from its label."""
    return show(short_step_text(label))


def fault_text(fault: Fault) -> ErrorText:
    """Return the error text of a run's fault."""
    return _coded(fault.code, fault.values) if fault.code else free_text(fault.text)


def error_text(error: CalstationError) -> ErrorText:
    """Return the error text of an exception."""
    return _coded(error.code, error.values)


def free_text(text: str) -> ErrorText:
    """Return the error text of a message without a code, such as one from an older result."""
    return ErrorText("", "", text, "")


def without_minus(text: str) -> str:
    """Return a typed or copied number with a hyphen instead of a minus sign, as files and `float` require."""
    return text.replace("−", "-")


def duration_text(seconds: float) -> str:
    """Format a duration, s, as ``m:ss`` or ``h:mm:ss``."""
    minutes, rest = divmod(max(0, round(seconds)), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def _coded(code: str, values: Mapping[str, Any]) -> ErrorText:
    found, shown = entry(code), rendered(Text(code, values))
    return ErrorText(found.source.format(**values), shown.source, shown.text, shown.remedy, found.resettable)
