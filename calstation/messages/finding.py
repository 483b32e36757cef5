"""Findings of a link test: ids and values; the catalogue family ``finding`` contains their texts."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from calstation.messages.rendering import Text, Value, sentence, values_to_json

#: In order: good; information; the link works, but a run may not start or complete; the link or a setting is wrong.
State = Literal["ok", "info", "warning", "error"]

_WORST: tuple[State, ...] = ("error", "warning", "ok")


@dataclass(frozen=True)
class Finding:
    """One line of a test report."""

    id: str
    state: State
    values: Mapping[str, Value] = field(default_factory=dict)  #: Values for the braces in its sentences.
    entry: str = ""  #: Catalogue key if several entries share this id; empty otherwise.

    @property
    def message(self) -> Text:
        """The message from the catalogue."""
        return Text(f"finding.{self.entry or self.id}", self.values)

    def to_json(self) -> dict[str, Any]:
        """Return id, state and values as JSON data; messages among the values become English sentences."""
        values = {name: sentence(value) if isinstance(value, Text) else value for name, value in self.values.items()}
        return {"id": self.id, "state": self.state, "values": values_to_json(values)}


@dataclass(frozen=True)
class Report:
    """Findings of the test of one device (``table``, ``chamber`` or ``imu``), in the order of the steps."""

    device: str
    findings: tuple[Finding, ...]

    @property
    def state(self) -> State:
        """The worst state of the findings."""
        states = {finding.state for finding in self.findings}
        return next((state for state in _WORST if state in states), "ok")

    def find(self, name: str) -> Finding | None:
        """Return the finding with this id, or None."""
        return next((finding for finding in self.findings if finding.id == name), None)
