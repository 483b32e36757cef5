"""Messages of progress events, built from event ids and step labels."""

from collections.abc import Mapping

from calstation.messages.catalogue import entry, known
from calstation.messages.rendering import Text, Value


def event_text(event_id: str, values: Mapping[str, Value]) -> Text:
    """Return the message of a progress event; an unknown id is shown with its values."""
    code = f"event.{event_id}"
    if known(code):
        return Text(code, values)
    details = ", ".join(f"{name} {value}" for name, value in values.items())
    return Text.of("event.other", words=f"{event_id.replace('_', ' ')}{': ' if details else ''}{details}")


def step_text(kind: str, label: tuple[str | float, ...]) -> Text:
    """Return the description of a step from its kind (``move``, ``dwell``, ``carry``) and the label set by its plan."""
    if kind == "dwell":
        return Text("step.dwell")
    if not label:
        return Text("step.move")
    if known(f"step.{label[0]}"):
        return _labelled("step", label)
    words = " ".join(f"{part:g}" if isinstance(part, float | int) else part.replace("_", " ") for part in label)
    return Text.of("step.other", words=words)


def short_step_text(label: tuple[str | float, ...]) -> Text:
    """Return a few characters that describe a move, from its label, or else the result of `step_text`."""
    return _labelled("step_short", label) if known(f"step_short.{label[0]}") else step_text("move", label)


def _labelled(family: str, label: tuple[str | float, ...]) -> Text:
    name, *values = label
    return Text(f"{family}.{name}", dict(zip(entry(f"step.{name}").values, values, strict=False)))
