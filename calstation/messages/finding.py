"""What a link test found: ids and values, worded by the catalogue family ``finding``."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from calstation.messages.rendering import Text, Value, sentence, values_to_json

#: Good, for information, a run would not start although the link works, the link or a setting is wrong.
State = Literal["ok", "told", "look", "wrong"]

_WORST: tuple[State, ...] = ("wrong", "look", "ok")


@dataclass(frozen=True)
class Finding:
    """One line of a test."""

    id: str
    state: State
    values: Mapping[str, Value] = field(default_factory=dict)  #: Values in the braces of its sentences.
    entry: str = ""  #: Its key in the catalogue if several entries have this id; empty otherwise.

    @property
    def message(self) -> Text:
        """The message of the catalogue."""
        return Text(f"finding.{self.entry or self.id}", self.values)

    def to_json(self) -> dict[str, Any]:
        """JSON-ready: id, state and values; messages among the values as English sentences."""
        values = {name: sentence(value) if isinstance(value, Text) else value for name, value in self.values.items()}
        return {"id": self.id, "state": self.state, "values": values_to_json(values)}


@dataclass(frozen=True)
class Report:
    """The test of a device, ``table`` or ``imu``, in the order of its steps."""

    device: str
    findings: tuple[Finding, ...]

    @property
    def state(self) -> State:
        """The worst state of the findings."""
        states = {finding.state for finding in self.findings}
        return next((state for state in _WORST if state in states), "ok")

    def find(self, name: str) -> Finding | None:
        """The finding with this id, or None."""
        return next((finding for finding in self.findings if finding.id == name), None)
